#include "player/motor_limit.h"

#include "control/limits.h"
#include "devices/loop/servo_loop.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {

bool bound_by_motors(SessionOptions& session, const DeviceInfo& device, const PlantModel& plant) {
  double& limit = session.loop.limits.max_force;
  const double allowed =
      limit > 0 && device.max_force > 0 ? std::min(limit, device.max_force) : std::max(limit, device.max_force);
  if (!(plant.motor_limit > 0) || (allowed > 0 && allowed <= plant.motor_limit)) return false;
  limit = plant.motor_limit;
  session.known.push_back(
      {.code = "motor_limit",
       .text = fmt::format(
           "the motors of {} gave at most {:.1f} N in its calibration{}: the session sends no more. A "
           "path or a hand that needs more force is followed less closely",
           device.model, plant.motor_limit,
           device.max_force > 0 ? fmt::format(", not the {:.1f} N that it states", device.max_force) : "")});
  return true;
}

std::string heat_foreseen(const DeviceInfo& device, const ServoOptions& loop, double force, double duration) {
  const SafetyLimits limits = ServoLoop::in_force(device, loop.limits);
  ForceLimiter limiter(limits);
  if (loop.motors != nullptr) limiter.warm(loop.motors->force, loop.motors->rested);
  const double left = limiter.time_left(force);
  if (!(left < duration)) return "";
  return fmt::format(
      "in its trial the law took {:.2g} N rms, and the motors bear {:.2g} N for long: if the hand pulls as much again, "
      "the force is limited from about {:.0f} s on, and the device then follows less closely. Play fewer repetitions "
      "at a time",
      force, limits.max_continuous_force, left);
}

}  // namespace haptrace
