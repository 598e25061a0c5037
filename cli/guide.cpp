#include "player/guidance/guide.h"

#include "base/error.h"
#include "base/suggest.h"
#include "base/units.h"
#include "cli/input_options.h"
#include "cli/live_page.h"
#include "cli/path_options.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
#include "cli/scene_options.h"
#include "cli/tuning.h"
#include "formats/documents/expert_recording.h"
#include "formats/path/path_changing.h"
#include "formats/path/path_file.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fmt/format.h>
#include <span>

namespace haptrace::cli {
namespace {

struct Arguments {
  SessionArguments session;
  std::string expert, record, mode = "tunnel", feel = "active", radius = "5mm", expert_force;
  ExpertOptions expert_options;
  CsvOptions csv;
  ProfileArguments profile;
  bool radius_given = false;  ///< on the command line or in --config
  std::vector<std::string> spread;
  PathArguments along{GuidanceOptions{}.max_deviation};
  GuideOptions guide;
  std::optional<double> pace;
  double pace_margin = 0.2, pace_force = 1;
  bool initiate = false;
  BackWallOptions wall;
  TuningArguments tuning{.example = "radius 6mm"};
  ViewArguments view;
  TouchArguments scene;
};

const std::vector<std::string> kModes{"tunnel", "cursor", "free"};

/// Parses --radius: "0.005", "5mm", "auto" or a profile along the path.
void set_radius(const Arguments& arguments, GuideOptions& options) {
  const std::string& text = arguments.radius;
  if (text == "auto") {
    options.radius = 1e-3;
    return;
  }
  if (!arguments.spread.empty())
    throw input_error("--spread needs --radius auto; a fixed radius does not depend on other experts");
  if (std::filesystem::path(text).extension() == ".json") {
    options.radius_profile = load_radius_profile(text);
    return;
  }
  const std::optional<double> radius = parse_quantity(text, "m");
  if (!radius)
    throw input_error(fmt::format(
        "--radius is '{}'; it must be a length such as 0.005 or 5mm, auto, or a profile along the path (FILE.json)",
        text));
  options.radius = *radius;
}

/// Returns the options that do not depend on files and the device.
GuideOptions options_of(const Arguments& arguments) {
  GuideOptions options = arguments.guide;
  set_radius(arguments, options);
  const auto mode = std::find(kModes.begin(), kModes.end(), arguments.mode);
  if (mode == kModes.end())
    throw input_error(fmt::format("unknown mode '{}'{}", arguments.mode, suggestion(arguments.mode, kModes)));
  options.guidance.cursor = *mode == "cursor";
  options.free = *mode == "free";
  options.guidance.led = !options.free;
  options.tunnel_without_walls = options.free && arguments.radius_given;
  options.feel = parse_feel(arguments.feel);
  if (arguments.pace)
    options.pace =
        PaceHelpOptions{.pace = *arguments.pace, .margin = arguments.pace_margin, .max_force = arguments.pace_force};
  if (arguments.initiate) {
    options.initiate = arguments.wall;
    options.initiate->pace = (1 - arguments.pace_margin) * arguments.pace.value_or(1);
  }
  const PathArguments& along = arguments.along;
  options.fit = along.fit;
  options.smoothing = along.smoothing;
  along.apply_to(options.guidance);
  return options;
}

/// Throws Error(input) for an option of the command line that has no effect in this mode or without another option.
void refuse_useless_options(const CLI::App& verb, const Arguments& arguments) {
  constexpr const char* kForces = "--mode tunnel or --mode cursor";
  const bool cursor = arguments.mode == "cursor", forces = arguments.mode != "free", pace = arguments.pace.has_value(),
             amplify = arguments.guide.amplify > 0;
  refuse_useless(verb, std::to_array<Dependence>({{"--speed", cursor, "--mode cursor"},
                                                  {"--wait", cursor, "--mode cursor"},
                                                  {"--stiffness", forces, kForces},
                                                  {"--expert", forces, kForces},
                                                  {"--onset", forces, kForces},
                                                  {"--damping", forces, kForces},
                                                  {"--allow-back", forces && !cursor, "--mode tunnel"},
                                                  {"--expert-force", forces, kForces},
                                                  {"--force-scale", forces, kForces},
                                                  {"--feel", forces, kForces},
                                                  {"--pace", forces && !cursor, "--mode tunnel"},
                                                  {"--initiate", forces, kForces},
                                                  {"--resistance", forces, kForces},
                                                  {"--viscosity", forces, kForces},
                                                  {"--amplify", forces, kForces},
                                                  {"--energy", forces, kForces},
                                                  {"--pace-margin", pace || arguments.initiate, "--pace or --initiate"},
                                                  {"--pace-force", pace, "--pace"},
                                                  {"--initiate-wait", arguments.initiate, "--initiate"},
                                                  {"--initiate-stiffness", arguments.initiate, "--initiate"},
                                                  {"--initiate-force", arguments.initiate, "--initiate"},
                                                  {"--amplify-force", amplify, "--amplify"},
                                                  {"--expert-profile", forces, kForces},
                                                  {"--negate-measured", forces, kForces}}));
}

/// Takes the radius of --radius auto from an averaged expert, unless --spread gives it.
void take_radius_of_path(const Arguments& arguments, const std::string& file, const PathFacts& facts,
                         GuideOptions& options) {
  if (arguments.radius != "auto" || !arguments.spread.empty()) return;
  options.radius_profile = averaged_radius(file, facts);
  if (!options.radius_profile)
    throw input_error(
        fmt::format("--radius auto needs the spread of several experts, but {} is one recording: average "
                    "several (haptrace average A.h5 B.h5 C.h5 -o expert.h5) and guide along the average, "
                    "or name further ones with --spread A.h5 B.h5",
                    facts.name));
  options.radius_of_path = true;
}

std::string percent(double share) {
  return std::isfinite(share) ? fmt::format("{:.0f} %", 100 * share) : "undefined";
}

/// Returns how a repetition with a back wall began: "; started alone after 0.43 s".
std::string initiation_text(const std::optional<Initiation>& initiation) {
  if (!initiation) return "";
  const char* how = initiation->initiator == Initiator::self     ? "started alone after"
                    : initiation->initiator == Initiator::helped ? "started with help after"
                                                                 : "did not start within";
  return fmt::format("; {} {:.2f} s, work of the wall behind the hand {:.0f} mJ", how, initiation->waited,
                     1e3 * initiation->work);
}

std::string summary(const Arguments& arguments, const GuideResult& result, const DeviceInfo& device,
                    const std::string& expert, const PathChange& change, ReplayedForce force) {
  std::string text = fmt::format("{}: guided on {}\n", expert, device.name);
  if (arguments.mode != "free" && result.plan.has_forces && arguments.guide.force_scale > 0)
    text += fmt::format("  force of the expert: {}\n", to_string(force));
  if (!change.is_identity()) text += fmt::format("  path: {}\n", describe(change));
  if (result.plan.fit) text += fmt::format("  fitted into the workspace: {}\n", describe(*result.plan.fit));
  const bool free = arguments.mode == "free", has_tunnel = !free || arguments.radius_given;
  for (std::size_t i = 0; i < result.repetitions.size(); ++i) {
    const GuideFigures& figures = result.repetitions[i];
    text += fmt::format("  {}{}{:.1f} s, {:.0f} of {:.0f} mm, {}deviation {:.2f} mm rms, {:.2f} mm at most{}\n",
                        result.repetitions.size() > 1 ? fmt::format("repetition {}: ", i + 1) : "",
                        figures.partial ? fmt::format("partial ({} of the path), ", percent(figures.completion)) : "",
                        figures.tracking.duration, 1e3 * figures.progress, 1e3 * result.plan.path->length(),
                        has_tunnel ? percent(figures.time_in_tunnel) + " of the time in the tunnel, " : "",
                        1e3 * figures.tracking.rms_error, 1e3 * figures.tracking.peak_error,
                        initiation_text(figures.initiation));
  }
  if (!free)
    text += fmt::format("  wall stiffness {:.0f} N/m; guidance added {:.2f} J of {:.2f} J allowed\n",
                        result.plan.stiffness, result.energy_given, result.energy_budget);
  if (result.time_in_doubt > 0)
    text += fmt::format("  place on the path in doubt for {} of the time\n", percent(result.time_in_doubt));
  if (result.time_empty > 0)
    text += fmt::format("  energy tank empty, and the expert's force reduced, for {} of the time\n",
                        percent(result.time_empty));
  text += session_summary(result.session);
  if (!arguments.record.empty()) text += fmt::format("  recorded in {}\n", arguments.record);
  return text;
}

/// Returns the name that a trainee reads: that of the file, without folder and ending.
std::string exercise_name(const std::string& input) {
  return std::filesystem::path(input).stem().string();
}

/// Returns the commands of the session, for guidance as planned.
std::unique_ptr<LiveGuidance> commands_of(const GuidePlan& plan, const GuideOptions& options, StopRequest& stop) {
  LiveSession::Options session{.stop = &stop, .endless = options.guidance.repetitions == 0};
  if (options.session.recording) session.annotations = options.session.recording->options.annotations;
  auto commands = std::make_unique<LiveGuidance>(std::move(session));
  commands->begin(guide_scope(plan, options));
  return commands;
}

void add_tunnel_options(CLI::App& verb, Arguments& arguments) {
  verb.add_option(
          "--radius", arguments.radius,
          "tunnel radius: a length, such as 5mm; auto, from the spread of several experts (haptrace average, or "
          "--spread); or a profile along the path, FILE.json. In mode free there is no tunnel without it")
      ->capture_default_str()
      ->group("Tunnel");
  verb.add_option("--spread", arguments.spread, "further experts' recordings, for --radius auto")
      ->type_name("FILE...")
      ->group("Tunnel");
  verb.add_option("--stiffness", arguments.guide.stiffness,
                  "stiffness of the walls [N/m] (default: the largest stable one, at most 1000)")
      ->group("Tunnel");
  verb.add_flag("--expert", arguments.guide.expert, "do not limit the stiffness to the stable range of the device")
      ->group("Tunnel");
  verb.add_option("--spacing", arguments.guide.spacing,
                  "spacing of the path's knots [m] (default: 0.25 mm on a desktop device)")
      ->group("Path");
  verb.add_option("--onset", arguments.guide.onset, "distance over which the stiffness rises [m]")
      ->capture_default_str()
      ->group("Tunnel");
  verb.add_option("--damping", arguments.guide.damping, "damping of outward movement in the wall [N s/m]")
      ->capture_default_str()
      ->group("Tunnel");
  verb.add_flag("--allow-back", arguments.guide.guidance.allow_back,
                "let the trainee go back: walls do not hold them at the farthest place")
      ->group("Tunnel");
}

void add_expert_options(CLI::App& verb, Arguments& arguments) {
  verb.add_option("--expert-force", arguments.expert_force,
                  "force of the recording: task (measured, less the inertia and friction of the expert's device) | "
                  "measured | sent (default: task if the recording has a measured force and the device's profile is "
                  "known, else sent). It is replayed by place: a force that depends on speed is that of the expert's "
                  "speed")
      ->group("Forces");
  verb.add_option("--expert-profile", arguments.expert_options.profile,
                  "profile of the expert's device (default: profile.json beside the recording, else the one stored for "
                  "that device)")
      ->type_name("FILE.json")
      ->group("Forces");
  verb.add_flag("--negate-measured", arguments.expert_options.negated,
                "the recording's force sensor measures the force of the hand on the device")
      ->group("Forces");
}

void add_force_options(CLI::App& verb, Arguments& arguments) {
  verb.add_option("--force-scale", arguments.guide.force_scale, "factor on the expert's forces (0: no force)")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--feel", arguments.feel,
                  "recorded force: active (pushes the trainee as it pushed the expert) | resist (its opposite, which "
                  "the trainee has to overcome)")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--pace", arguments.pace,
                  "help along the path if the trainee is slower than this share of the expert's speed")
      ->group("Forces");
  verb.add_option("--pace-margin", arguments.pace_margin,
                  "share by which the trainee may be slower than the pace without help")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--pace-force", arguments.pace_force, "largest helping force [N]")
      ->capture_default_str()
      ->group("Forces");
  verb.add_flag("--initiate", arguments.initiate,
                "help a trainee who does not start: a wall behind the hand moves off when the trainee does, or after "
                "--initiate-wait, at --pace less --pace-margin")
      ->group("Forces");
  verb.add_option("--initiate-wait", arguments.wall.wait,
                  "time for which the wall waits at the start and where the expert stopped [s]")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--initiate-stiffness", arguments.wall.stiffness, "stiffness of the wall behind the hand [N/m]")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--initiate-force", arguments.wall.max_force,
                  "largest force of the wall behind the hand [N]; at most the device's continuous force")
      ->capture_default_str()
      ->group("Forces");
  verb.add_option("--resistance", arguments.guide.resistance, "resistance to movement along the path [N s/m]")
      ->group("Forces");
  verb.add_option("--viscosity", arguments.guide.viscosity, "resistance to all movement [N s/m]")->group("Forces");
  verb.add_option("--amplify", arguments.guide.amplify, "force away from the path per error within the tunnel [N/m]")
      ->group("Forces");
  verb.add_option("--amplify-force", arguments.guide.amplify_force, "largest force away from the path [N]")
      ->capture_default_str()
      ->group("Forces");
}

