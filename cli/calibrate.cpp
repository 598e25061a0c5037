#include "base/error.h"
#include "base/output_file.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
#include "player/calibration/calibration.h"
#include "player/calibration/calibration_plan.h"
#include "player/playback/playback.h"

#include <Eigen/Geometry>

#include <chrono>
#include <fmt/format.h>
#include <numbers>
#include <thread>

namespace haptrace::cli {
namespace {

constexpr int kCountdown = 3;     // countdown on the real clock, before any movement [s]
constexpr double kHardly = 1.25;  // improvement below which a law is hardly closer than PD control

struct CalibrateArguments {
  SessionArguments session;
  std::string output, record;
  bool quick = false, full = false, yes = false;
  double force_share = 0.7;
};

std::string axes_of(const CalibrationPlan& plan) {
  std::string names;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (plan.axes[axis]) names += "xyz"[axis];
  return names;
}

std::string announcement(const CalibrationPlan& plan, const DeviceInfo& info, const SafetyLimits& limits) {
  const std::string places = plan.places.empty() ? ""
                                                 : fmt::format(", and visits {} places around it, {:.0f} mm away",
                                                               plan.places.size(), 1e3 * farthest_place(plan));
  return fmt::format(
      "calibrating {} for about {:.0f} s{}: it moves to the centre of its workspace, swings around it, sweeps along "
      "each axis ({}){}{}\n"
      "  it is led at most {:.0f} mm from the centre and at {:.2f} m/s; an excitation signal of up to {:.1f} N rms per "
      "axis adds to both\n"
      "  limits: {:.1f} N; the session stops {:.0f} mm beside that movement{}\n"
      "  {}\n"
      "  if it does not respond like a mass, it then follows a small circle for up to half a minute\n"
      "  hold it loosely, as in later sessions, and let it move; Ctrl+C ends the calibration at any time",
      info.name, plan.duration + 1,
      plan.places.empty() ? "" : ", then trying laws, a quarter of a minute each, with pauses while the motors cool",
      axes_of(plan), places, plan.pulses ? ", and ends with strokes along each axis under pulses of force" : "",
      1e3 * std::max(farthest_place(plan) + 0.5 * plan.reach.maxCoeff(), plan.reach.maxCoeff()), plan.max_speed,
      plan.max_dither, plan.max_force, 1e3 * plan.max_deviation,
      limits.max_velocity > 0 ? fmt::format(", and above {:.1f} m/s", limits.max_velocity) : "",
      plan.places.empty() ? "the laws are not tried afterwards"
                          : "afterwards it follows small circles at these places, under two laws or more");
}

/// Returns false if a stop was requested meanwhile.
bool count_down(const Output& output, const StopRequest& stop) {
  for (int left = kCountdown; left > 0; --left) {
    output.remark(fmt::format("starts in {} s", left));
    for (int part = 0; part < 20; ++part) {
      if (stop.count() > 0) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  }
  return stop.count() == 0;
}

std::string row(const char* name, const char* unit, const CalibrationPlan& plan, const Vec3& value, const Vec3& half,
                int digits) {
  std::string text = fmt::format("  {:<18}", name);
  for (int axis = 0; axis < 3; ++axis)
    text += plan.axes[static_cast<std::size_t>(axis)] && (value[axis] != 0 || half[axis] != 0)  // otherwise unknown
                ? fmt::format("  {:>7.{}f} +- {:<6.{}f}", value[axis], digits, half[axis], digits)
                : fmt::format("  {:>17}", "-");
  return text + "  " + unit + "\n";
}

std::string text_of(const LawVerdict& verdict) {
  if (!verdict.tried) return "not tried";
  if (!verdict.refused.empty()) return "refused: " + verdict.refused;
  if (!(verdict.improvement > 0)) return "calm over the workspace, where the force did not suffice for a comparison";
  return verdict.improvement < kHardly
             ? fmt::format("hardly closer than PD at some place of the workspace ({:.2f} times)", verdict.improvement)
             : fmt::format("at least {:.1f} times closer than PD over the workspace", verdict.improvement);
}

/// Returns the first requirements that a search could not meet, a line each, and how many more there are.
std::string unmet_text(const std::vector<std::string>& unmet) {
  constexpr std::size_t kMost = 3;
  std::string text;
  for (std::size_t i = 0; i < std::min(unmet.size(), kMost); ++i) text += fmt::format("    {}\n", unmet[i]);
  if (unmet.size() > kMost)
    text += fmt::format("    and {} more like these, which the profile lists\n", unmet.size() - kMost);
  return text;
}

std::string text_of(const HeldDevice& held) {
  const char* known = held.hand == HandKnown::identified ? "identified"
                      : held.hand == HandKnown::nobody   ? "nobody holds the device; some hand is assumed"
                                                         : "not seen in the response; a relaxed one is assumed";
  std::string text = fmt::format("  hand: {}\n", known);
  const auto three = [](const auto& value) {
    return fmt::format("{:.3g}, {:.3g}, {:.3g}", value(0), value(1), value(2));
  };
  if (held.inertia) {
    const auto range = [&](int i) {
      return fmt::format("{:.0f} to {:.0f} %", 100 * held.inertia->least[i], 100 * held.inertia->most[i]);
    };
    text += fmt::format("  the mass varies over the workspace, from that in the middle to: {}, {}, {}\n", range(0),
                        range(1), range(2));
  }
  if (const HandNoise& noise = held.model.noise; noise.tremor > 0)
    text += fmt::format("    it trembles with {:.2f} +- {:.2f} N rms per axis at {:.0f} Hz\n", noise.tremor,
                        held.half_width.noise.tremor, noise.tremor_hz);
  const auto& hand = held.model.hand;
  text += fmt::format("    mass {} kg; grip {} N/m, {} N s/m\n",
                      three([&](int i) { return hand.at(static_cast<std::size_t>(i)).mass; }),
                      three([&](int i) { return hand.at(static_cast<std::size_t>(i)).grip_stiffness; }),
                      three([&](int i) { return hand.at(static_cast<std::size_t>(i)).grip_damping; }));
  for (const Firmness firmness : kFirmnesses) {
    const LqgDesign& design = held.design(firmness);
    const LawVerdict& verdict = design.verdict;
    text += fmt::format("  --firmness {}: predicted error {:.3f} mm and force ripple {:.2f} N rms; {}\n",
                        to_string(firmness), 1e3 * design.figures.error, design.figures.ripple, text_of(verdict));
    text += unmet_text(design.unmet);
  }
  return text;
}

std::string text_of(const ActuatorFriction& actuators) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const auto three = [](const auto& v) { return fmt::format("{:.2f}, {:.2f}, {:.2f}", v[0], v[1], v[2]); };
  const Eigen::Matrix3d& r = actuators.axes;
  return fmt::format(
      "  actuators' axes: turned by {:.0f} +- {:.0f} degrees, along ({}), ({}), ({})\n"
      "    friction along them {} +- {} N\n",
      kDegrees * Eigen::AngleAxisd(r).angle(), kDegrees * actuators.angle_half, three(r.row(0)), three(r.row(1)),
      three(r.row(2)), three(actuators.coulomb), three(actuators.coulomb_half));
}

std::string text_of(const Cogging& cogging) {
  std::string text = "  cogging, a force that repeats over the place:\n";
  for (const CoggingWave& wave : cogging.waves) {
    const double length = wave.wave_number.norm();
    const Vec3 along = wave.wave_number / length;
    text += fmt::format("    {:.2f} +- {:.2f} N every {:.3f} mm along ({:.3f}, {:.3f}, {:.3f})\n", wave.amplitude(),
                        wave.amplitude_half, 1e3 * kTwoPi / length, along.x(), along.y(), along.z());
  }
  return text;
}

std::string table(const CalibrationPlan& plan, const CalibrationResult& result) {
  const PlantModel &plant = result.identification.plant, &half = result.identification.half_width;
  std::string text = fmt::format("  {:<18}  {:<17}  {:<17}  {:<17}\n", "95 % intervals", "x", "y", "z");
  text += row("mass", "kg", plan, plant.mass, half.mass, 3);
  text += row("friction", "N", plan, plant.coulomb, half.coulomb, 3);
  text += row("viscous damping", "N s/m", plan, plant.viscous, half.viscous, 2);
  text += row("gravity", "N", plan, plant.gravity, half.gravity, 2);
  text += row("gravity gradient", "N/m", plan, plant.gravity_gradient.diagonal(), half.gravity_gradient.diagonal(), 1);
  text += fmt::format("  delay {:.2f} +- {:.2f} ms; position resolution {:.4f} mm, noise {:.4f} mm\n",
                      1e3 * plant.delay, 1e3 * half.delay, 1e3 * plant.position_resolution, 1e3 * plant.position_noise);
  if (plant.actuators) text += text_of(*plant.actuators);
  if (plant.cogging) text += text_of(*plant.cogging);
  if (result.motors.force > 0)
    text += fmt::format("  the motors give at most {:.2f} +- {:.2f} N, of the {:.2f} N that were tried\n",
                        result.motors.force, result.motors.half_width, result.motors.tried);
  else if (result.motors.tried > 0)
    text += fmt::format("  no limit of the motors was found up to {:.2f} N, the largest force that was tried\n",
                        result.motors.tried);
  text += fmt::format("  not explained by the model: {:.0f} % of the {}, {:.3f} N rms in the sweeps\n",
                      100 * result.identification.line_residual,
                      result.identification.coarse ? "force" : "response to the excitation",
                      result.identification.sweep_residual);
  if (!result.design) return text;
  const TrackingDesign& design = *result.design;
  const auto gains = [](const char* name, const Vec3& kp, const Vec3& kd) {
    return fmt::format("  {}: kp {:.0f}, {:.0f}, {:.0f} N/m; kd {:.1f}, {:.1f}, {:.1f} N s/m\n", name, kp.x(), kp.y(),
                       kp.z(), kd.x(), kd.y(), kd.z());
  };
  if (result.identification.coarse) {
    text += fmt::format("  coarse: {}. The model therefore covers slow movement only (to 20 Hz).\n", result.doubt);
    text += result.bandwidth > 0
                ? fmt::format(
                      "  A trial on a small circle was stable, with a margin, at {:.0f} % of its bandwidth;\n"
                      "  playback is less accurate than usual. Over the workspace: {}\n",
                      100 * result.bandwidth, text_of(design.verdict))
                : fmt::format("  The law with an observer passed no trial on a small circle: {}.\n",
                              design.verdict.refused);
  }
  if (result.held) text += text_of(*result.held);
  text += gains("gains", design.gains.kp, design.gains.kd);
  text += gains("largest stable gains", design.largest.kp, design.largest.kd);
  if (design.plain_calm || design.verdict.tried || (result.held && result.held->design(Firmness::normal).verdict.tried))
    text += gains(design.plain_calm ? "PD control that it was compared with, calm"
                                    : "PD control that it was compared with, not calm",
                  design.plain.kp, design.plain.kd);
  if (const std::string closer = stiff_text(design); !closer.empty()) text += "  " + closer + "\n";
  return text;
}

/// Returns the options of the session. Throws Error(input) if one is missing or contradicts another.
CalibrationOptions options_of(const CLI::App& verb, const CalibrateArguments& arguments) {
  require(verb, "--device");
  if (arguments.quick && arguments.full) throw input_error("--quick and --full exclude each other");
  return {.full = arguments.full,
          .places = !arguments.quick,
          .force_share = arguments.force_share,
          .session = arguments.session.options(arguments.record, effective_config(verb))};
}

/// Returns true if the session runs on the real clock.
bool is_real(const CalibrationOptions& options, const DeviceInfo& device) {
  return options.session.clock == ClockChoice::real ||
         (options.session.clock == ClockChoice::automatic && !device.virtual_time);
}

/// The file of the profile: the given one, or that of the device in the profile folder, which is replaced.
struct ProfileFile {
  std::string name;
  bool overwrite;

