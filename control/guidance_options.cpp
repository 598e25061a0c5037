#include "control/guidance_options.h"

#include "base/error.h"

namespace haptrace {

void validate(const GuidanceOptions& options) {
  check_range("the speed factor", options.speed, 0.001, 100, "");
  check_range("the distance at which the cursor waits", options.wait, 0, 10, "m");
  check_range("the number of repetitions", options.repetitions, 0, 1e6, "");
  check_range("the hold time", options.hold, 0, 3600, "s");
  check_range("the approach speed", options.approach_speed, 1e-3, 2, "m/s");
  check_range("the time limit", options.time_limit, 0, 1e6, "s");
  check_range("the deviation limit", options.max_deviation, 1e-5, 10, "m");
  check_range("the deviation limit of the approach", options.max_approach_deviation.value_or(options.max_deviation),
              1e-5, 10, "m");
  check_range("the position resolution", options.resolution, 0, 1, "m");
  check_range("the time for which a hand may resist", options.patience, 0, 3600, "s");
}

void validate(const BackWallOptions& options) {
  check_range("the time for which the back wall waits", options.wait, 0, 60, "s");
  check_range("the stiffness of the back wall", options.stiffness, 1, 1e4, "N/m");
  check_range("the largest force of the back wall", options.max_force, 0, 100, "N");
  check_range("the pace of the back wall", options.pace, 0.01, 100, "");
}

}  // namespace haptrace