void add_cursor_options(CLI::App& verb, Arguments& arguments) {
  verb.add_option("--speed", arguments.guide.guidance.speed, "speed of the cursor as a multiple of the expert's speed")
      ->capture_default_str()
      ->group("Cursor");
  verb.add_option("--wait", arguments.guide.guidance.wait,
                  "distance from the trainee at which the cursor waits [m] (0: it never waits)")
      ->capture_default_str()
      ->group("Cursor");
}

/// Opens the expert's recording with the force that the options choose.
ExpertRecording open_with_force(const Arguments& arguments, const InputFile& input, const Output& output) {
  ExpertOptions options = arguments.expert_options;
  // No force is replayed in mode free, so nothing is to be said about it.
  if (arguments.mode == "free") options.force = ReplayedForce::sent;
  if (!arguments.expert_force.empty()) options.force = parse_replayed_force(arguments.expert_force);
  std::optional<DeviceProfile> known;
  if (!arguments.profile.file.empty() && !arguments.profile.none) known = load_profile(arguments.profile.file);
  ReadProgress progress(output, input.csv().name);
  return open_expert(input.path(), options, arguments.along.selection, progress.callback(), input.csv(), known);
}

/// Returns the options of the command line. Throws Error(input) if one is missing, invalid or without effect.
GuideOptions checked_options(const CLI::App& verb, Arguments& arguments) {
  require(verb, "expert");
  require(verb, "--device");
  arguments.radius_given = verb.get_option("--radius")->count() > 0;
  GuideOptions options = options_of(arguments);
  refuse_useless_options(verb, arguments);
  refuse_unrecorded(verb, !arguments.record.empty());
  refuse_useless(verb, std::to_array<Dependence>({{"--up", arguments.session.support > 0, "--support"}}));
  options.force_expected = verb.get_option("--force-scale")->count() > 0 || !arguments.expert_force.empty();
  std::vector<std::string> inputs = arguments.spread;
  inputs.push_back(arguments.expert);
  keep_inputs(arguments.record, inputs);
  options.session = arguments.session.options(arguments.record, effective_config(verb));
  return options;
}

