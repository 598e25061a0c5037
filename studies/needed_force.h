// What force a movement asks for of a simulated device and the hand that holds it.
#pragma once

#include "devices/sim/spec.h"

namespace haptrace {

/// The force that would hold a simulated device exactly to a movement: the equations of devices/sim/plant.h solved for
/// the command, with the hand dragged along by the handle. What the hand does by itself, the motors' lag, quanta and a
/// structural mode are left out. For judges: no controller knows a SimSpec.
///
/// Real-time: update.
class NeededForce {
 public:
  NeededForce(const SimSpec& spec, double rate_hz);

  /// The handle is at `position` in W, a period after it was at the previous one; it begins at rest. Answers the force
  /// on it since then, in W [N]. Velocity and acceleration are differences of the positions.
  Vec3 update(const Vec3& position) noexcept;

 private:
  /// Of the device alone on its motors, in actuator axes [N].
  [[nodiscard]] Vec3 of_device(const Vec3& x, const Vec3& v, const Vec3& a) const noexcept;
  /// Of the handle on the hand, which moves on by a period [N].
  Vec3 of_hand(const Vec3& x, const Vec3& v) noexcept;

  SimSpec spec_;
  Eigen::Matrix3d rotation_;  ///< from W to the actuator axes
  double period_;
  bool begun_ = false;
  Vec3 x_ = Vec3::Zero(), v_ = Vec3::Zero();            ///< of the handle, in actuator axes
  Vec3 hand_x_ = Vec3::Zero(), hand_v_ = Vec3::Zero();  ///< likewise
  Vec3 arm_ = Vec3::Zero();                             ///< of the arm on the hand [N]
};

}  // namespace haptrace
