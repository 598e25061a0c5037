#include "base/error.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
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

struct StabilityArguments {
  std::string device, profile, velocity = "lowpass:100";
  double rate_hz = 1000;
  std::optional<double> kp, kd;
  std::size_t ensemble = 0, jobs = 0;
  std::uint64_t seed = 1, first = 0;
  int learn = 5;
  std::vector<std::string> paths;
  std::string scene, output, figure;
  bool guidance = false, staircase = false, overwrite = false;
};

/// What the verb finds out, part by part.
struct Findings {
  nlohmann::json json = nlohmann::json::object();
  std::string text;
  Figure figure;
  bool complete = true, failed = false;

  void draw(const Figure& part) {
    if (figure.rows.empty()) {
      figure = part;
      return;
    }
    figure.rows.insert(figure.rows.end(), part.rows.begin(), part.rows.end());
    figure.caption += figure.caption.empty() ? part.caption : "  " + part.caption;
    figure.width = std::max(figure.width, part.width);
    figure.height += part.height;
  }
};

/// What would be refused in the end is refused before the work.
void check_names(const StabilityArguments& arguments) {
  if (!arguments.figure.empty()) check_figure_name(arguments.figure);
  for (const std::string& file : {arguments.output, arguments.figure}) check_output(file, arguments.overwrite);
}

std::string time_left(double seconds) {
  if (!std::isfinite(seconds)) return "";
  return seconds < 100 ? fmt::format(", {:.0f} s left", seconds) : fmt::format(", {:.0f} min left", seconds / 60);
}

std::string text_of(const StabilityMap& map, const std::string& device) {
  const auto verdict = [](bool yes) { return yes ? "yes" : "no"; };
  std::string text = fmt::format(
      "{}: a PD law of {:.0f} N/m and {:.1f} N s/m along {}, where it has least margin\n"
      "  passive {}, stable by analysis {}, in simulation {}, with friction and quantum {}\n",
      device, map.present.kp, map.present.kd, "xyz"[map.axis], verdict(map.at_present.passive),
      verdict(map.at_present.stable), verdict(map.at_present.simulated), verdict(map.at_present.simulated_fully));
  text += fmt::format("  margins: gain {:.1f} times, phase {:.0f} degrees, delay {:.2f} ms, modulus {:.2f}\n",
                      map.margins.gain_up, map.margins.phase * 180 / std::numbers::pi, 1e3 * map.margins.delay,
                      map.margins.modulus);
  if (map.suggested.kp > 0)
    text += fmt::format("  stiffest with modulus {:.1f} and gain {:.0f}: {:.0f} N/m and {:.1f} N s/m\n",
                        map.floor.modulus, map.floor.gain, map.suggested.kp, map.suggested.kd);
  return text;
}

/// The map of what calibration found out about the device; nothing moves.
void map_gains(const StabilityArguments& arguments, const Output& output, const StopRequest& stop, Findings& findings) {
  const auto device = open_device(arguments.device);
  const DeviceInfo& info = device->info();
  const auto profile = profile_for(info, arguments.profile, arguments.rate_hz, output);
  if (!profile)
    throw input_error(fmt::format("nobody knows yet what {} bears; calibrate it: haptrace calibrate --device {}",
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
  findings.draw(figure_of(*map));
}

std::function<void(const EnsembleProgress&)> telling(ReadProgress& progress) {
  return [&progress](const EnsembleProgress& p) {
    progress.tell_share(static_cast<double>(p.done) / static_cast<double>(p.draws),
                        fmt::format("{} of {} draws{}", p.done, p.draws, time_left(p.remaining)));
  };
}

void try_ensemble(const StabilityArguments& arguments, const Output& output, const StopRequest& stop,
                  Findings& findings) {
  EnsembleOptions options{.seed = arguments.seed,
                          .first = arguments.first,
                          .draws = arguments.ensemble,
                          .learn = arguments.learn,
                          .threads = arguments.jobs};
  if (!arguments.paths.empty()) options.paths = ensemble_paths();
  for (const std::string& file : arguments.paths) options.paths.push_back(load_path(file));

  ReadProgress progress(output, "");
  const EnsembleReport report = run_ensemble(options, stop, telling(progress));
  findings.complete = report.members.size() == report.draws;
  findings.json["ensemble"] = to_json(report);
  findings.text += text_of(report);
  findings.draw(figure_of(report));
}

void try_guidance(const StabilityArguments& arguments, const Output& output, const StopRequest& stop,
                  Findings& findings) {
  GuidanceEnsembleOptions options{
      .seed = arguments.seed, .first = arguments.first, .draws = arguments.ensemble, .threads = arguments.jobs};
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
      throw input_error(device.where() + ": --staircase taps walls with a simulated device; give sim, or none");
    options.device = read_sim_device(device).spec;
  }
  ReadProgress progress(output, "");
  const StaircaseReport report = staircase(options, stop, progress.share_callback());
  findings.complete = report.complete;
  if (!report.complete) return;
  findings.json["staircase"] = to_json(report);
  findings.text += text_of(report);
  findings.draw(figure_of(report));
}

/// Throws Error(input) when the options do not fit each other.
void check_parts(const StabilityArguments& arguments) {
  if (arguments.staircase) {
    if (arguments.ensemble > 0 || arguments.guidance)
      throw input_error("--staircase is a measurement of its own; leave out --ensemble and --guidance");
    return;
  }
  if (!arguments.scene.empty()) throw input_error("--scene is what --staircase presses; give --staircase, too");
  if (arguments.device.empty() && arguments.ensemble == 0)
    throw input_error("nothing to do: give --device for a map of its gains, --ensemble N, or both; or --staircase");
  if (arguments.guidance && arguments.ensemble == 0)
    throw input_error("--guidance says what the ensemble is of; give --ensemble N, too");
  if (arguments.guidance && !arguments.figure.empty() && arguments.device.empty())
    throw input_error("--guidance draws no figure; its runs are in the JSON, see --output");
}

}  // namespace

