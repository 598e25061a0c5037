#include "base/error.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "cli/input_options.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "player/calibration/calibration.h"
#include "scene/scene_file.h"
#include "studies/trade/physics.h"
#include "studies/trade/scene_trade.h"
#include "studies/trade/stand_in.h"
#include "studies/trade/trade_report.h"

#include <filesystem>
#include <fmt/format.h>

namespace haptrace::cli {
namespace {

constexpr double kLongestTried = 30;  // longest part of a path to play [s]
constexpr double kUnseenError = 0.2;  // assumed relative error of a result if all runs are equal

struct TradeoffArguments {
  std::string path, device, budget, output, figure, save, scene, scene_budget;
  ProfileArguments profile;
  PathSelection selection;
  CsvOptions csv;
  Configuration base;
  std::string interpolation = "cubic";
  int learn = 5;
  bool fit = false, explain = false, overwrite = false, no_instructions = false;
  std::optional<double> smoothing;
  double max_deviation = 0.03;
  std::size_t runs = 3, jobs = 0;
  std::uint64_t seed = 1;
  std::vector<double> rates;
};

/// Files that the verb writes.
struct TradeFiles {
  std::string json, figure, config, profile, scene;
};

std::string beside(const std::string& file, const std::string& ending) {
  std::filesystem::path path(file);
  return path.replace_filename(path.stem().string() + ending).string();
}

TradeFiles files_of(const TradeoffArguments& arguments) {
  TradeFiles files{
      .json = arguments.output, .figure = arguments.figure, .config = arguments.save, .profile = "", .scene = ""};
  if (files.figure.empty() && !files.json.empty()) files.figure = beside(files.json, ".png");
  if (!arguments.budget.empty() && files.config.empty())
    files.config = beside(files.json.empty() ? std::filesystem::path(arguments.path).filename().string() : files.json,
                          "-config.json");
  if (!files.config.empty()) files.profile = beside(files.config, "-profile.json");
  if (!arguments.scene_budget.empty())
    files.scene = beside(!files.json.empty()     ? files.json
                         : !files.config.empty() ? files.config
                                                 : std::filesystem::path(arguments.scene).filename().string(),
                         "-scene.json");
  if (!files.figure.empty()) check_figure_name(files.figure);
  std::vector<std::string> names;
  for (const std::string& file : {files.json, files.figure, files.config, files.profile, files.scene}) {
    if (file.empty()) continue;
    if (std::find(names.begin(), names.end(), file) != names.end())
      throw input_error(file + ": two output files have this name; give --output, --figure and --save different names");
    names.push_back(file);
    check_output(file, arguments.overwrite);
  }
  return files;
}

/// Returns the part of a path, at most kLongestTried long, with the most movement.
std::shared_ptr<const PathSource> busiest(std::shared_ptr<const PathSource> source, const Output& output) {
  if (source->facts().duration() <= kLongestTried) return source;
  Path path = source->read(0, source->facts().rows);
  path.name = source->facts().name;
  double moved = 0, most = -1;
  std::size_t first = 0, best = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    moved += (path.position[i] - path.position[i - 1]).norm();
    for (; path.time[i] - path.time[first] > kLongestTried; ++first)
      moved -= (path.position[first + 1] - path.position[first]).norm();
    if (moved > most) {
      most = moved;
      best = first;
    }
  }
  const double from = path.time[best];
  output.remark(
      fmt::format("{} lasts {:.0f} s; only the {:.0f} s from {:.2f} s on, which have the most movement, are played",
                  path.name, source->facts().duration(), kLongestTried, from));
  return source_of(std::move(path), {.from = from, .to = from + kLongestTried});
}

/// Identifies a virtual device as `calibrate` does.
std::optional<DeviceProfile> calibrated_here(Device& device, const Output& output, const StopRequest& stop) {
  const DeviceInfo& info = device.info();
  output.remark(fmt::format("{} is not calibrated; it is calibrated now, in virtual time", info.name));
  const CalibrationOptions options{.session = {.loop = {.limits = {.max_velocity = 1.5}}}};
  const CalibrationResult result = calibrate(device, options, stop);
  if (!result.succeeded()) {
    output.remark(result.reason + "; only PD control is tried");
    return std::nullopt;
  }
  return profile_of(info, result, options.session.loop.rate_hz);
}

/// Returns the device's own seed, to which the seed of each run is added.
std::uint64_t read_own_seed(const DeviceSpec& spec) {
  return spec.name == "sim" && spec.options.contains("seed") ? read_sim_device(spec).options.seed : 0;
}

Workplace workplace(const TradeoffArguments& arguments, const Output& output, const StopRequest& stop) {
  DeviceSpec spec = DeviceSpec::parse(arguments.device);
  // Each run has another seed, added to the device's own: a budget that holds for one hand may not hold for the next.
  const bool seeded = spec.name == "sim";
  const std::uint64_t own_seed = read_own_seed(spec);
  const auto open = [spec, seeded, own_seed](std::uint64_t seed) {
    DeviceSpec one = spec;
    if (seeded) one.options["seed"] = std::to_string(own_seed + seed);
    return open_device(one);
  };
  Workplace place{.open = open, .path = {}, .profile = {}, .play = {}, .seed = arguments.seed};
  const auto device = open(arguments.seed);
  const DeviceInfo info = device->info();
  for (const std::string& note : info.notes) output.remark(note);
  place.varies = seeded || !info.virtual_time;
  if (!place.varies) {
    place.model_error = kUnseenError;
    output.remark(fmt::format(
        "every run of this device is the same, so the runs give no confidence interval; +-{:.0f} % is assumed",
        100 * kUnseenError));
  }
  place.profile = arguments.profile.find(info, arguments.base.rate_hz, output);
  if (!place.profile && !arguments.profile.none && info.virtual_time)
    place.profile = calibrated_here(*device, output, stop);
  if (!info.virtual_time) {
    if (!place.profile)
      throw input_error(fmt::format(
          "the dynamics of {} are unknown; calibrate it first: haptrace calibrate --device {}", info.model, info.name));
    output.remark(
        fmt::format("{} does not move: its profile is simulated, in a relaxed hand; the intervals include +-{:.0f} % "
                    "for effects that the model leaves out",
                    info.model, 100 * kStandInError));
    if (!(info.max_force > 0))
      output.remark(fmt::format("{} does not state its largest force; {:g} N is assumed", info.model, kUnstatedForce));
    place.device_in_tick = false;
    place.model_error = kStandInError;
    place.open = [info, profile = *place.profile](std::uint64_t seed) { return stand_in(info, profile, seed); };
  }
  {
    ReadProgress progress(output, arguments.path);
    place.path = busiest(open_path(arguments.path, arguments.selection, progress.callback(), arguments.csv), output);
  }
  place.play.fit = arguments.fit;
  place.play.smoothing = arguments.smoothing;
  place.play.playback.max_deviation = arguments.max_deviation;
  place.play.session.loop.limits.max_velocity = 1.5;
  return place;
}

Configuration base_of(const TradeoffArguments& arguments, bool calibrated) {
  Configuration base = arguments.base;
  base.interpolation = parse_interpolation(arguments.interpolation);
  if (!calibrated) return base;
  base.with = {.inertia = true, .gravity = true, .friction = true, .observer = true};
  base.learn = arguments.learn;
  return base;
}

/// Returns the requested rates, or those of `all` that suit the device, and the base's rate.
std::vector<double> rates_of(const TradeoffArguments& arguments, const Workbench& bench,
                             const std::vector<double>& all) {
  std::vector<double> rates = arguments.rates;
  for (const double rate : rates) check_range("--rates", rate, kLowestRate, kHighestRate, "Hz");
  const double own = bench.device().nominal_rate;
  if (rates.empty())
    std::copy_if(all.begin(), all.end(), std::back_inserter(rates),
                 [&](double rate) { return bench.place().device_in_tick || !(own > 0) || rate <= own; });
  rates.push_back(arguments.base.rate_hz);
  std::sort(rates.begin(), rates.end());
  rates.erase(std::unique(rates.begin(), rates.end()), rates.end());
  return rates;
}

/// Leaves out each part of a simulated device's physics in turn. Returns nothing for other devices.
std::optional<Explanation> explain_simulation(const TradeoffArguments& arguments, const Workbench& bench,
                                              const Budget& budget, const TradeOptions& options,
                                              const StopRequest& stop) {
  const DeviceSpec device = DeviceSpec::parse(arguments.device);
  if (device.name != "sim") return std::nullopt;
  const SimParts parts = read_sim_device(device);
  const auto make = [&](const SimSpec& spec, std::uint64_t seed) -> std::unique_ptr<Device> {
    SimOptions one = parts.options;
    one.seed = read_own_seed(device) + seed;
    return std::make_unique<SimDevice>(spec, one);
  };
  // Learning would compensate for the part that is left out.
  Configuration configuration = options.base;
  configuration.learn = 0;
  return explain_physics(bench.place(), parts.spec, make, configuration, budget, options, stop);
}

SceneBench scene_bench(const TradeoffArguments& arguments, const Workbench& bench) {
  return {bench, arguments.base.rate_hz, [&] { return load_scene(arguments.scene); }, !arguments.no_instructions};
}

/// Chooses the settings of the scene that keep its budget, writes the scene with them, and reports both. Returns
/// whether they keep it.
bool keep_scene(const TradeoffArguments& arguments, const Workbench& bench, const std::string& file,
                const Output& output, const StopRequest& stop, nlohmann::json& json, std::string& text) {
  const SceneBudget budget = parse_scene_budget(arguments.scene_budget);
  const SceneBench measured = scene_bench(arguments, bench);
  if (!measured.touches()) return false;
  ReadProgress progress(output, "choosing settings of the scene");
  const SceneChoice choice = measured.choose(budget, stop);
  const std::string folder = std::filesystem::path(arguments.scene).parent_path().string();
  save_json(scene_with(load_json(arguments.scene), folder, choice.levels), file, arguments.overwrite);
  json["scene_choice"] = to_json(choice);
  json["scene_choice"]["file"] = file;
  text += text_of(choice, budget);
  text += fmt::format("    written to {}; use it: haptrace record felt.h5 --device {} --scene {}\n", file,
                      arguments.device, file);
  return choice.kept;
}

void add_sides(const TradeoffArguments& arguments, const Workbench& bench, TradeReport& report, const Output& output,
               const StopRequest& stop) {
  ReadProgress progress(output, "storing, guiding, simulating");
  report.sides.push_back(trade_of_storage(bench, report.base.configuration, stop));
  weigh_recordings(report);
  report.sides.push_back(trade_of_projection(bench, !arguments.no_instructions, stop));
  if (!arguments.scene.empty()) {
    report.sides.push_back(scene_bench(arguments, bench).trade());
    if (report.sides.back().levels.empty())
      output.remark(fmt::format("{}: {} touches none of its objects", arguments.scene, arguments.path));
  }
  const DeviceSpec spec = DeviceSpec::parse(arguments.device);
  if (spec.name != "sim" || stop.count() > 0) return;
  report.sides.push_back(trade_of_simulation(
      bench, report.base.configuration,
      [&](const std::vector<std::pair<std::string, std::string>>& options) {
        DeviceSpec one = spec;
        for (const auto& [key, value] : options) one.options[key] = value;
        return open_device(one);
      },
      stop));
}

/// Writes the configuration that was chosen, with the profile that it needs, and tells of both.
void keep_choice(const TradeoffArguments& arguments, const Choice& choice, const Budget& budget, const Workbench& bench,
                 const TradeFiles& files, nlohmann::json& json, std::string& text) {
  const Configuration& chosen = choice.outcome.configuration;
  const std::optional<DeviceProfile> profile = bench.profile_at(chosen.rate_hz);
  if (profile) save_profile(*profile, files.profile, arguments.overwrite);
  nlohmann::json config =
      config_file(chosen, bench.place().play, profile ? std::filesystem::absolute(files.profile).string() : "",
                  choice.storage ? &choice.storage->storage : nullptr);
  for (const auto& [key, time] : {std::pair{"from", arguments.selection.from}, {"to", arguments.selection.to}})
    if (std::isfinite(time)) config["play"][key] = config["guide"][key] = time;
  for (const auto& [column, name] : arguments.csv.columns)
    for (const char* key : {"play", "guide"}) config[key]["columns"].push_back(fmt::format("{}={}", column, name));
  if (!arguments.csv.units.empty()) config["play"]["units"] = config["guide"]["units"] = arguments.csv.units;
  save_json(config, files.config, arguments.overwrite);
  json["choice"] = to_json(choice, budget);
  json["config_file"] = files.config;
  json["predicted"] = predicted_by(choice.outcome);
  text += text_of(choice, budget);
  text += fmt::format("  written to {}; use it: haptrace play {} --device {} --config {}\n", files.config,
                      arguments.path, arguments.device, files.config);
}

/// Explains the base and, where it learns, the base without learning, by leaving out each term.
void add_explanations(const TradeoffArguments& arguments, const Workbench& bench, const Budget& budget,
                      const TradeOptions& options, const Output& output, const StopRequest& stop, nlohmann::json& json,
                      std::string& text) {
  ReadProgress progress(output, "leaving out each term");
  std::vector<Configuration> explained{options.base};
  // Learning takes the place of the model's knowledge of the load.
  if (options.base.learn > 0) {
    explained.push_back(options.base);
    explained.back().learn = 0;
  }
  json["explanations"] = nlohmann::json::array();
  for (const Configuration& configuration : explained) {
    const Explanation explanation = explain(bench, configuration, budget, options, stop);
    json["explanations"].push_back(to_json(explanation));
    text += text_of(explanation, budget, "term");
  }
  if (const auto physics = explain_simulation(arguments, bench, budget, options, stop)) {
    json["physics"] = to_json(*physics);
    text += text_of(*physics, budget, "part of the simulated device");
  }
}

void add_measuring_options(CLI::App& verb, TradeoffArguments& arguments) {
  verb.add_option("--runs", arguments.runs, "runs of every configuration, each with different noise, 1 to 100")
      ->capture_default_str();
  verb.add_option("--rates", arguments.rates,
                  "servo rates to try [Hz] (default: 100 Hz to 20 kHz; for a real device, up to its own rate)")
      ->delimiter(',');
  verb.add_option("--seed", arguments.seed, "seed of the first run")->capture_default_str();
  verb.add_option("--jobs", arguments.jobs,
                  "number of threads (0: one for every core); the results do not depend on it")
      ->capture_default_str();
}

void add_base_options(CLI::App& verb, TradeoffArguments& arguments) {
  arguments.profile.add_to(verb, "Base", "compare PD control alone, without the device's profile");
  verb.add_option("--rate", arguments.base.rate_hz, "servo rate [Hz]")->capture_default_str()->group("Base");
  verb.add_option("--velocity", arguments.base.velocity, "velocity estimator")->capture_default_str()->group("Base");
  verb.add_option("--interpolation", arguments.interpolation, "interpolation between samples")
      ->capture_default_str()
      ->group("Base");
  verb.add_option("--learn", arguments.learn, "learning repetitions of a calibrated device (0: none)")
      ->capture_default_str()
      ->group("Base");
}

void add_path_options(CLI::App& verb, TradeoffArguments& arguments) {
  verb.add_option("--speed", arguments.base.speed, "speed as a multiple of the path's own speed")
      ->capture_default_str()
      ->group("Path");
  verb.add_flag("--fit", arguments.fit, "move and scale the path into the workspace")->group("Path");
  add_input_options(verb, arguments.csv);
  verb.add_option("--from", arguments.selection.from, "start at this time of the recording [s]")->group("Path");
  verb.add_option("--to", arguments.selection.to, "end at this time of the recording [s]")->group("Path");
  verb.add_option("--smoothing", arguments.smoothing, "smoothing of the path's positions, as in play [s]")
      ->group("Path");
  verb.add_option("--max-deviation", arguments.max_deviation, "largest deviation, as in play [m]")
      ->capture_default_str()
      ->group("Path");
}

void add_question_options(CLI::App& verb, TradeoffArguments& arguments) {
  verb.add_option("path", arguments.path, "recording (HDF5) or path (HDF5, CSV with t,x,y,z)")->type_name("PATH");
  verb.add_option("-d,--device", arguments.device, "device, with options as key=value,...")->type_name("NAME[:...]");
  verb.add_option("--budget", arguments.budget, "bounds to keep, as in 'error<=0.1mm, tick<=2us'")->type_name("BOUNDS");
  verb.add_option("--scene", arguments.scene, "scene whose accuracy settings are varied, with the tool on the path")
      ->type_name("FILE.json");
  verb.add_option("--scene-budget", arguments.scene_budget,
                  "bounds on the scene's force error and time, as in 'error<=20mN, time<=500ns'")
      ->type_name("BOUNDS");
  verb.add_flag("--explain", arguments.explain, "leave out each term in turn, and report the change and the saving");
}

void add_output_options(CLI::App& verb, TradeoffArguments& arguments) {
  verb.add_option("-o,--output", arguments.output, "JSON file to write; the figure is written beside it")
      ->type_name("FILE.json");
  verb.add_option("--figure", arguments.figure, "figure to write: .png, .svg or .pdf")->type_name("FILE");
  verb.add_option("--save", arguments.save, "configuration that keeps the budget (default: beside the JSON)")
      ->type_name("FILE.json");
  verb.add_flag("--no-instructions", arguments.no_instructions,
                "measure load as a share of the time, without counting instructions");
  verb.add_flag("--overwrite", arguments.overwrite, "replace existing files");
}

/// Returns the budget to keep. Throws Error(input) if an option is missing or out of its range, or if the budget
/// bounds what is not measured.
Budget budget_of(const CLI::App& verb, const TradeoffArguments& arguments) {
  require(verb, "path");
  require(verb, "--device");
  check_range("--runs", static_cast<double>(arguments.runs), 1, 100);
  check_range("--learn", arguments.learn, 0, 20);
  check_range("--speed", arguments.base.speed, 0.001, 100);
  Budget budget = arguments.budget.empty() ? Budget{} : parse_budget(arguments.budget);
  if (arguments.no_instructions) check_counted(budget);
  return budget;
}

/// Throws Error(input) if the scene or its budget cannot be read, before minutes of measurements.
void check_scene(const TradeoffArguments& arguments, const Output& output) {
  if (!arguments.scene.empty()) {
    const WaitingLine line(output, "reading " + arguments.scene);
    (void)load_scene(arguments.scene);
  }
  if (arguments.scene_budget.empty()) return;
  if (arguments.scene.empty()) throw input_error("--scene-budget bounds a scene: give its --scene too");
  (void)parse_scene_budget(arguments.scene_budget);
}

TradeOptions options_of(const TradeoffArguments& arguments, const Workbench& bench) {
  TradeOptions options{.base = base_of(arguments, bench.calibrated()),
                       .runs = bench.place().varies ? arguments.runs : 1,
                       .threads = arguments.jobs,
                       .instructions = !arguments.no_instructions};
  options.rates = rates_of(arguments, bench, options.rates);
  return options;
}

/// Draws the figure of a measurement again and again while it runs.
class TradePicture {
 public:
  /// Without a `file`, draws nothing.
  TradePicture(std::string file, bool overwrite) : file_(std::move(file)), overwrite_(overwrite) {}

