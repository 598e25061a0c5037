// Turning a tool along the orientations of a path.
#pragma once

#include "control/controller.h"
#include "control/path/min_jerk.h"
#include "control/rotation.h"

namespace haptrace {

/// The part of a playback that turns the tool of a device which takes torque: PD on its orientation. Beside the law of
/// the position it shares its clock with and nothing else.
///
/// Real-time: all but the constructor.
class OrientationFollower {
 public:
  struct Options {
    OrientationGains gains;
    double max_deviation = 1;  ///< [rad]
    double rate_hz = 1000;     ///< of the servo loop [Hz]
  };

  static constexpr double kApproachSpeed = 0.6;  ///< peak, on the way to the start [rad/s]

  explicit OrientationFollower(const Options& options) : options_(options), velocity_(options.rate_hz) {}

  /// The first state of a session, and the first after a gap in it.
  void start(const State& first) noexcept;

  /// Begins the way from where the reference is to `to`, and answers how long it takes at least [s].
  double begin_approach(const Quat& to) noexcept;
  /// The reference at that part of the way, 0 to 1, which lasts `duration` [s].
  [[nodiscard]] OrientationReference approach(double part, double duration) const noexcept;

  /// The torque on the hand towards `reference`, in W [N m]; none while the tool or the reference is not known.
  [[nodiscard]] Vec3 torque(const State& state, const OrientationReference& reference) noexcept;

  /// Of the last torque [rad].
  [[nodiscard]] double deviation() const noexcept { return deviation_; }
  [[nodiscard]] const Options& options() const noexcept { return options_; }

 private:
  Options options_;
  AngularVelocity velocity_;
  Quat reference_ = nan_quat();  ///< the last
  Quat from_ = nan_quat();
  Vec3 way_ = Vec3::Zero();  ///< of the approach [rad]
  double deviation_ = 0;
};

}  // namespace haptrace
