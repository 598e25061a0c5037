// PD control of the tool's orientation along a path.
#pragma once

#include "control/controller.h"
#include "control/path/min_jerk.h"
#include "control/rotation.h"
#include "player/playback/playback_options.h"

namespace haptrace {

/// PD law on the tool's orientation during a playback, for devices that take torque. It shares only the clock with the
/// law of the position.
///
/// Real-time: all but the constructor.
class OrientationFollower {
 public:
  static constexpr double kApproachSpeed = 0.6;  ///< peak speed of the approach [rad/s]

  explicit OrientationFollower(const OrientationOptions& options) : options_(options), velocity_(options.rate_hz) {}

  /// Resets to the first state of a session, or the first after a gap.
  void start(const State& first) noexcept;

  /// Begins the approach from the current reference to `to` and returns its shortest duration [s].
  double begin_approach(const Quat& to) noexcept;
  /// Returns the reference at `part`, 0 to 1, of an approach that lasts `duration` [s].
  [[nodiscard]] OrientationReference approach(double part, double duration) const noexcept;

  /// Returns the torque on the hand towards `reference`, in W [N m]; zero while either orientation is not finite.
  [[nodiscard]] Vec3 torque(const State& state, const OrientationReference& reference) noexcept;

  /// Returns the angle to the reference at the last call of torque() [rad].
  [[nodiscard]] double deviation() const noexcept { return deviation_; }
  [[nodiscard]] const OrientationOptions& options() const noexcept { return options_; }

 private:
  OrientationOptions options_;
  AngularVelocity velocity_;
  Quat reference_ = nan_quat();  ///< last reference
  Quat from_ = nan_quat();
  Vec3 way_ = Vec3::Zero();  ///< rotation of the approach [rad]
  double deviation_ = 0;
};

}  // namespace haptrace