/// Opens the recordings of --spread.
void open_spread(const Arguments& arguments, const Output& output, GuideOptions& options) {
  for (const std::string& file : arguments.spread) {
    CsvOptions csv = is_hdf5(file) ? CsvOptions() : arguments.csv;
    csv.name = file;
    ReadProgress progress(output, csv.name);
    options.spread.push_back(open_path(file, file == arguments.expert ? arguments.along.selection : PathSelection{},
                                       progress.callback(), csv));
  }
}

/// Moves the expert's path and those of --spread to where the trainee is guided, and returns the change.
PathChange place_paths(const Arguments& arguments, Device& device, GuideOptions& options,
                       std::shared_ptr<const PathSource>& expert) {
  PathChange change = arguments.along.change(device);
  const Similarity moved = similarity_of(change, *expert);
  expert = changed(std::move(expert), moved);
  for (auto& other : options.spread) other = changed(std::move(other), moved);
  keep_applied(options.session, "path_change", describe(change));
  return change;
}

/// Adds to the notes of the plan those of the scene and of the expert's recording, and to the warnings of the
/// recording those of the plan.
void join_notes(const DeviceInfo& device, const GuideOptions& options, const std::vector<std::string>& of_scene,
                GuidePlan& plan, ExpertRecording& opened) {
  plan.notes.insert(plan.notes.begin(), of_scene.begin(), of_scene.end());
  plan.notes.insert(plan.notes.begin(), opened.notes.begin(), opened.notes.end());
  std::ranges::copy(plan.warnings, std::back_inserter(opened.warnings));
  std::ranges::move(notes_on_reach(options.session, device), std::back_inserter(plan.notes));
}

