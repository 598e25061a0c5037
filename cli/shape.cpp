#include "base/error.h"
#include "cli/path_options.h"
#include "cli/read_progress.h"
#include "cli/verb.h"
#include "control/path/shapes.h"
#include "formats/path/path_file.h"

#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace::cli {

Verb add_shape(CLI::App& app) {
  struct Arguments {
    std::string name, file;
    ShapeOptions shape;
    std::vector<double> centre;
    ChangeArguments change;
    bool overwrite = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  ShapeOptions& shape = arguments->shape;
  CLI::App* verb = app.add_subcommand("shape", "make a path: square, circle, line, figure8, reach, spiral or script");
  verb->footer(
      "The path is one minimum-jerk movement along its arc; line has one in each direction, and script has the even\n"
      "rhythm of handwriting.\n"
      "  haptrace shape square --size 0.1 --duration 8 -o square.h5\n"
      "  haptrace shape circle --turns 3 --plane yz -o circle.csv");
  verb->add_option("name", arguments->name, fmt::format("{}", fmt::join(shape_names(), " | ")))->type_name("SHAPE");
  verb->add_option("-o,--output", arguments->file, "path to write, HDF5 or CSV by its ending")->type_name("FILE");
  verb->add_option("--size", shape.size, "side, diameter or length [m]")->capture_default_str();
  verb->add_option("--duration", shape.duration, "time of one turn [s]")->capture_default_str();
  verb->add_option("--turns", shape.turns, "number of turns")->capture_default_str();
  verb->add_option("--blend", shape.blend, "corner radius of the square [m] (0: sharp)")->capture_default_str();
  verb->add_option("--centre,--center", arguments->centre, "centre of the shape: X,Y,Z [m]")
      ->expected(3)
      ->delimiter(',');
  verb->add_option("--plane", shape.plane, "plane of the shape: xy | yz | zx")->capture_default_str();
  verb->add_option("--angle", shape.angle, "direction of line and reach in the plane [rad]")->capture_default_str();
  verb->add_option("--sample-rate", shape.rate_hz, "sample rate of the path [Hz]")->capture_default_str();
  verb->add_flag("--constant-speed", shape.constant_speed, "move at constant speed instead of minimum jerk");
  arguments->change.add_to(*verb, "Change");
  verb->add_flag("--overwrite", arguments->overwrite, "replace an existing file");

  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "name");
            require(*verb, "--output");
            if (!arguments->centre.empty()) arguments->shape.centre = Vec3(arguments->centre.data());
            if (std::abs(arguments->shape.angle) > 2 * std::numbers::pi)
              throw input_error(fmt::format(
                  "--angle {:g}: is in radians and more than a full turn; {:g} degrees are "
                  "{:.4g} rad",
                  arguments->shape.angle, arguments->shape.angle, arguments->shape.angle * std::numbers::pi / 180));
            const Path path = [&] {
              const WaitingLine line(output, "writing " + arguments->file);
              Path made = make_shape(arguments->name, arguments->shape);
              arguments->change.change().apply(made);
              save_path(made, arguments->file, arguments->name, arguments->overwrite);
              return made;
            }();
            const Vec3 size = path.bounds().size();
            output.tell({{"file", arguments->file},
                         {"samples", path.size()},
                         {"duration_s", path.duration()},
                         {"size_m", {size.x(), size.y(), size.z()}}},
                        fmt::format("{}: {} samples over {:g} s, {:.4g} x {:.4g} x {:.4g} mm\n", arguments->file,
                                    path.size(), path.duration(), 1e3 * size.x(), 1e3 * size.y(), 1e3 * size.z()));
            return kDone;
          }};
}

}  // namespace haptrace::cli
