#include "control/safety_limits.h"

#include "base/error.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace {

void validate(const SafetyLimits& limits) {
  const auto check = [](const char* name, double value, const char* meant, bool zero = true) {
    if (!(std::isfinite(value) && (zero ? value >= 0 : value > 0)))
      throw input_error(fmt::format("{} is {}; it must be {}", name, value, meant));
  };
  constexpr const char* kDevice = "0 (the device's limit) or above";
  check("the force limit [N]", limits.max_force, kDevice);
  check("the continuous force limit [N]", limits.max_continuous_force, kDevice);
  check("the torque limit [N m]", limits.max_torque, kDevice);
  check("the time constant of the continuous force limit [s]", limits.continuous_time, "above 0", false);
  check("the velocity limit [m/s]", limits.max_velocity, "0 (off) or above");
  check("the soft start [s]", limits.soft_start, "0 or above");
  check("the release [s]", limits.release, "0 or above");
}

}  // namespace haptrace
