// The wrist of a simulated device that takes torque: orientation and rotation of its handle.
#pragma once

#include "control/rotation.h"
#include "devices/sim/spec.h"

namespace haptrace {

/// A handle of equal inertia about every axis, turned by motors, braked by friction, held by a hand:
///
///     J w' = tau - b w - c w / |w| + k_h e - b_h w
///
/// with e the rotation from the handle to the intended orientation, which is slow relative to the handle. Friction
/// sticks rigidly up to c. Steps are semi-implicit; dampers and friction are implicit, so that no size of theirs can
/// make a step unstable.
///
/// Independent of Plant: the rotation of the handle does not move the plant. Real-time: all but the constructor.
class Wrist {
 public:
  /// Starts at rest; `hand` may be null.
  Wrist(const WristSpec& spec, const HandSpec* hand, const Quat& start);

  /// Advances by `span` [s] under `torque` on the hand, in W [N m]; the hand intends the orientation `intent`.
  void advance(double span, const Vec3& torque, const Quat& intent) noexcept;

  void let_go() noexcept { hand_stiffness_ = hand_damping_ = 0; }

  [[nodiscard]] const Quat& orientation() const noexcept { return orientation_; }
  [[nodiscard]] const Vec3& angular_velocity() const noexcept { return velocity_; }  ///< in W [rad/s]

 private:
  void step(double h, const Vec3& torque, const Quat& intent) noexcept;

  double inertia_, viscous_, coulomb_;
  double hand_stiffness_ = 0, hand_damping_ = 0;
  double longest_step_;
  Quat orientation_;
  Vec3 velocity_ = Vec3::Zero();
};

}  // namespace haptrace
