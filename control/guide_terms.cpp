#include "control/guide_terms.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

Vec3 ExpertForce::force(const GuideInput& input) noexcept {
  const PathProjection::Foot& foot = input.foot;
  returns_ |= input.gate <= 0;
  if (returns_) {
    // An expert who rests has no speed to divide by.
    const double pace = foot.speed > kFastest * foot.expert_speed ? kFastest
                        : foot.speed > foot.expert_speed          ? foot.speed / foot.expert_speed
                                                                  : 1;
    share_ += pace * input.state.dt / kReturn;
  }
  if (!returns_ || share_ >= input.gate) {
    share_ = input.gate;
    returns_ = input.gate <= 0;
  }
  return foot.certainty * share_ * input.tuning.force * scale_ * input.foot.place.force;
}

double ExpertForce::allowance(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
  return std::abs(tuning.force * scale_ * foot.place.force.dot(foot.place.tangent));
}

Vec3 PaceHelp::force(const GuideInput& input) noexcept {
  const PathProjection::Foot& foot = input.foot;
  const double lacking = (1 - options_.margin) * options_.pace * foot.expert_speed - kUnnoticed - foot.speed;
  if (!(lacking > 0)) return Vec3::Zero();
  return input.gate * foot.heading_certainty * input.tuning.assist *
         std::min(options_.gain * lacking, options_.max_force) * foot.place.tangent;
}

Vec3 Resistance::force(const GuideInput& input) noexcept {
  const Vec3& tangent = input.foot.place.tangent;
  return -damping_ * input.state.velocity.dot(tangent) * tangent;
}

Vec3 ErrorAmplification::force(const GuideInput& input) noexcept {
  const PathProjection::Tube& tube = input.foot.tube;
  if (!(tube.distance < tube.radius)) return Vec3::Zero();
  // Fades to zero over the outer fifth of the tunnel, before the wall begins.
  const double fading = std::min(5 * (1 - tube.distance / tube.radius), 1.0);
  return fading * std::min(stiffness_ * tube.distance, max_force_) * tube.outwards;
}

}  // namespace haptrace