  void draw(const TradeReport& report, const Choice* choice) {
    if (file_.empty()) return;
    save_figure(figure_of(report, choice), file_, overwrite_);
    overwrite_ = true;
  }

 private:
  std::string file_;
  bool overwrite_;  ///< replace the file; true after the first drawing
};

/// Runs the verb and returns its exit code.
int tradeoff_command(const CLI::App& verb, const TradeoffArguments& arguments, const Output& output) {
  const Budget budget = budget_of(verb, arguments);
  const TradeFiles files = files_of(arguments);
  check_scene(arguments, output);
  const Signals signals;
  Workbench bench(workplace(arguments, output, signals.stop()));
  const TradeOptions options = options_of(arguments, bench);
  TradePicture picture(files.figure, arguments.overwrite);
  TradeReport report = [&] {
    ReadProgress progress(output, "");
    return measure_trade(
        bench, options, signals.stop(),
        [&](const std::string& stage, double done) { progress.tell_share(done, stage); },
        [&](const TradeReport& so_far) { picture.draw(so_far, nullptr); });
  }();
  if (report.complete) add_sides(arguments, bench, report, output, signals.stop());
  report.complete = report.complete && signals.stop().count() == 0;
  if (report.base.ran() && !report.base.counted()) check_counted(budget);
  nlohmann::json json = to_json(report);
  std::string text = text_of(report);

  const std::optional<Choice> choice = budget.empty() ? std::nullopt : choose(report, budget);
  if (!budget.empty() && report.complete && !choice)
    output.remark("no configuration was chosen: none was played to its end");
  if (choice) keep_choice(arguments, *choice, budget, bench, files, json, text);
  const bool scene_kept = files.scene.empty() || !report.complete ||
                          keep_scene(arguments, bench, files.scene, output, signals.stop(), json, text);
  if (arguments.explain && report.complete)
    add_explanations(arguments, bench, budget, options, output, signals.stop(), json, text);
  report.complete = report.complete && signals.stop().count() == 0;
  json["complete"] = report.complete;
  picture.draw(report, choice ? &*choice : nullptr);
  if (!files.json.empty()) save_json(json, files.json, arguments.overwrite);
  if (!files.figure.empty()) text += fmt::format("  figure: {}\n", files.figure);
  output.tell(json, text);
  if (!report.complete) {
    output.remark("interrupted; the results cover only the finished part");
    return kInterrupted;
  }
  return (!budget.empty() && !(choice && choice->kept)) || !scene_kept ? kStopped : kDone;
}

}  // namespace

