// Rotations of a tool: rotation vectors and quaternions, and the law that turns it to where it should point.
#pragma once

#include "base/types.h"
#include "control/filters.h"

#include <array>

namespace haptrace {

/// The shortest rotation vector of a unit quaternion, at most pi long [rad]. NaN of one that is not finite.
///
/// Real-time, as everything here.
inline Vec3 rotation_vector(const Quat& q) noexcept {
  const double sign = q.w() < 0 ? -1 : 1;
  const double sine = q.vec().norm(), cosine = sign * q.w();
  return sign * (sine > 1e-9 ? 2 * std::atan2(sine, cosine) / sine : 2 / cosine) * q.vec();
}

/// The unit quaternion of a rotation vector [rad].
inline Quat quaternion(const Vec3& rotation) noexcept {
  const double half = 0.5 * rotation.norm();
  const double scale = half > 1e-9 ? std::sin(half) / (2 * half) : 0.5;
  return {std::cos(half), scale * rotation.x(), scale * rotation.y(), scale * rotation.z()};
}

/// By which rotation, expressed in W, `from` becomes `to` [rad].
inline Vec3 rotation_between(const Quat& from, const Quat& to) noexcept {
  return rotation_vector(to * from.conjugate());
}

inline bool is_finite(const Quat& q) noexcept {
  return std::isfinite(q.w()) && is_finite(Vec3(q.vec()));
}

/// How a tool points and turns. NaN where nothing is asked for.
struct OrientationReference {
  Quat orientation = nan_quat();
  Vec3 angular_velocity = nan3();  ///< in W [rad/s]
};

/// How fast a tool turns, from where it points at successive ticks: the rotation from one to the next over the time
/// between them, low-passed as positions are by default (two poles at 100 Hz).
class AngularVelocity {
 public:
  explicit AngularVelocity(double rate_hz) : filter_(FilterKind::low_pass, 100, rate_hz) {}

  /// In W [rad/s]. Zero at the first orientation, and as it was while none is known or no time passes.
  Vec3 update(const Quat& orientation, double dt) noexcept {
    if (!haptrace::is_finite(orientation)) return velocity_;
    if (dt > 0 && haptrace::is_finite(before_)) {
      velocity_ = filter_.update(rotation_between(before_, orientation) / dt);
    }
    before_ = orientation;
    return velocity_;
  }

  void reset() noexcept {
    before_ = nan_quat();
    velocity_.setZero();
    filter_.reset();
  }

 private:
  BasicButterworth2<Vec3> filter_;
  Quat before_ = nan_quat();
  Vec3 velocity_ = Vec3::Zero();
};

/// The same in every direction: the inertia of a wrist is hardly known, and nearly so.
struct OrientationGains {
  double kp = 0;  ///< [N m/rad]
  double kd = 0;  ///< [N m s/rad]

  bool operator==(const OrientationGains&) const = default;
};

/// tau = Kp e + Kd (w_d - w) on the hand, in W [N m], with e the rotation from the tool to its reference: PD on the
/// rotation vector (Bullo and Murray 1995, "Proportional derivative (PD) control on the Euclidean group"), whose
/// potential Kp |e|^2 / 2 has no other rest than e = 0 for |e| < pi.
inline Vec3 orientation_torque(const OrientationGains& gains, const Vec3& error, const Vec3& velocity_error) noexcept {
  return gains.kp * error + gains.kd * velocity_error;
}

}  // namespace haptrace
