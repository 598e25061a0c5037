// Force that a movement of a simulated device and its hand needs.
#pragma once

#include "devices/sim/spec.h"

namespace haptrace {

/// Computes the force that would make a simulated device follow a movement exactly. It solves the equations of
/// devices/sim/plant.h for the command; the handle drags the hand along. The hand's own movement, the motors' lag,
/// quantisation, a structural mode and the force of moving through places of other mass are left out. For evaluation
/// only: no controller knows a SimSpec.
///
/// Real-time: update.
class NeededForce {
 public:
  NeededForce(const SimSpec& spec, double rate_hz);

  /// Moves the handle to `position` in W, one period after the previous call, and returns the force on it since then,
  /// in W [N]. The handle starts at rest. Velocity and acceleration are differences of the positions.
  Vec3 update(const Vec3& position) noexcept;

 private:
  /// Returns the force that the device alone needs, in actuator axes [N].
  [[nodiscard]] Vec3 of_device(const Vec3& x, const Vec3& v, const Vec3& a) const noexcept;
  /// Advances the hand by a period and returns the force of the handle on it [N].
  Vec3 of_hand(const Vec3& x, const Vec3& v) noexcept;

  SimSpec spec_;
  Eigen::Matrix3d rotation_;  ///< from W to the actuator axes
  double period_;
  bool begun_ = false;
  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero();            ///< position and velocity of the handle, in actuator axes
  Vec3 hand_x_ = Vec3::Zero(), hand_v_ = Vec3::Zero();  ///< position and velocity of the hand, in actuator axes
  Vec3 arm_ = Vec3::Zero();                             ///< force of the arm on the hand [N]
};

}  // namespace haptrace
