#include "control/safety_limits.h"

#include "base/error.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace {

void validate(const SafetyLimits& limits) {
  const auto check = [](const char* name, double value, bool positive) {
    if (!(std::isfinite(value) && (positive ? value > 0 : value >= 0)))
      throw input_error(fmt::format("{} is {}; it must be {}", name, value, positive ? "above 0" : "0 (off) or above"));
  };
  check("the force limit [N]", limits.max_force, false);
  check("the continuous force limit [N]", limits.max_continuous_force, false);
  check("the torque limit [N m]", limits.max_torque, false);
  check("the time constant of the continuous force limit [s]", limits.continuous_time, true);
  check("the velocity limit [m/s]", limits.max_velocity, false);
  check("the soft start [s]", limits.soft_start, false);
  check("the release [s]", limits.release, false);
}

}  // namespace haptrace
