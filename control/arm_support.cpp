#include "control/arm_support.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

ArmSupport::ArmSupport(const Options& options) : options_(options), force_(options.force) {
  check_range("the support of the arm", options.force, 0, 1000, "N");
  check_range("the length of the direction upwards", options.up.norm(), 1 - 1e-6, 1 + 1e-6, "");
  check_range("the height at which the support ends", options.top, -100, 100, "m");
  check_range("the stiffness of the end of the support", options.stiffness, 1, 1e5, "N/m");
}

Vec3 ArmSupport::update(const State& state, bool acts, double wanted) noexcept {
  if (!(state.dt > 0) || !is_finite(state.position) || !is_finite(state.velocity)) return Vec3::Zero();
  if (wanted >= 0) force_ += std::clamp(wanted - force_, -kSlew * state.dt, kSlew * state.dt);
  return on_.advance(acts ? 1 : 0, state.dt, acts ? kRise : kFall) * steady(state.position, state.velocity);
}

Vec3 ArmSupport::steady(const Vec3& position, const Vec3& velocity) const noexcept {
  const double rises = velocity.dot(options_.up), left = options_.top - position.dot(options_.up);
  const double carried = std::clamp((kFastest - rises) / (kFastest - kCarried), 0.0, 1.0),
               below = std::clamp(left / std::max(force_ / options_.stiffness, kShortest), 0.0, 1.0),
               damping = std::min(force_ / (kFastest - kCarried), kMostDamping);
  return (carried * below * force_ - (1 - below) * damping * std::max(rises, 0.0)) * options_.up;
}

}  // namespace haptrace
