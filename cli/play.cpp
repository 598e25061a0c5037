#include "base/error.h"
#include "base/json_reader.h"
#include "base/rfc3339.h"
#include "base/suggest.h"
#include "base/units.h"
#include "base/vectors.h"
#include "cli/input_options.h"
#include "cli/live_page.h"
#include "cli/path_options.h"
#include "cli/profile.h"
#include "cli/read_progress.h"
#include "cli/scene_options.h"
#include "cli/tuning.h"
#include "formats/path/path_changing.h"
#include "formats/path/path_file.h"
#include "player/playback/learned_memory.h"
#include "player/playback/playback.h"
#include "player/playback/reference_stream.h"
#include "player/playback/speed_limit.h"
#include "player/tuning/live_tuning.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <numbers>
#include <span>

namespace haptrace::cli {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;  // degrees per radian
constexpr double kLqgRaise = 1.2;                    // an LQG law has less margin against higher gains than a PD law

struct PlayArguments {
  SessionArguments session;
  TuningArguments tuning;
  ViewArguments view;
  TouchArguments scene;
  std::string path, record, gains, impedance, learned, kp, kd;
  CsvOptions csv;
  ProfileArguments profile;
  std::vector<std::string> without;
  bool forget = false;
  int learn = 0;
  std::optional<double> kp_rotation, kd_rotation;
  double max_torque = 0;
  TurnOptions turn;
  PathArguments along{0.03};
  double speed = 1;
  int thin = 1;
  std::string on_deviation = "stop", interpolation = "cubic", law, firmness;
};

/// Parses a gain for all axes, or one per axis: 1500, 2N/mm or 2000,2000,500.
Vec3 gain_of(const char* option, const std::string& text, std::string_view unit) {
  if (text.find(',') != std::string::npos) return parse_vector(text, unit, option);
  const std::optional<double> gain = parse_quantity(text, unit);
  if (!gain)
    throw input_error(
        fmt::format("{} is '{}'; it must be a number, or three as in 2000,2000,500, each with or without a unit of {}",
                    option, text, unit));
  return Vec3::Constant(*gain);
}

std::optional<PdGains> gains_from(const PlayArguments& arguments) {
  if (!arguments.gains.empty()) {
    if (!arguments.kp.empty() || !arguments.kd.empty()) throw input_error("--gains and --kp, --kd exclude each other");
    return gains_from_json(load_json(arguments.gains), arguments.gains);
  }
  if (arguments.kp.empty() && arguments.kd.empty()) return std::nullopt;
  if (arguments.kp.empty() || arguments.kd.empty())
    throw input_error("--kp and --kd go together: give both, as in --kp 2000 --kd 24 (12 ms kp), or neither");
  return PdGains{gain_of("--kp", arguments.kp, "N/m"), gain_of("--kd", arguments.kd, "N s/m")};
}

std::optional<ImpedanceProfile> impedance_from(const PlayArguments& arguments) {
  if (arguments.impedance.empty()) return std::nullopt;
  if (!arguments.gains.empty() || !arguments.kp.empty() || !arguments.kd.empty())
    throw input_error("--impedance and --gains, --kp, --kd exclude each other");
  return load_impedance_profile(arguments.impedance);
}

/// Chooses the law of a calibrated playback. Given gains choose the law with an observer.
void choose_law(const PlayArguments& arguments, PlayOptions& options) {
  if (!arguments.law.empty()) options.law = parse_tracking_law(arguments.law);
  if (!arguments.firmness.empty()) options.firmness = parse_firmness(arguments.firmness);
  const char* given = !arguments.firmness.empty() ? "--firmness" : "--law lqg";
  if (options.law == TrackingLaw::observer) {
    if (!arguments.firmness.empty())
      throw input_error("--firmness is that of the LQG law: leave out --law observer, or --firmness");
  } else if ((!arguments.law.empty() || !arguments.firmness.empty()) && (options.gains || options.impedance)) {
    throw input_error(fmt::format(
        "{} and given gains exclude each other: an LQG law has gains of its own, chosen by --firmness", given));
  } else if ((!arguments.law.empty() || !arguments.firmness.empty()) && !options.compensations.observer) {
    throw input_error(fmt::format("{} and --without observer exclude each other", given));
  }
}

/// Throws Error(input) if a law was asked for that the device's profile does not have.
void require_law(const PlayArguments& arguments, const PlayOptions& options, const DeviceInfo& device) {
  if (arguments.law != to_string(TrackingLaw::lqg) && arguments.firmness.empty()) return;
  const std::string calibrate = fmt::format("haptrace calibrate --device {}", device.name);
  if (!options.identified) throw input_error(fmt::format("an LQG law needs a calibrated device: {}", calibrate));
  if (!options.identified->held)
    throw input_error(
        fmt::format("the device's profile has no LQG laws, because it is old, or its model coarse and its calibration "
                    "a quick one; calibrate again ({}), or leave out --law and --firmness",
                    calibrate));
}

std::optional<OrientationGains> orientation_gains_from(const PlayArguments& arguments) {
  if (!arguments.kp_rotation && !arguments.kd_rotation) return std::nullopt;
  if (!arguments.kp_rotation || !arguments.kd_rotation)
    throw input_error("--kp-rotation and --kd-rotation go together: give both, or neither");
  return OrientationGains{*arguments.kp_rotation, *arguments.kd_rotation};
}

Compensations compensations_from(const std::vector<std::string>& without) {
  Compensations with{true, true, true, true, true, true};
  std::vector<std::string> known{"all"};
  for (const CompensationTerm& term : kCompensationTerms) known.emplace_back(term.name);
  for (const std::string& name : without) {
    const std::size_t index = index_of_name("force term", name, known);
    if (index == 0)
      with = {};
    else
      with.*kCompensationTerms[index - 1].composed = false;
  }
  return with;
}

/// Returns the memory of the learned force, if this playback can have one.
std::optional<LearnedMemory> memory_of(const PlayArguments& arguments, const PlayOptions& options,
                                       const DeviceInfo& device, const PathChange& change) {
  return learned_memory_of(device, options,
                           arguments.learned.empty()
                               ? learned_file(arguments.path, identity_of(device), describe(change))
                               : arguments.learned);
}

double expected_duration(const PlayPlan& plan, const PlaybackOptions& options) {
  return options.repetitions * (plan.path->duration() / options.speed + options.hold + 0.5);
}

/// Returns the largest gains with which the calibrated device is stable under the law of the plan.
const PdGains& stability_limit(const PlayPlan& plan, const TrackingDesign& design) {
  return plan.composed.observer ? design.largest : design.plain;
}

/// Returns the tunable parts of the session: its gains, and the terms of its law.
LiveTuning tuning_of(const PlayArguments& arguments, const PlayPlan& plan, const PlayOptions& play,
                     const DeviceInfo& device, StopRequest& stop) {
  const SessionOptions& session = play.session;
  LiveTuning::Options options{
      .composed = plan.composed,
      .remedy = play.identified
                    ? "start the session without --without, or with --learn"
                    : fmt::format("calibrate the device first: haptrace calibrate --device {}", device.name),
      .stop = &stop,
      .endless = play.playback.repetitions == 0};
  if (!arguments.tuning.expert) {
    options.limits = limits_of_unidentified(device.max_force, session.loop.rate_hz);
    if (play.identified) {
      options.limits.largest = stability_limit(plan, play.identified->design);
      if (plan.lqg) options.limits.largest = {kLqgRaise * plan.tuning.gains.kp, kLqgRaise * plan.tuning.gains.kd};
      options.limits.observer_hz = 2 * play.identified->design.load_hz;
      options.limits.because = plan.lqg ? "limit of an LQG law" : "stability limit of this device";
    }
  }
  if (session.recording) options.annotations = session.recording->options.annotations;
  return {plan.tuning, std::move(options)};
}

/// Returns a warning of given gains beyond those at which the calibrated device is stable, else an empty text.
std::string beyond_stability(const PlayArguments& arguments, const PlayPlan& plan, const PlayOptions& play) {
  if (arguments.tuning.expert || !play.identified || (!play.gains && !play.impedance)) return "";
  const PdGains &gains = plan.tuning.gains, &most = stability_limit(plan, play.identified->design);
  if ((gains.kp.array() <= most.kp.array()).all() && (gains.kd.array() <= most.kd.array()).all()) return "";
  return fmt::format(
      "the gains are above the stability limit of this device (kp {:.0f}, {:.0f}, {:.0f} N/m; kd {:.3g}, {:.3g}, "
      "{:.3g} N s/m): it may vibrate, which softens or ends the session",
      most.kp.x(), most.kp.y(), most.kp.z(), most.kd.x(), most.kd.y(), most.kd.z());
}

/// Returns the options that do not depend on files and the device.
PlayOptions options_of(const PlayArguments& arguments) {
  PlayOptions options;
  options.gains = gains_from(arguments);
  options.impedance = impedance_from(arguments);
  options.interpolation = parse_interpolation(arguments.interpolation);
  options.smoothing = arguments.along.smoothing;
  options.thin = arguments.thin;
  options.fit = arguments.along.fit;
  options.playback.speed = arguments.speed;
  arguments.along.apply_to(options.playback);
  options.playback.on_deviation = parse_deviation_policy(arguments.on_deviation);
  check_range("--learn", arguments.learn, 0, kMostLearned);
  options.learn = arguments.learn;
  if (arguments.learn > 0 && !arguments.along.loop)
    options.playback.repetitions = std::max(arguments.learn, arguments.along.repeat);
  options.compensations = compensations_from(arguments.without);
  choose_law(arguments, options);
  options.turn = arguments.turn;
  options.turn.gains = orientation_gains_from(arguments);
  return options;
}

const char* lesson_text(LearningOutcome outcome) {
  switch (outcome) {
    case LearningOutcome::learned:
      return "learned";
    case LearningOutcome::converged:
      return "nothing left to learn: the remaining error does not repeat";
    case LearningOutcome::undone:
      return "worse than the best repetition before it: its changes were undone";
    case LearningOutcome::softened:
      return "the feedback was softened; nothing was learned from it";
    case LearningOutcome::skipped:
      return "interrupted; nothing was learned from it";
  }
  return "";
}

std::string text_of(const PdGains& gains) {
  const auto one = [](const Vec3& gain) {
    return gain.x() == gain.y() && gain.y() == gain.z()
               ? fmt::format("{:.4g}", gain.x())
               : fmt::format("{:.4g}, {:.4g}, {:.4g}", gain.x(), gain.y(), gain.z());
  };
  return fmt::format("kp {} N/m, kd {} N s/m", one(gains.kp), one(gains.kd));
}

/// Describes the control law at the end of the session.
std::string law_text(const PlayArguments& arguments, const PlayResult& result, const DeviceInfo& device,
                     const std::optional<DeviceProfile>& profile) {
  const std::vector<std::string> terms = names_of(result.plan.composed);
  const std::string kind = result.plan.lqg ? fmt::format("LQG, {}", to_string(result.plan.firmness)) : "PD";
  std::string text = fmt::format("  law: {}; {}\n", text_of(result.tuning.gains),
                                 terms.empty() ? "PD alone" : fmt::format("{} with {}", kind, fmt::join(terms, ", ")));
  if (result.stood_in)
    text += fmt::format("  it vibrated: from repetition {} on, plain PD control stood in for it, {}\n",
                        *result.stood_in + 1, text_of(result.gains_in_force()));
  if (const double share = result.session.gain_share; share < 1)
    text += fmt::format("  gains softened to {:.0f} %: {} at the end\n", 100 * share, text_of(result.gains_in_force()));
  return text + (profile ? fmt::format("  profile: {}, created {}\n", arguments.profile.used(device), profile->created)
                         : std::string("  profile: none\n"));
}

std::string summary(const PlayArguments& arguments, const PlayResult& result, const DeviceInfo& device,
                    const std::optional<DeviceProfile>& profile, const std::string& path, const PathChange& change) {
  std::string text = fmt::format("{}: played on {}\n", path, device.name);
  if (!change.is_identity()) text += fmt::format("  path: {}\n", describe(change));
  if (result.plan.fit) text += fmt::format("  fitted into the workspace: {}\n", describe(*result.plan.fit));
  for (std::size_t i = 0; i < result.repetitions.size(); ++i) {
    const TrackingFigures& figures = result.repetitions[i];
    text += fmt::format("  {}rms error {:.3f} mm, peak {:.3f} mm, force ripple {:.3f} N, force up to {:.2f} N\n",
                        result.repetitions.size() > 1 ? fmt::format("repetition {}: ", i + 1) : "",
                        1e3 * figures.rms_error, 1e3 * figures.peak_error, figures.force_ripple, figures.max_force);
  }
  if (std::isfinite(result.last.rms_rotation_error))
    text += fmt::format("  orientation: rms error {:.2f} degrees, peak {:.2f} degrees\n",
                        kDegrees * result.last.rms_rotation_error, kDegrees * result.last.peak_rotation_error);
  for (std::size_t i = 0; i < result.lessons.size(); ++i)
    if (result.lessons[i].outcome != LearningOutcome::learned)
      text += fmt::format("  repetition {}: {}\n", i + 1, lesson_text(result.lessons[i].outcome));
  text += law_text(arguments, result, device, profile);
  text += session_summary(result.session);
  if (!arguments.record.empty()) text += fmt::format("  recorded in {}\n", arguments.record);
  return text;
}

/// Stores the learned force, and names its file in `json`. The results of the session stay valid if that fails: then
/// tells of it and returns false.
bool keep_learned(LearnedMemory& memory, const PlayResult& result, nlohmann::json& json, const Output& output) {
  try {
    memory.keep(result);
    json["learned_file"] = memory.file();
    return true;
  } catch (const Error& error) {
    json["learned_error"] = error.what();
    output.remark(fmt::format("{}; the learned force was not saved", error.what()));
    return false;
  }
}

/// Notes in the profile that the law vibrated, if it did. The results of the session stay valid if that fails.
void keep_verdict(const std::string& file, const PlayOptions& options, DeviceProfile profile, PlayResult& result,
                  const Output& output) {
  const std::string now = rfc3339(std::chrono::system_clock::now());
  IdentifiedDevice device = profile.identified();
  const std::string text = refuse_vibrated(result, options, now, device);
  if (text.empty()) return;
  profile.design = std::move(device.design);
  profile.held = std::move(device.held);
  try {
    save_profile(profile, file, true);
  } catch (const Error& error) {
    output.remark(fmt::format("{}; the profile does not know that the law vibrated", error.what()));
    return;
  }
  result.session.warn(Severity::warning, "law_refused", text);
  output.warn(result.session.warnings.back());
}

void add_path_options(CLI::App& verb, PlayArguments& arguments) {
  verb.add_option("--speed", arguments.speed, "speed as a multiple of the path's own speed")
      ->capture_default_str()
      ->group("Path");
  verb.add_option("--interpolation", arguments.interpolation,
                  "interpolation between samples: hold | linear | cubic | quintic")
      ->capture_default_str()
      ->group("Path");
  verb.add_option("--thin", arguments.thin, "keep every N-th sample of the path (1: keep all)")
      ->capture_default_str()
      ->group("Path");
  verb.add_flag("--position-only", arguments.turn.off, "follow positions only, not orientations")->group("Path");
}

void add_control_options(CLI::App& verb, PlayArguments& arguments) {
  verb.add_option("--gains", arguments.gains, R"(gains from a file: {"kp": 1500, "kd": [15, 15, 10]})")
      ->type_name("FILE.json")
      ->group("Control");
  verb.add_option("--kp", arguments.kp, "proportional gain [N/m], or X,Y,Z (default: from the profile, else cautious)")
      ->type_name("NUMBER")
      ->group("Control");
  verb.add_option("--kd", arguments.kd, "derivative gain [N s/m], or X,Y,Z")->type_name("NUMBER")->group("Control");
  verb.add_option(
          "--impedance", arguments.impedance,
          "gains along the path: kp and kd over s or t, as JSON, or as columns of a CSV, even of the path itself")
      ->type_name("FILE")
      ->group("Control");
  verb.add_option("--law", arguments.law,
                  "law of a calibrated playback: lqg | observer (default: lqg, and with given gains observer)")
      ->group("Control");
  verb.add_option("--firmness", arguments.firmness, "ripple that the LQG law may use: quiet | normal | exact")
      ->group("Control");
  arguments.profile.add_to(verb, "Control", "play with PD control alone, without the device's profile");
  verb.add_option("--without", arguments.without,
                  "leave force terms out of a calibrated playback: inertia, gravity, friction, cogging, observer, "
                  "learning, all")
      ->delimiter(',')
      ->group("Control");
  verb.add_option("--kp-rotation", arguments.kp_rotation,
                  "proportional gain of the orientation [N m/rad] (default: cautious)")
      ->group("Control");
  verb.add_option("--kd-rotation", arguments.kd_rotation, "derivative gain of the orientation [N m s/rad]")
      ->group("Control");
}

void add_learning_options(CLI::App& verb, PlayArguments& arguments) {
  verb.add_option("--learn", arguments.learn,
                  "learn over this many repetitions; the learned force is stored for this path on this device")
      ->group("Learning");
  verb.add_option("--learned", arguments.learned, "file of the learned force (default: in a folder beside the path)")
      ->type_name("FILE.json")
      ->group("Learning");
  verb.add_flag("--forget", arguments.forget, "ignore the learned force that is stored")->group("Learning");
}

void add_safety_options(CLI::App& verb, PlayArguments& arguments) {
  verb.add_option(
          "--on-deviation", arguments.on_deviation,
          "reaction beyond --max-deviation: stop | pause (the path waits) | soften (the force grows no further)")
      ->capture_default_str()
      ->group("Safety");
  verb.add_option("--max-torque", arguments.max_torque, "torque limit [N m] (default and maximum: the device's)")
      ->group("Safety");
  verb.add_option("--max-rotation", arguments.turn.max_deviation,
                  "rotation away from the path at which the session stops [rad]")
      ->capture_default_str()
      ->group("Safety");
}

/// Returns the options of the command line. Throws Error(input) if one is missing, invalid or without effect.
PlayOptions checked_options(const CLI::App& verb, const PlayArguments& arguments) {
  require(verb, "path");
  require(verb, "--device");
  PlayOptions options = options_of(arguments);
  refuse_unrecorded(verb, !arguments.record.empty());
  refuse_useless(verb, std::to_array<Dependence>({{"--up", arguments.session.support > 0, "--support"}}));
  keep_inputs(arguments.record,
              std::array{arguments.path, arguments.gains, arguments.impedance, arguments.along.place.frame});
  options.session = arguments.session.options(arguments.record, effective_config(verb));
  options.session.loop.limits.max_torque = arguments.max_torque;
  return options;
}

/// Returns true if no learned force belongs to the path. Throws Error(input) if one is to be learned then.
bool has_no_memory(const PlayArguments& arguments, const InputFile& input) {
  // A path that starts wherever the tool is, is another path each time.
  const bool forgets = (input.passed_through() || arguments.along.start_here) && arguments.learned.empty();
  if (forgets && arguments.learn > 0)
    throw input_error(fmt::format("--learn with {} needs --learned, because the learned force has no file of its own",
                                  input.passed_through() ? input.name() : "--start-here"));
  return forgets;
}

/// Moves the path to where it is played, and returns the change.
PathChange place_path(const PlayArguments& arguments, Device& device, PlayOptions& options,
                      std::shared_ptr<const PathSource>& path) {
  // In the path's own file, the gains have the path's stamps.
  std::error_code none;
  if (options.impedance && !options.impedance->by_place &&
      std::filesystem::equivalent(arguments.path, arguments.impedance, none))
    for (double& t : options.impedance->at) t -= path->facts().begin;
  PathChange change = arguments.along.change(device);
  const Similarity moved = similarity_of(change, *path);
  path = changed(std::move(path), moved);
  keep_applied(options.session, "path_change", describe(change));
  return change;
}

/// Adds to the notes of the plan those of the scene, and one on a device that is not calibrated.
void add_notes(const PlayArguments& arguments, const PlayOptions& options, const DeviceInfo& device,
               const std::vector<std::string>& of_scene, PlayPlan& plan) {
  plan.notes.insert(plan.notes.begin(), of_scene.begin(), of_scene.end());
  std::ranges::move(notes_on_reach(options.session, device), std::back_inserter(plan.notes));
  if (!options.identified && !arguments.profile.none)
    plan.notes.push_back(
        fmt::format("{} is not calibrated: PD control alone follows the path, usually with an error of "
                    "millimetres. Calibrate it: haptrace calibrate --device {}",
                    device.model, device.name));
}

/// Prints the notes of the plan, makes them and the changes of its path known to the session, and returns them.
std::vector<std::string> note_plan(const Output& output, const PlayArguments& arguments, const PlayPlan& plan,
                                   PlayOptions& options) {
  std::vector<std::string> notes;
  if (const std::string shaky = beyond_stability(arguments, plan, options); !shaky.empty()) {
    note_before(output, options.session, "plan", std::span(&shaky, 1), Severity::warning);
    notes.push_back(shaky);
  }
  note_before(output, options.session, "plan", plan.notes);
  notes.insert(notes.end(), plan.notes.begin(), plan.notes.end());
  if (plan.fit) keep_applied(options.session, "path_fit", describe(*plan.fit));
  keep_applied(options.session, "path_stretch", describe(plan.stretch));
  return notes;
}

/// Applies what `memory` holds to the plan, unless --forget was given, and checks that it can be kept.
void recall_learned(LearnedMemory& memory, const PlayArguments& arguments, const DeviceInfo& device,
                    const std::shared_ptr<const PathSource>& path, const Output& output, PlayOptions& options,
                    PlayPlan& plan) {
  if (!arguments.forget)
    if (const std::string refused = memory.apply(device, path, options, plan); !refused.empty())
      note_before(output, options.session, "learned", std::span(&refused, 1), Severity::warning);
  if (options.learn > 0) check_learned_output(memory.file());
}

/// Runs the verb and returns its exit code.
int play_command(const CLI::App& verb, PlayArguments& arguments, const Output& output) {
  PlayOptions options = checked_options(verb, arguments);
  const std::vector<std::string> of_scene = arguments.scene.apply(options.session, output);

  const InputFile input(arguments.path, arguments.csv);
  const bool forgets = has_no_memory(arguments, input);
  std::shared_ptr<const PathSource> path = [&] {
    ReadProgress progress(output, input.name());
    return open_path(input.path(), arguments.along.selection, progress.callback(), input.csv());
  }();
  const Signals signals;
  StopRequest stop(&signals.stop());
  LivePage page(arguments.view, arguments.session, output, "play", stop);
  page.watch(options.session);
  const auto device = arguments.session.open();
  const DeviceInfo& info = device->info();
  const PathChange change = place_path(arguments, *device, options, path);
  std::vector<std::string> notes =
      note_device_and_path(output, options.session, info, input.name(), path->facts().notes);
  const auto profile = arguments.profile.find(info, arguments.session.rate_hz, output, &options.session.known);
  if (profile) {
    options.identified = profile->identified();
    take_motor_limit(*profile, info, output, options.session);
  }
  keep_dynamics(options.session, info, profile);
  require_law(arguments, options, info);
  PlayPlan plan = plan_playback(info, path, options);
  add_notes(arguments, options, info, of_scene, plan);
  std::ranges::move(note_plan(output, arguments, plan, options), std::back_inserter(notes));
  std::optional<LearnedMemory> memory;
  if (!forgets) memory = memory_of(arguments, options, info, change);
  if (memory) recall_learned(*memory, arguments, info, path, output, options, plan);
  if (arguments.along.loop && options.session.clock != ClockChoice::real && info.virtual_time)
    output.remark("looping in virtual time until Ctrl+C");

  LiveTuning tuning = tuning_of(arguments, plan, options, info, stop);
  options.tuning = &tuning;
  const LivePage::Use use(page, tuning);
  const TuningInputs inputs(arguments.tuning, tuning);
  for (const std::string& hint : inputs.hints()) output.remark(hint);

  const Keys keys(options.session.recording ? options.session.recording->options.annotations : nullptr,
                  arguments.session.mark_texts, arguments.session.keys, tuning, Keys::play_keys());
  const double expected = expected_duration(plan, options.playback);
  PlayResult result = play(*device, plan, options, stop, progress_bar(output, expected, &keys, &tuning));

  if (profile) keep_verdict(arguments.profile.used(info), options, *profile, result, output);

  nlohmann::json json = to_json(result);
  json["tuning"] = tuning.history();
  if (!change.is_identity()) json["path_change"] = describe(change);
  json["notes"] = notes;
  json["profile"] = profile ? nlohmann::json{{"file", arguments.profile.used(info)}, {"created", profile->created}}
                            : nlohmann::json();
  if (!arguments.record.empty()) json["file"] = arguments.record;
  int code = conclude(output, result.session);
  if (memory && !result.lessons.empty() && !keep_learned(*memory, result, json, output) && code == kDone)
    code = kStopped;
  output.tell(json, summary(arguments, result, info, profile, input.name(), change));
  return code;
}

}  // namespace