Verb add_tradeoff(CLI::App& app) {
  const auto arguments = std::make_shared<TradeoffArguments>();
  CLI::App* verb = app.add_subcommand(
      "tradeoff", "measure the cost and the error of every accuracy setting, and find the cheapest configuration");
  verb->footer(
      "Plays the path on the device in virtual time with every accuracy setting varied by itself, then in\n"
      "combinations. A real device does not move: its profile is simulated. With --budget, the configuration that\n"
      "keeps it is written to a file for --config of play, guide and record.\n"
      "Bounds: error, peak [mm]; force, ripple [N]; margin (>=); tick [us]; instructions; load (MIPS, million\n"
      "instructions a second); start [ms]; bytes [MB/h].\n"
      "  haptrace tradeoff circle.h5 -d sim:preset=falcon,hand=relaxed -o tradeoff.json\n"
      "  haptrace tradeoff circle.h5 -d falcon --budget 'error<=0.1mm, ripple<=0.3N' --explain -o tradeoff.json\n"
      "  haptrace play circle.h5 -d falcon --config tradeoff-config.json");
  add_question_options(*verb, *arguments);
  add_output_options(*verb, *arguments);
  add_measuring_options(*verb, *arguments);
  add_base_options(*verb, *arguments);
  add_path_options(*verb, *arguments);
  return {verb, [verb, arguments](const Output& output) { return tradeoff_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
