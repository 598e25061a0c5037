#include "control/arm_support.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

ArmSupport::ArmSupport(const Options& options) : options_(options) {
  check_range("the support of the arm", options.force, 0, 1000, "N");
  check_range("the length of the direction upwards", options.up.norm(), 1 - 1e-6, 1 + 1e-6, "");
  check_range("the height at which the support ends", options.top, -100, 100, "m");
  check_range("the way over which the support ends", options.fade, 1e-4, 10, "m");
}

Vec3 ArmSupport::update(const State& state, bool acts) noexcept {
  if (!(state.dt > 0) || !is_finite(state.position) || !is_finite(state.velocity)) return Vec3::Zero();
  return on_.advance(acts ? 1 : 0, state.dt, acts ? kRise : kFall) * steady(options_, state.position, state.velocity);
}

Vec3 ArmSupport::steady(const Options& options, const Vec3& position, const Vec3& velocity) noexcept {
  const double rises = velocity.dot(options.up), left = options.top - position.dot(options.up);
  const double carried = std::clamp((kFastest - rises) / (kFastest - kCarried), 0.0, 1.0),
               below = std::clamp(left / options.fade, 0.0, 1.0),
               damping = std::min(options.force / (kFastest - kCarried), kMostDamping);
  return (carried * below * options.force - (1 - below) * damping * std::max(rises, 0.0)) * options.up;
}

}  // namespace haptrace