Verb add_stability(CLI::App& app) {
  const auto arguments = std::make_shared<StabilityArguments>();
  CLI::App* verb = app.add_subcommand(
      "stability",
      "which gains a device bears, how exact and stable playback is on many random devices, and which walls bounce");
  verb->footer(
      "With --device: a map of the gains of a PD law, for the device as it was calibrated: where it is passive, "
      "stable\n"
      "by analysis with delay and zero-order hold, and stable in simulation. Nothing moves.\n"
      "With --guidance the ensemble is one of trainees: random hands that wander, stop, turn back, leave the tunnel, "
      "push\n"
      "against its walls and let go are guided along seven paths, at 250 Hz to 10 kHz, with up to 5 ms more delay. It\n"
      "fails (exit code 1) when one of them is given more energy than the budget allows, or oscillates.\n"
      "The ensemble: each random device, with the hand that holds it, is calibrated blind; then circle, square, "
      "script\n"
      "and further paths are played with plain PD, stiff and cautious, and by the calibrated player; then it is held,\n"
      "and driven with gains beyond what it bears. Everything in virtual time, reproducible from the seed.\n"
      "  haptrace stability --device falcon --figure map.png\n"
      "  haptrace stability --ensemble 200 -o stability.json --figure stability.png\n"
      "  haptrace stability --ensemble 1000 --guidance -o guidance.json\n"
      "  haptrace stability --ensemble 1 --first 137            the draw that stood out\n"
      "With --staircase: what energy a sampled wall creates when it is pressed, against rate and stiffness, beside the "
      "closed\n"
      "form; and on which walls a simulated device that falls on them comes to rest, without and with a passivity "
      "layer.\n"
      "  haptrace stability --staircase --figure staircase.png");
  verb->add_option("--device", arguments->device,
                   "whose gains to map, or what taps the wall (sim), NAME[:key=value,...]")
      ->type_name("D");
  verb->add_option("--profile", arguments->profile, "what calibration found out; without it, the device's own")
      ->type_name("FILE.json")
      ->group("Map");
  verb->add_option("--rate", arguments->rate_hz, "servo rate [Hz]")->capture_default_str()->group("Map");
  verb->add_option("--velocity", arguments->velocity, "velocity estimator of the PD law")
      ->capture_default_str()
      ->group("Map");
  verb->add_option("--kp", arguments->kp, "proportional gain to judge [N/m]; without it, the profile's for a PD law")
      ->group("Map");
  verb->add_option("--kd", arguments->kd, "derivative gain to judge [N s/m]")->group("Map");
  verb->add_option("--ensemble", arguments->ensemble, "random devices and hands to try")
      ->type_name("N")
      ->capture_default_str();
  verb->add_flag("--guidance", arguments->guidance, "try guidance on the ensemble, instead of playback");
  verb->add_flag("--staircase", arguments->staircase, "press a sampled wall, instead; needs no device")
      ->group("Staircase");
  verb->add_option("--scene", arguments->scene, "what to press; without it, walls of 100 N/m to 100 kN/m")
      ->type_name("FILE.json")
      ->group("Staircase");
  verb->add_option("--seed", arguments->seed, "of the ensemble")->capture_default_str();
  verb->add_option("--first", arguments->first, "index of the first draw")->capture_default_str();
  verb->add_option("--paths", arguments->paths, "further paths (CSV, HDF5), fitted into the workspace")
      ->type_name("FILE...");
  verb->add_option("--learn", arguments->learn, "learning repetitions of the calibrated player")->capture_default_str();
  verb->add_option("--jobs", arguments->jobs, "threads; 0: one for every core. Results do not depend on it")
      ->capture_default_str();
  verb->add_option("-o,--output", arguments->output, "where the JSON goes, too")->type_name("FILE.json");
  verb->add_option("--figure", arguments->figure, "picture, .png .svg or .pdf")->type_name("FILE");
  verb->add_flag("--overwrite", arguments->overwrite, "replace files that exist");

  return {verb, [arguments](const Output& output) {
            check_parts(*arguments);
            check_names(*arguments);
            const Signals signals;
            Findings findings;
            if (arguments->staircase)
              climb_staircase(*arguments, output, signals.stop(), findings);
            else if (!arguments->device.empty())
              map_gains(*arguments, output, signals.stop(), findings);
            if (arguments->ensemble > 0 && findings.complete)
              (arguments->guidance ? try_guidance : try_ensemble)(*arguments, output, signals.stop(), findings);

            if (!findings.complete) output.remark("interrupted; what was finished is told");
            if (!arguments->output.empty()) save_json(findings.json, arguments->output, arguments->overwrite);
            if (!arguments->figure.empty()) save_figure(findings.figure, arguments->figure, arguments->overwrite);
            output.tell(findings.json, findings.text);
            if (!findings.complete) return kInterrupted;
            return findings.failed ? kStopped : kDone;
          }};
}

}  // namespace haptrace::cli
