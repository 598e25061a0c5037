#include "base/error.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "base/units.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
#include "control/design/identification.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "studies/ensemble_report.h"
#include "studies/guidance_ensemble.h"
#include "studies/stability_map.h"
#include "studies/staircase.h"

#include <fmt/format.h>
#include <numbers>
#include <optional>

namespace haptrace::cli {
namespace {

/// The options of all four experiments; each experiment declares its own.
struct StabilityArguments {
  std::string device, profile, velocity = "lowpass:100";
  double rate_hz = 1000;
  std::optional<double> kp, kd;
  std::size_t draws = 100, jobs = 0;
  std::uint64_t seed = 1, first = 0;
  int learn = 5;
  std::vector<std::string> paths;
  std::string kinds, law, firmness;
  std::string scene, output, figure;
  bool overwrite = false;
};

/// The result of an experiment.
struct Findings {
  nlohmann::json json = nlohmann::json::object();
  std::string text;
  Figure figure;
  bool complete = true, failed = false;
};

std::string time_left(double seconds) {
  if (!std::isfinite(seconds)) return "";
  return fmt::format(", {} left", long_duration_text(seconds));
}

std::string text_of(const StabilityMap& map, const std::string& device) {
  const auto verdict = [](bool yes) { return yes ? "yes" : "no"; };
  std::string text = fmt::format(
      "{}: PD control of {:.0f} N/m and {:.1f} N s/m along {}, the axis with the smallest margin\n"
      "  passive: {}; stable by analysis: {}; in simulation: {}; in simulation with friction and encoder resolution: "
      "{}\n",
      device, map.present.kp, map.present.kd, "xyz"[map.axis], verdict(map.at_present.passive),
      verdict(map.at_present.stable), verdict(map.at_present.simulated), verdict(map.at_present.simulated_fully));
  text += fmt::format("  margins: gain {:.1f} times, phase {:.0f} degrees, delay {:.2f} ms, modulus {:.2f}\n",
                      map.margins.gain_up, map.margins.phase * 180 / std::numbers::pi, 1e3 * map.margins.delay,
                      map.margins.modulus);
  if (map.suggested.kp > 0)
    text += fmt::format(
        "  stiffest gains with a modulus margin of {:.1f} and a gain margin of {:.0f}: {:.0f} N/m and {:.1f} N s/m\n",
        map.floor.modulus, map.floor.gain, map.suggested.kp, map.suggested.kd);
  return text;
}

/// Maps the gains of a device from its profile; nothing moves.
void map_gains(const StabilityArguments& arguments, const Output& output, const StopRequest& stop, Findings& findings) {
  const auto device = open_device(arguments.device);
  const DeviceInfo& info = device->info();
  const auto profile = profile_for(info, arguments.profile, arguments.rate_hz, output);
  if (!profile)
    throw input_error(
        fmt::format("{} is not calibrated yet, so its stable gains are unknown; run haptrace calibrate --device {}",
                    info.model, info.name));
  PdGains gains = profile->design.plain;
  if (arguments.kp) gains.kp = Vec3::Constant(*arguments.kp);
  if (arguments.kd) gains.kd = Vec3::Constant(*arguments.kd);
  const std::optional<StabilityMap> map = [&] {
    ReadProgress progress(output, "");
    return stability_map(profile->plant, gains,
                         {.rate_hz = arguments.rate_hz, .velocity = arguments.velocity, .threads = arguments.jobs},
                         stop, progress.share_callback());
  }();
  findings.complete = map.has_value();
  if (!map) return;
  findings.json["device"] = info.name;
  findings.json["map"] = to_json(*map);
  findings.text += text_of(*map, info.name);
  findings.figure = figure_of(*map);
}

std::function<void(const EnsembleProgress&)> telling(ReadProgress& progress) {
  return [&progress](const EnsembleProgress& p) {
    progress.tell_share(static_cast<double>(p.done) / static_cast<double>(p.draws),
                        fmt::format("{} of {} draws{}", p.done, p.draws, time_left(p.remaining)));
  };
}

constexpr const char* kHardKinds = "hard";

void try_ensemble(const StabilityArguments& arguments, const Output& output, const StopRequest& stop,
                  Findings& findings) {
  EnsembleOptions options{.seed = arguments.seed,
                          .first = arguments.first,
                          .draws = arguments.draws,
                          .learn = arguments.learn,
                          .threads = arguments.jobs};
  if (!arguments.law.empty()) options.law = parse_tracking_law(arguments.law);
  if (!arguments.firmness.empty()) options.firmness = parse_firmness(arguments.firmness);
  if (!arguments.paths.empty()) options.paths = ensemble_paths();
  for (const std::string& file : arguments.paths) options.paths.push_back(load_path(file));

  const auto run = [&](const char* key) {
    ReadProgress progress(output, options.kinds.size() > 1 ? kHardKinds : to_string(options.kinds.front()));
    const EnsembleReport report = run_ensemble(options, stop, telling(progress));
    findings.complete = findings.complete && report.members.size() == report.draws;
    findings.json[key] = to_json(report);
    findings.text += text_of(report);
    if (findings.figure.rows.empty()) findings.figure = figure_of(report);
  };
  const bool both = arguments.kinds.empty(), hard = arguments.kinds == kHardKinds;
  if (!both && !hard) options.kinds = {parse_ensemble_kind(arguments.kinds)};
  if (!hard) run("ensemble");
  if ((!both && !hard) || stop.count() > 0) return;
  options.kinds = hard_kinds();
  run("hard_ensemble");
}

void try_guidance(const StabilityArguments& arguments, const Output& output, const StopRequest& stop,
                  Findings& findings) {
  GuidanceEnsembleOptions options{
      .seed = arguments.seed, .first = arguments.first, .draws = arguments.draws, .threads = arguments.jobs};
  if (!arguments.paths.empty()) options.paths = guidance_paths();
  for (const std::string& file : arguments.paths) options.paths.push_back(load_path(file));

  ReadProgress progress(output, "");
  const GuidanceReport report = run_guidance_ensemble(options, stop, telling(progress));
  findings.complete = report.members.size() == report.draws;
  findings.failed = report.failures() > 0;
  findings.json["guidance"] = to_json(report);
  findings.text += text_of(report);
}

void climb_staircase(const StabilityArguments& arguments, const Output& output, const StopRequest& stop,
                     Findings& findings) {
  StaircaseOptions options{.seed = arguments.seed, .threads = arguments.jobs};
  if (!arguments.scene.empty()) {
    options.scene = load_json(arguments.scene);
    options.scene_name = arguments.scene;
  }
  if (!arguments.device.empty()) {
    const DeviceSpec device = DeviceSpec::parse(arguments.device);
    if (device.name != "sim")
      throw input_error(device.where() + ": the staircase needs a simulated device; give sim, or no device");
    options.device = read_sim_device(device).spec;
  }
  ReadProgress progress(output, "");
  const StaircaseReport report = staircase(options, stop, progress.share_callback());
  findings.complete = report.complete;
  if (!report.complete) return;
  findings.json["staircase"] = to_json(report);
  findings.text += text_of(report);
  findings.figure = figure_of(report);
}

using Experiment = void (*)(const StabilityArguments&, const Output&, const StopRequest&, Findings&);

int run_experiment(Experiment experiment, const StabilityArguments& arguments, const Output& output) {
  // Reject an invalid output before the work, not after it.
  if (!arguments.figure.empty()) check_figure_name(arguments.figure);
  for (const std::string& file : {arguments.output, arguments.figure}) check_output(file, arguments.overwrite);
  const Signals signals;
  Findings findings;
  experiment(arguments, output, signals.stop(), findings);
  if (!findings.complete) output.remark("interrupted; the results cover only the finished part");
  if (!arguments.output.empty()) save_json(findings.json, arguments.output, arguments.overwrite);
  if (!arguments.figure.empty() && !findings.figure.rows.empty())
    save_figure(findings.figure, arguments.figure, arguments.overwrite);
  output.tell(findings.json, findings.text);
  if (!findings.complete) return kInterrupted;
  return findings.failed ? kStopped : kDone;
}

using SharedArguments = std::shared_ptr<StabilityArguments>;

/// Adds an experiment with the options that all experiments share.
Verb add_experiment(CLI::App& parent, const char* name, const char* description, const char* footer, bool draws_figure,
                    const SharedArguments& arguments, Experiment experiment) {
  CLI::App* verb = parent.add_subcommand(name, description);
  verb->footer(footer);
  verb->add_option("-o,--output", arguments->output, "also write the JSON to this file")->type_name("FILE.json");
  if (draws_figure)
    verb->add_option("--figure", arguments->figure, "draw the result: .png, .svg or .pdf")->type_name("FILE");
  verb->add_flag("--overwrite", arguments->overwrite, "replace existing files");
  verb->add_option("--jobs", arguments->jobs,
                   "number of threads (0: one for every core); the results do not depend on it")
      ->capture_default_str();
  return {verb, [=](const Output& output) { return run_experiment(experiment, *arguments, output); }};
}

void add_draws(CLI::App& verb, const SharedArguments& arguments) {
  verb.add_option("--draws", arguments->draws, "number of random devices and hands")
      ->type_name("N")
      ->capture_default_str();
  verb.add_option("--first", arguments->first, "index of the first draw")->capture_default_str();
  verb.add_option("--paths", arguments->paths, "further paths (CSV, HDF5), fitted into the workspace")
      ->type_name("FILE...");
}

void add_seed(CLI::App& verb, const SharedArguments& arguments) {
  verb.add_option("--seed", arguments->seed, "seed of the random draws")->capture_default_str();
}

Verb add_map(CLI::App& parent) {
  const auto arguments = std::make_shared<StabilityArguments>();
  Verb verb = add_experiment(parent, "map", "map the gains for which a calibrated device is passive and stable",
                             "  haptrace stability map -d falcon --figure map.png\n"
                             "The map shows where PD control of the profiled device is passive, stable by analysis "
                             "with delay and zero-order hold, and stable in simulation. The device does not move.",
                             true, arguments, map_gains);
  verb.app->add_option("-d,--device", arguments->device, "calibrated device")->type_name("NAME[:...]");
  verb.app->add_option("--profile", arguments->profile, "device profile from calibrate (default: the stored one)")
      ->type_name("FILE.json");
  verb.app->add_option("--rate", arguments->rate_hz, "servo rate [Hz]")->capture_default_str();
  verb.app->add_option("--velocity", arguments->velocity, "velocity estimator of the PD control")
      ->capture_default_str();
  verb.app->add_option("--kp", arguments->kp, "proportional gain to evaluate [N/m] (default: the profile's)");
  verb.app->add_option("--kd", arguments->kd, "derivative gain to evaluate [N s/m] (default: the profile's)");
  const auto run = std::move(verb.run);
  verb.run = [run, app = verb.app](const Output& output) {
    require(*app, "--device");
    return run(output);
  };
  return verb;
}

Verb add_ensemble(CLI::App& parent) {
  const auto arguments = std::make_shared<StabilityArguments>();
  Verb verb =
      add_experiment(parent, "ensemble", "measure playback on many random devices and hands",
                     "  haptrace stability ensemble --draws 200 -o stability.json --figure stability.png\n"
                     "  haptrace stability ensemble --draws 1 --first 137     repeats one draw\n"
                     "Each random device is calibrated in the hand that holds it, without knowledge of its parameters. "
                     "Then circle, square, script and further paths are played with stiff PD, with cautious PD, and by "
                     "the calibrated player. Then the device holds its position, and is driven with gains beyond its "
                     "stable range. Time is virtual; the seed determines every result. The figure shows the first "
                     "ensemble that was run.",
                     true, arguments, try_ensemble);
  add_draws(*verb.app, arguments);
  add_seed(*verb.app, arguments);
  verb.app->add_option("--learn", arguments->learn, "learning repetitions of the calibrated player")
      ->capture_default_str();
  verb.app
      ->add_option("--kinds", arguments->kinds,
                   fmt::format("devices to draw: hard (late, varying, elastic, weak or shaken ones), or one kind: {} "
                               "(default: small, then hard)",
                               fmt::join(ensemble_kind_names(), " | ")))
      ->type_name("KIND");
  verb.app->add_option("--law", arguments->law, "law of the calibrated player: lqg | observer (default: as play)");
  verb.app->add_option("--firmness", arguments->firmness, "design of its LQG law: quiet | normal | exact");
  return verb;
}

Verb add_guidance(CLI::App& parent) {
  const auto arguments = std::make_shared<StabilityArguments>();
  Verb verb = add_experiment(
      parent, "guidance", "measure the safety of guidance on many random trainees",
      "  haptrace stability guidance --draws 1000 -o guidance.json\n"
      "Random hands that wander, stop, turn back, leave the tunnel, push against its walls and let go are guided along "
      "seven paths, at 250 Hz to 10 kHz, with up to 5 ms of additional delay. The experiment fails (exit code 1) if a "
      "hand is given more energy than the budget allows, or oscillates.",
      false, arguments, try_guidance);
  add_draws(*verb.app, arguments);
  add_seed(*verb.app, arguments);
  return verb;
}

Verb add_staircase(CLI::App& parent) {
  const auto arguments = std::make_shared<StabilityArguments>();
  Verb verb = add_experiment(parent, "staircase", "measure the energy that sampled walls create",
                             "  haptrace stability staircase --figure staircase.png\n"
                             "Presses a sampled wall and compares the energy that it creates, against rate and "
                             "stiffness, with the closed form. Then lets a simulated device fall on walls, without and "
                             "with a passivity layer, and reports the walls on which it comes to rest.",
                             true, arguments, climb_staircase);
  verb.app->add_option("-d,--device", arguments->device, "simulated device that taps the wall")->type_name("sim[:...]");
  verb.app->add_option("--scene", arguments->scene, "scene to press (default: walls of 100 N/m to 100 kN/m)")
      ->type_name("FILE.json");
  add_seed(*verb.app, arguments);
  return verb;
}

}  // namespace

std::vector<Verb> add_stability(CLI::App& app) {
  CLI::App* verb = app.add_subcommand("stability", "measure stability and accuracy: gains, many devices, walls");
  verb->footer("");
  std::vector<Verb> verbs{add_map(*verb), add_ensemble(*verb), add_guidance(*verb), add_staircase(*verb)};
  for (const Verb& experiment : verbs) experiment.app->group("Experiments");
  return verbs;
}

}  // namespace haptrace::cli