  ProfileFile(const CalibrateArguments& arguments, const DeviceInfo& device)
      : name(arguments.output.empty() ? profile_file(identity_of(device)) : arguments.output),
        overwrite(arguments.output.empty() || arguments.session.overwrite) {}

  /// Stores the profile, and names the file in `json`. The results of the calibration stay valid if that fails: then
  /// reports it and returns false.
  bool save(const DeviceProfile& profile, nlohmann::json& json, const Output& output) const {
    try {
      save_profile(profile, name, overwrite);
      json["profile_file"] = name;
      return true;
    } catch (const Error& error) {
      json["error"] = error.what();
      output.remark(fmt::format("{}; the profile was not saved", error.what()));
      return false;
    }
  }
};

/// Runs the verb and returns its exit code.
int calibrate_command(const CLI::App& verb, const CalibrateArguments& arguments, const Output& output) {
  CalibrationOptions options = options_of(verb, arguments);
  const Signals signals;
  const auto device = arguments.session.open();
  const DeviceInfo& info = device->info();
  const ProfileFile file(arguments, info);
  check_profile_output(file.name, file.overwrite);
  const CalibrationPlan plan = plan_calibration(info, options);
  note_limits(output, options.session, info);
  note_before(output, options.session, "device", info.notes);
  output.remark(announcement(plan, info, options.session.loop.limits));

  if (is_real(options, info) && !arguments.yes && !count_down(output, signals.stop())) {
    output.remark("interrupted before anything moved");
    return kInterrupted;
  }
  ReadProgress search(output, "searching laws");
  options.searching = search.share_callback();
  const CalibrationResult result = calibrate(*device, options, signals.stop(), progress_bar(output, plan.duration + 1));
  int code = conclude(output, result.session);
  nlohmann::json json = to_json(result.session);
  json["notes"] = info.notes;
  if (!arguments.record.empty()) json["file"] = arguments.record;
  if (!result.succeeded()) {
    json["error"] = result.reason;
    if (code == kDone) code = kStopped;
    output.fault(result.reason + "; no profile was written");
    output.tell(json, session_summary(result.session));
    return code;
  }
  const DeviceProfile profile = profile_of(info, result, options.session.loop.rate_hz);
  json["profile"] = to_json(profile);
  json["tried_force_n"] = result.motors.tried;
  const bool saved = file.save(profile, json, output);
  if (!saved && code == kDone) code = kStopped;
  output.tell(json,
              fmt::format("{}: calibrated\n{}{}{}", info.name, table(plan, result), session_summary(result.session),
                          saved ? fmt::format("  the profile is in {}\n", file.name) : ""));
  return code;
}

}  // namespace

Verb add_calibrate(CLI::App& app) {
  const auto arguments = std::make_shared<CalibrateArguments>();
  CLI::App* verb = app.add_subcommand("calibrate", "identify a device's dynamics and compute gains for it");
  verb->footer(
      "The device moves by itself. The result is a profile; without -o, it is written to the profile folder\n"
      "($HAPTRACE_PROFILES, $XDG_DATA_HOME/haptrace/profiles or ~/.local/share/haptrace/profiles).\n"
      "  haptrace calibrate -d falcon\n"
      "  haptrace calibrate -d sim:preset=omega3,hand=relaxed --full -o omega3.json --record calibration.h5");
  verb->add_option("-o,--output", arguments->output, "profile to write (default: in the profile folder)")
      ->type_name("FILE.json");
  verb->add_flag("--quick", arguments->quick, "measure in the middle of the workspace only, for about ten seconds");
  verb->add_flag("--full", arguments->full,
                 "measure there for half a minute instead of ten seconds, and try every firmness");
  verb->add_option("--force-share", arguments->force_share,
                   "force limit as a share of the device's largest force, 0.1 to 1")
      ->capture_default_str()
      ->group("Safety");
  verb->add_flag("-y,--yes", arguments->yes, "start at once, without a countdown")->group("Safety");
  verb->add_option("--record", arguments->record, "write a recording of the session")->type_name("OUT.h5");
  arguments->session.add_to(*verb);

  return {verb, [verb, arguments](const Output& output) { return calibrate_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