/// Prints the joined warnings and notes, makes them and the fit of the path known to the session, and returns them.
std::vector<std::string> note_plan(const Output& output, const GuidePlan& plan, const ExpertRecording& opened,
                                   SessionOptions& session) {
  if (plan.fit) keep_applied(session, "path_fit", describe(*plan.fit));
  note_before(output, session, "path", opened.warnings, Severity::warning);
  note_before(output, session, "plan", plan.notes);
  std::vector<std::string> notes = opened.warnings;
  notes.insert(notes.end(), plan.notes.begin(), plan.notes.end());
  return notes;
}

/// Shows on the page that the exercise begins.
void begin_training(LivePage& page, const Arguments& arguments, const GuideOptions& options, const std::string& input) {
  page.training([&](TrainingProgress& screen) {
    TrainingTrial trial{.exercise = exercise_name(input), .mode = arguments.mode};
    trial.repetitions = std::max(options.guidance.repetitions, 1);
    trial.of = static_cast<std::size_t>(trial.repetitions);
    screen.begin(trial);
  });
}

/// Shows on the page how the exercise ended.
void end_training(LivePage& page, const GuideResult& result) {
  page.training([&](TrainingProgress& screen) {
    const bool stopped = result.session.servo.cause != StopCause::finished;
    screen.end(stopped,
               TrainingScore{.time_in_tunnel = result.last.time_in_tunnel, .time = result.last.tracking.duration});
    screen.finish(stopped);
  });
}

