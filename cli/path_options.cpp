#include "cli/path_options.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/vectors.h"
#include "devices/device.h"
#include "formats/documents/device_frame.h"

#include <fmt/format.h>

namespace haptrace::cli {
namespace {

/// Returns the result of `read`. Names the option in its errors.
template <class Read>
auto of_option(const char* option, const Read& read) {
  try {
    return read();
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: {}", option, error.what()));
  }
}

/// Returns the position of the tool, with zero force.
Vec3 position_of(Device& device) {
  DeviceState state;
  if (device.exchange({}, 0, state) != Device::Status::ok)
    throw Error(Error::Kind::fault, fmt::format("--start-here: {}", device.lost_reason()));
  if (!state.ready) {
    const std::string reason = device.not_ready_reason();
    throw input_error(fmt::format("--start-here: the device is not ready, so its position is unknown{}{}",
                                  reason.empty() ? "" : ": ", reason));
  }
  if (!is_finite(state.position)) throw Error(Error::Kind::fault, "--start-here: the device's position is not finite");
  return state.position;
}

}  // namespace

void ChangeArguments::add_to(CLI::App& app, const std::string& group) {
  app.add_option("--mirror", mirror, "change the sign of an axis: none | x | y | z")->group(group);
  app.add_option("--rotate", rotate, "rotate about an axis: z=90deg, or X,Y,Z=ANGLE, by the right-hand rule")
      ->type_name("AXIS=ANGLE")
      ->group(group);
  app.add_option("--scale", scale, "scale the path by this factor")->group(group);
  app.add_option("--about", about, "fixed point of mirror, rotate and scale: origin | start | centre | X,Y,Z")
      ->type_name("PLACE")
      ->group(group);
  app.add_option("--offset", offset, "move the path after that, as in 10mm,0,0")->type_name("X,Y,Z")->group(group);
}

void ChangeArguments::add_frame_to(CLI::App& app, const std::string& group, const std::string& meaning) {
  app.add_option("--frame", frame, meaning)->type_name("FILE.json")->group(group);
}

PathChange ChangeArguments::change() const {
  PathChange change{.scale = scale.value_or(1)};
  if (!mirror.empty()) change.mirror = of_option("--mirror", [&] { return parse_mirror(mirror); });
  if (!rotate.empty()) change.rotation = of_option("--rotate", [&] { return parse_rotation(rotate); });
  if (!about.empty()) change.about = of_option("--about", [&] { return parse_change_centre(about); });
  if (!offset.empty()) change.offset = of_option("--offset", [&] { return parse_vector(offset, "m", "the offset"); });
  if (!frame.empty()) change.frame = of_option("--frame", [&] { return load_device_frame(frame); });
  validate(change);
  return change;
}

void ChangeArguments::set_keys(nlohmann::json& keys) const {
  const PathChange change = this->change();
  if (!mirror.empty()) keys["mirror"] = mirror;
  if (!rotate.empty()) keys["rotate"] = rotate;
  if (scale) keys["scale"] = *scale;
  if (!about.empty())
    keys["about"] =
        change.about.kind == ChangeCentre::Kind::point ? json_of(change.about.point) : nlohmann::json(about);
  if (!offset.empty()) keys["offset"] = json_of(change.offset);
}

PathChange PathArguments::change(Device& device) const {
  PathChange change = place.change();
  if (!start_here) return change;
  if (fit) throw input_error("--start-here and --fit both decide where the path lies; use one of them");
  if (change.offset != Vec3::Zero())
    throw input_error("--start-here and --offset both decide where the path lies; use one of them");
  change.start = position_of(device);
  return change;
}

void PathArguments::add_to(CLI::App& app) {
  place.add_to(app, "Path");
  place.add_frame_to(app, "Path",
                     "the device's pose in the world: brings a path from the world's coordinates to the device's");
  app.add_flag("--start-here", start_here, "move the path so that it starts at the tool's present position")
      ->group("Path");
  app.add_flag("--fit", fit, "move and scale the path into the workspace")->group("Path");
  app.add_option("--from", selection.from, "start at this time of the recording [s]")->group("Path");
  app.add_option("--to", selection.to, "end at this time of the recording [s]")->group("Path");
  app.add_option("--repetition", selection.repetition,
                 "number of the repetition to use, from 1 (default: the last that was not cut short)")
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
  app.add_option("--max-deviation", max_deviation,
                 "distance from the reference on the path at which the session stops [m]")
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

void keep_applied(SessionOptions& options, const char* key, const std::string& text) {
  if (options.recording && !text.empty()) options.recording->meta[key] = text;
}

}  // namespace haptrace::cli
