// Rotations of a tool: rotation vectors and quaternions, and the law that turns the tool to its reference.
#pragma once

#include "base/types.h"
#include "control/filters.h"
#include "control/tuning.h"

#include <array>

namespace haptrace {

/// Returns the shortest rotation vector of a unit quaternion, at most pi long [rad]; NaN if it is not finite.
///
/// Real-time, as is everything here.
inline Vec3 rotation_vector(const Quat& q) noexcept {
  const double sign = q.w() < 0 ? -1 : 1;
  const double sine = q.vec().norm(), cosine = sign * q.w();
  return sign * (sine > 1e-9 ? 2 * std::atan2(sine, cosine) / sine : 2 / cosine) * q.vec();
}

/// Returns the unit quaternion of a rotation vector [rad].
inline Quat quaternion(const Vec3& rotation) noexcept {
  const double half = 0.5 * rotation.norm();
  const double scale = half > 1e-9 ? std::sin(half) / (2 * half) : 0.5;
  return {std::cos(half), scale * rotation.x(), scale * rotation.y(), scale * rotation.z()};
}

/// Returns the rotation, expressed in W, that turns `from` into `to` [rad].
inline Vec3 rotation_between(const Quat& from, const Quat& to) noexcept {
  return rotation_vector(to * from.conjugate());
}

inline bool is_finite(const Quat& q) noexcept {
  return std::isfinite(q.w()) && is_finite(Vec3(q.vec()));
}

/// Desired orientation and angular velocity of a tool; NaN if there is no reference.
struct OrientationReference {
  Quat orientation = nan_quat();
  Vec3 angular_velocity = nan3();  ///< in W [rad/s]
};

/// Estimates the angular velocity of a tool from its orientations at successive ticks: the rotation between two ticks
/// over the time between them, low-passed as positions are by default (two poles at 100 Hz).
class AngularVelocity {
 public:
  explicit AngularVelocity(double rate_hz) : filter_(FilterKind::low_pass, 100, rate_hz) {}

  /// Returns the angular velocity in W [rad/s]. It is zero at the first orientation, and does not change while the
  /// orientation is unknown or no time passes.
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

/// Returns tau = Kp e + Kd (w_d - w) on the hand, in W [N m], with e the rotation from the tool to its reference. This
/// is PD on the rotation vector (Bullo and Murray 1995, "Proportional derivative (PD) control on the Euclidean group").
/// Its potential Kp |e|^2 / 2 has no other equilibrium than e = 0 for |e| < pi.
inline Vec3 orientation_torque(const OrientationGains& gains, const Vec3& error, const Vec3& velocity_error) noexcept {
  return gains.kp * error + gains.kd * velocity_error;
}

}  // namespace haptrace