/// Runs the verb and returns its exit code.
int guide_command(const CLI::App& verb, Arguments& arguments, const Output& output) {
  GuideOptions options = checked_options(verb, arguments);
  const std::vector<std::string> of_scene = arguments.scene.apply(options.session, output);

  const InputFile input(arguments.expert, arguments.csv);
  ExpertRecording opened = open_with_force(arguments, input, output);
  std::shared_ptr<const PathSource> expert = opened.path;
  take_radius_of_path(arguments, input.path(), expert->facts(), options);
  open_spread(arguments, output, options);
  const Signals signals;
  StopRequest stop(&signals.stop());
  LivePage page(arguments.view, arguments.session, output, "guide", stop);
  page.watch(options.session);
  const auto device = arguments.session.open();
  const DeviceInfo& info = device->info();
  const PathChange change = place_paths(arguments, *device, options, expert);
  std::vector<std::string> notes =
      note_device_and_path(output, options.session, info, input.name(), expert->facts().notes);
  const auto profile = arguments.profile.find(info, arguments.session.rate_hz, output, &options.session.known);
  if (profile) {
    options.identified = profile->identified();
    take_motor_limit(*profile, info, output, options.session);
  }
  keep_dynamics(options.session, info, profile);
  GuidePlan plan = plan_guidance(info, expert, options);
  join_notes(info, options, of_scene, plan, opened);
  std::ranges::move(note_plan(output, plan, opened, options.session), std::back_inserter(notes));

  const std::unique_ptr<LiveGuidance> commands = commands_of(plan, options, stop);
  options.live = commands.get();
  const LivePage::Use use(page, *commands);
  const TuningInputs outside(arguments.tuning, *commands);
  for (const std::string& hint : outside.hints()) output.remark(hint);

  const Keys keys(options.session.recording ? options.session.recording->options.annotations : nullptr,
                  arguments.session.mark_texts, arguments.session.keys, *commands, Keys::guide_keys());
  const double expected = options.guidance.repetitions * (plan.duration + options.guidance.hold + 0.5);
  begin_training(page, arguments, options, input.name());
  const GuideResult result = guide(*device, plan, options, stop, progress_bar(output, expected, &keys, commands.get()));
  end_training(page, result);

  nlohmann::json json = to_json(result);
  json["mode"] = arguments.mode;
  json["feel"] = arguments.feel;
  json["expert_force"] = to_string(opened.force);
  json["tuning"] = commands->history();
  if (!change.is_identity()) json["path_change"] = describe(change);
  json["notes"] = notes;
  if (!arguments.record.empty()) json["file"] = arguments.record;
  const int code = conclude(output, result.session);
  output.tell(json, summary(arguments, result, info, input.name(), change, opened.force));
  return code;
}

}  // namespace