Verb add_play(CLI::App& app) {
  const auto arguments = std::make_shared<PlayArguments>();
  CLI::App* verb = app.add_subcommand("play", "play a recording or a path back through a device");
  verb->footer(
      "The device moves to the start of the path, follows it at the path's own time stamps, holds, and lets go.\n"
      "Keys: + or ] makes the gains 10 % stiffer, - or [ 10 % softer; o, l and f switch the observer, the learned\n"
      "force and the feedforward on and off; r restores the gains of the start; p pauses; q ends the session. While\n"
      "recording, m or space sets a mark, 1 to 9 a mark with one of --mark-texts, and t a mark with a typed text.\n"
      "  haptrace play square.h5 -d sim:preset=falcon,hand=relaxed --kp 1500 --kd 15 --record played.h5\n"
      "  haptrace play stroke.csv -d sim:preset=touch --fit --speed 0.5 --repeat 3\n"
      "  haptrace play square.h5 -d falcon --scene samples/scenes/sphere.json --record felt.h5");
  verb->add_option("path", arguments->path, "recording (HDF5) or path (HDF5, CSV with t,x,y,z; -: standard input)")
      ->type_name("PATH");
  verb->add_option("--record", arguments->record, "write a recording of the session")->type_name("OUT.h5");
  arguments->along.add_to(*verb);
  add_input_options(*verb, arguments->csv);
  add_path_options(*verb, *arguments);
  add_control_options(*verb, *arguments);
  add_learning_options(*verb, *arguments);
  add_safety_options(*verb, *arguments);
  arguments->scene.add_to(*verb);
  arguments->tuning.add_to(*verb);
  arguments->view.add_to(*verb);
  arguments->session.add_to(*verb);
  arguments->session.add_wait_to(*verb);
  arguments->session.add_support_to(*verb);

  return {verb, [verb, arguments](const Output& output) { return play_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
