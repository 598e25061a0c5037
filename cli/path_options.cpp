#include "cli/path_options.h"

#include "base/error.h"

#include <fmt/format.h>

namespace haptrace::cli {

void PathArguments::add_to(CLI::App& app) {
  app.add_flag("--fit", fit, "move and scale the path into the workspace")->group("Path");
  app.add_option("--from", selection.from, "start at this time of the recording [s]")->group("Path");
  app.add_option("--to", selection.to, "end at this time of the recording [s]")->group("Path");
  app.add_option("--repetition", selection.repetition,
                 "number of the repetition to use, from 1 (default: the last one)")
      ->group("Path");
  app.add_option("--smoothing", smoothing,
                 "time constant of the smoothing of positions [s] (0: none; default: from their noise)")
      ->group("Path");
  app.add_option("--repeat", repeat, "number of repetitions")->capture_default_str()->group("Path");
  app.add_flag("--loop", loop, "repeat until Ctrl+C")->group("Path");
  app.add_option("--hold", hold, "time to hold at the end of a repetition [s]")->capture_default_str()->group("Path");
  app.add_option("--approach-speed", approach_speed, "peak speed of the approach [m/s]")
      ->capture_default_str()
      ->group("Path");
  app.add_option("--max-deviation", max_deviation, "distance from the path at which the session stops [m]")
      ->capture_default_str()
      ->group("Safety");
}

int PathArguments::repetitions() const {
  // The configuration of a recording has both; its repeat is then 1.
  if (loop && repeat != 1)
    throw input_error(fmt::format("--loop repeats until Ctrl+C and --repeat {} does not; use one of them", repeat));
  if (loop) return 0;
  if (repeat < 1) throw input_error(fmt::format("--repeat is {}; it must be at least 1, or use --loop", repeat));
  return repeat;
}

}  // namespace haptrace::cli
