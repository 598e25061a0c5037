#include "player/playback/orientation_follower.h"

namespace haptrace {

void OrientationFollower::start(const State& first) noexcept {
  velocity_.reset();
  (void)velocity_.update(first.orientation, 0);
  reference_ = first.orientation;
}

double OrientationFollower::begin_approach(const Quat& to) noexcept {
  from_ = is_finite(reference_) ? reference_ : to;
  way_ = rotation_between(from_, to);
  return MinJerk::kPeakSpeed * way_.norm() / kApproachSpeed;
}

OrientationReference OrientationFollower::approach(double part, double duration) const noexcept {
  const MinJerk blend = MinJerk::at(part);
  return {quaternion(blend.s * way_) * from_, blend.ds / duration * way_};
}

Vec3 OrientationFollower::torque(const State& state, const OrientationReference& reference) noexcept {
  const Vec3 velocity = velocity_.update(state.orientation, state.dt);
  reference_ = reference.orientation;
  deviation_ = 0;
  if (!is_finite(state.orientation) || !is_finite(reference.orientation)) return Vec3::Zero();
  const Vec3 error = rotation_between(state.orientation, reference.orientation);
  deviation_ = error.norm();
  return orientation_torque(options_.gains, error, reference.angular_velocity - velocity);
}

}  // namespace haptrace
