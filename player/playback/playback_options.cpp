#include "player/playback/playback_options.h"

#include "base/enum_names.h"
#include "base/error.h"

#include <algorithm>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr EnumNames<DeviationPolicy, 3> kPolicies{"deviation policy", {"stop", "pause", "soften"}};

}  // namespace

DeviationPolicy parse_deviation_policy(std::string_view name) {
  return kPolicies.parse(name);
}

const char* to_string(DeviationPolicy policy) noexcept {
  return kPolicies.name(policy);
}

void validate(const PlaybackOptions& options) {
  check_range("the speed factor", options.speed, 0.001, 100);
  check_range("the number of repetitions", options.repetitions, 0, 1e6);
  check_range("the hold time", options.hold, 0, 3600, "s");
  check_range("the approach speed", options.approach_speed, 1e-3, 2, "m/s");
  check_range("the deviation limit", options.max_deviation, 1e-5, 10, "m");
}

OrientationGains cautious_orientation_gains(double max_torque) {
  const double kp = max_torque / (20 * std::numbers::pi / 180);
  return {.kp = kp, .kd = 0.02 * kp};
}

}  // namespace haptrace