Verb add_guide(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("guide", "guide a trainee along an expert's recording");
  verb->footer(
      "The trainee moves; the device keeps them in a tunnel around the expert's path and renders the expert's\n"
      "forces at their position on the path (--mode tunnel), or around a cursor that moves as the expert did\n"
      "(--mode cursor).\n"
      "Keys: + or ] makes the walls 10 % stiffer, - or [ softer; w and n make the tunnel wider and narrower; r\n"
      "restores the start; p pauses and resumes; s skips and a repeats a repetition; q ends the session.\n"
      "  haptrace guide expert.h5 -d falcon --radius 5mm --record trainee.h5\n"
      "  haptrace guide average.h5 -d falcon --radius auto\n"
      "  haptrace guide expert.h5 -d falcon --radius auto --spread second.h5 third.h5\n"
      "  haptrace guide expert.h5 -d falcon --mode cursor --wait 0.02 --speed 0.5\n"
      "  haptrace guide expert.h5 -d falcon --scene samples/scenes/sphere.json\n"
      "  haptrace guide expert.h5 -d sim:preset=falcon,hand=relaxed,intent=expert.h5 --feel resist");
  verb->add_option("expert", arguments->expert,
                   "expert's recording (HDF5) or path (HDF5, CSV with t,x,y,z; -: standard input)")
      ->type_name("EXPERT");
  verb->add_option("--record", arguments->record, "write a recording of the session")->type_name("OUT.h5");
  verb->add_option(
          "--mode", arguments->mode,
          "guidance: tunnel (the trainee sets the pace) | cursor (the expert sets the pace) | free (no force at all)")
      ->capture_default_str();
  add_tunnel_options(*verb, *arguments);
  add_expert_options(*verb, *arguments);
  add_force_options(*verb, *arguments);
  add_cursor_options(*verb, *arguments);
  arguments->along.add_to(*verb);
  add_input_options(*verb, arguments->csv);
  verb->add_option("--time-limit", arguments->guide.guidance.time_limit,
                   "longest repetition [s] (0: no limit; in virtual time, ten times the expert's duration plus 10 s)")
      ->capture_default_str()
      ->group("Path");
  verb->add_option("--energy", arguments->guide.energy, "energy that guidance may add beyond the expert's [J]")
      ->capture_default_str()
      ->group("Safety");
  arguments->profile.add_to(*verb, "Safety", "guide without a device profile");
  arguments->scene.add_to(*verb);
  arguments->tuning.add_to(*verb, false);
  arguments->view.add_to(*verb);
  arguments->session.add_to(*verb);
  arguments->session.add_wait_to(*verb);
  arguments->session.add_support_to(*verb);

  return {verb, [verb, arguments](const Output& output) { return guide_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
