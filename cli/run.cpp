#include "base/error.h"
#include "base/json_reader.h"
#include "base/stopwatch.h"
#include "base/units.h"
#include "cli/live_page.h"
#include "cli/path_options.h"
#include "cli/profile.h"
#include "cli/terminal.h"
#include "cli/tuning.h"
#include "devices/device_spec.h"
#include "metrics/assessment_summary.h"
#include "metrics/position_sense.h"
#include "metrics/reach_blocks.h"
#include "metrics/recorded_trial.h"
#include "player/calibration/device_identity.h"
#include "player/programme/programme_session.h"
#include "player/programme/training_screen.h"
#include "player/supporting_controller.h"

#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <set>
#include <unistd.h>

namespace haptrace::cli {
namespace {

namespace fs = std::filesystem;

struct RunArguments {
  SessionArguments session;
  std::string programme, folder, resume;
  ChangeArguments change;
  ProfileArguments profile;
  double max_deviation = 0.1;
  bool dry_run = false, fit = false;
  TuningArguments tuning{.example = "radius 6mm"};
  ViewArguments view;
};

constexpr std::string_view kPathMark = "{path}";

std::string figures_text(const nlohmann::json& figures) {
  std::string text;
  for (const char* name : {"contour_rms_m", "time_in_tunnel", "movement_time_s", "sparc", "reaction_time_s",
                           "lateral_deviation_m", "after_effect_m", "end_error_m", "adaptation_index", "adaptation_r",
                           "range_m", "press_force_n", "tracking_rms_m", "tracking_gain", "tracking_delay_s"}) {
    const std::optional<double> value = figure_in(figures, name);
    if (!value) continue;
    const TrialFigure& figure = trial_figure(name);
    text += fmt::format("{}{} {:.{}f}{}{}", text.empty() ? "" : ", ", figure.title, figure.scale * *value,
                        figure.digits, *figure.unit != '\0' ? " " : "", figure.unit);
  }
  return text;
}

std::string plan_text(const Programme& programme, const ProgrammePlan& plan) {
  std::string text = fmt::format("{}: {} repetitions, about {}\n", programme.title, plan.trials.size(),
                                 long_duration_text(plan.duration));
  if (programme.rounds > 1) text += fmt::format("  {} rounds\n", programme.rounds);
  text += fmt::format("  {:24} {:9} {:>11} {:>9} {:>9} {:>8} {:>8}\n", "exercise", "mode", "repetitions", "path",
                      "each", "rest", "test");
  for (std::size_t i = 0; i < plan.parts.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    const ProgrammePlan::Part& part = plan.parts[i];
    text += fmt::format("  {:24} {:9} {:>11} {:>6.0f} mm {:>7.1f} s {:>6.1f} s {:>8}\n",
                        exercise.name + (i < programme.warm_up.size() ? " (warm-up)" : ""), to_string(exercise.mode),
                        exercise.repetitions, 1e3 * part.path_length, part.trial, exercise.rest,
                        exercise.test == TestLabel::none ? "" : to_string(exercise.test));
  }
  const ProgrammeLimits& limits = programme.limits;
  if (limits.time > 0) text += fmt::format("  a sitting ends after {}\n", long_duration_text(limits.time));
  if (limits.force_dose > 0) text += fmt::format("  a sitting ends after {:.0f} N s of force\n", limits.force_dose);
  if (limits.fatigue)
    text += fmt::format("  a sitting ends when {} repetitions are worse than the best by {:.0f} % ({})\n",
                        limits.fatigue->repetitions, 100 * limits.fatigue->worse,
                        trial_figure(limits.fatigue->figure).title);
  return text;
}

/// Quotes a word for the shell.
std::string quoted(const std::string& word) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) return word;
  std::string result = "'";
  for (const char c : word) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

/// Returns the options of `config` that a folder must not set by itself, because it may come from anywhere: the device,
/// which may be a library to load, and safety limits other than the defaults. Each comes with its text for the command
/// line.
std::vector<std::pair<const CLI::Option*, std::string>> options_to_confirm(const CLI::App& verb,
                                                                           const nlohmann::json& config) {
  std::vector<std::pair<const CLI::Option*, std::string>> options;
  for (const CLI::Option* option : verb.get_options()) {
    const std::string name = option->get_lnames().empty() ? "" : option->get_lnames().front();
    if (name != "device" && option->get_group() != "Safety") continue;
    const auto found = config.find(name);
    if (found == config.end() || found->is_null()) continue;
    const std::string value = found->is_string() ? found->get<std::string>() : found->dump();
    const std::string usual = option->get_default_str();
    if (value != usual && !(nlohmann::json::parse(usual, nullptr, false) == *found))
      options.emplace_back(option, fmt::format("--{} {}", name, quoted(value)));
  }
  return options;
}

/// Returns the command that resumes a session that was started with `config`.
std::string resume_command(const CLI::App& verb, const nlohmann::json& config, const std::string& folder) {
  std::string command = "haptrace run --resume " + quoted(folder);
  for (const auto& [option, words] : options_to_confirm(verb, config)) command += " " + words;
  return command;
}

/// Throws Error(input) with the command to use, unless the command line repeats the options that the folder must not
/// set by itself.
void require_confirmed(const CLI::App& verb, const nlohmann::json& config, const std::string& folder) {
  for (const auto& [option, words] : options_to_confirm(verb, config))
    if (option->count() == 0)
      throw input_error(
          fmt::format("{}: the device and the safety limits of a session are not taken from its folder. This command "
                      "repeats those with which the session was started; check them first: {}",
                      folder, resume_command(verb, config, folder)));
}

/// Summarises the result; `resume` is the command that resumes the session.
std::string result_text(const ProgrammeResult& result, const std::string& folder, const std::string& resume) {
  const Sitting& sitting = result.log.sittings.back();
  const Programme programme = programme_from_json(result.log.programme, folder);
  std::size_t finished = 0;
  std::vector<std::string> partial;  // shares of the path
  for (const LoggedTrial& trial : result.log.trials) {
    const Exercise& exercise = programme.exercise(trial.exercise);
    const bool timed = exercise.reach && exercise.reach->goal != ReachGoal::target;  // may end with its time
    finished += trial.finished() || (timed && trial.partial()) ? 1 : 0;
    if (!trial.partial() || exercise.sense || timed) continue;
    const std::optional<double> share = figure_in(trial.figures, "completion");
    partial.push_back(share ? fmt::format("{:.0f} %", 100 * *share) : "without a share");
  }
  std::string text = fmt::format(
      "{}: {} repetitions done{}{}, {} in this sitting, force dose {:.0f} N s\n", folder, finished,
      partial.empty() ? "" : fmt::format(" and {} in part ({} of the path)", partial.size(), fmt::join(partial, ", ")),
      result.log.complete ? ", the programme is complete" : "", long_duration_text(sitting.duration),
      sitting.force_dose);
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const std::string& name = programme.exercise(i).name;
    for (const ReachBlockSummary& block : summarise_blocks(programme, i, result.log))
      text += fmt::format("  {}, {}\n", name, describe(block));
    if (const std::optional<AssessmentSummary> summary = summarise_assessment(programme, i, result.log))
      for (const std::string& line : describe(*summary)) text += fmt::format("  {}, {}\n", name, line);
    if (const std::optional<SenseSummary> summary = summarise_sense(programme, i, result.log))
      text += fmt::format("  {}, {}\n", name, describe(*summary));
  }
  if (!result.log.complete)
    text += fmt::format("  ended: {}{}{}; resume with: {}\n", sitting.ended_by, sitting.detail.empty() ? "" : ", ",
                        sitting.detail, resume);
  return text;
}

/// Returns the programme with the participant's settings from the command line.
nlohmann::json programme_for(const RunArguments& arguments) {
  nlohmann::json programme = load_json(arguments.programme);
  if (!programme.is_object() || (programme.contains("person") && !programme["person"].is_object())) return programme;
  nlohmann::json person = programme.value("person", nlohmann::json::object());
  arguments.change.set_keys(person);
  if (!person.empty()) programme["person"] = person;
  return programme;
}

/// Returns the configuration of a session, without options that concern only its start and without values that it
/// stores elsewhere. Later sittings and repetitions of a trial use this configuration.
nlohmann::json shared_config(const CLI::App& verb) {
  nlohmann::json config = effective_config(verb);
  for (const char* key : {"verb",         "programme",       "output",     "resume",    "dry-run",
                          "mirror",       "scale",           "rotate",     "about",     "offset",
                          "fit",          "profile",         "no-profile", "overwrite", "tune-socket",
                          "tune-port",    "tune-token-file", "tune-file",  "view",      "control",
                          "on-page-lost", "view-token-file", "no-browser"})
    config.erase(key);
  return config;
}

/// Rejects a complete session, and options that may only be given at the start.
void check_resume(const CLI::App& verb, const SessionLog& log, const std::string& folder) {
  if (log.complete) throw input_error(folder + ": the session is complete; there is nothing to resume");
  for (const char* option : {"--mirror", "--rotate", "--scale", "--about", "--offset", "--fit", "--output", "--profile",
                             "--no-profile", "--dry-run"})
    if (verb.get_option(option)->count() > 0)
      throw input_error(
          fmt::format("{} applies only to the start of a session; --resume keeps the settings of {}", option, folder));
}

/// Returns the folder that relative file names in the programme refer to.
std::string folder_of(const std::string& programme) {
  const fs::path folder = fs::path(programme).parent_path();
  return folder.empty() ? "." : folder.string();
}

/// Opens devices for trials: one for all trials, or one per trial if the device description has a place for the path.
class TrialDevices {
 public:
  /// `opened` is the number of repetitions in earlier sittings.
  TrialDevices(const SessionArguments& session, std::size_t opened, const std::string& folder)
      : session_(session), mark_(session.device.find(kPathMark)), opened_(opened) {
    if (mark_ != std::string::npos && folder.find(',') != std::string::npos)
      throw input_error(
          fmt::format("{}: a simulated trainee's path must not contain a comma; choose another folder", folder));
  }

  /// Returns the properties of the device, which are the same with and without a path.
  DeviceInfo info() { return mark_ == std::string::npos ? shared()->info() : open_with(without_path())->info(); }

  /// In passive exercises, a simulated participant has no intent. Otherwise the participant follows the path after the
  /// approach to its start, in reaches after the cue, and in cursor exercises at the pace of the cursor.
  std::shared_ptr<Device> open(const Exercise& exercise, const TrialSettings& settings, const std::string& path) {
    if (mark_ == std::string::npos) return shared();
    if (exercise.mode == ExerciseMode::passive || exercise.sense) return open_with(without_path());
    constexpr double kLed = 0.5;       // approximate duration of the approach [s]
    constexpr double kReaction = 0.4;  // to the cue, with the end of the pull to the start [s]
    std::string description = session_.device;
    description.replace(mark_, kPathMark.size(), path);
    add_option(description, "intent_after", kLed + (settings.start_hold ? *settings.start_hold + kReaction : 0));
    if (exercise.mode == ExerciseMode::cursor) add_option(description, "intent_speed", settings.pace);
    return open_with(std::move(description));
  }

 private:
  std::shared_ptr<Device> shared() {
    if (!device_) device_ = session_.open({}, opened_);  // in a later sitting another seed
    return device_;
  }

  /// Adds an option to the description, so that the recording contains it. An existing option takes precedence.
  template <class Number>
  static void add_option(std::string& description, const char* key, Number value) {
    if (DeviceSpec::parse(description).options.contains(key)) return;
    description += fmt::format("{}{}={}", description.find(':') == std::string::npos ? ':' : ',', key, value);
  }

  std::shared_ptr<Device> open_with(std::string description) {
    SessionArguments own = session_;
    // No real hand does the same in every repetition, so each gets another seed, which its recording contains.
    const std::uint64_t seed = session_.first_seed() + opened_++;
    for (const char* given : {":seed=", ",seed="})
      if (const std::size_t at = description.find(given); at != std::string::npos)
        description = without_option(std::move(description), at + 1);
    add_option(description, "seed", seed);
    own.device = std::move(description);
    own.seed.reset();
    device_.reset();
    return device_ = own.open();
  }

  /// Returns the description without the option that takes the path.
  [[nodiscard]] std::string without_path() const {
    if (session_.device.find_last_of(",:", mark_) == std::string::npos)
      throw input_error(fmt::format("--device {}: {} must be the value of an option, as in intent={}", session_.device,
                                    kPathMark, kPathMark));
    return without_option(session_.device, mark_);
  }

  /// Returns the description without the option that contains the character at `within`.
  static std::string without_option(std::string description, std::size_t within) {
    const std::size_t begin = description.find_last_of(",:", within), end = description.find(',', within);
    const bool first = description[begin] == ':';
    description.erase(begin, end == std::string::npos ? end : end - begin);
    if (first && end != std::string::npos) description[begin] = ':';
    return description;
  }

  const SessionArguments& session_;
  std::size_t mark_;  ///< position of the path's placeholder in the description
  std::shared_ptr<Device> device_;
  std::uint64_t opened_;
};

/// Returns the options of the commands of all repetitions.
LiveSession::Options command_options(const ProgrammeOptions& options, StopRequest& stop) {
  return {.annotations = options.session.recording->options.annotations, .stop = &stop, .programme = true};
}

/// Returns the log of the session to resume, and sets the options with which it began. Throws Error(input) when they
/// differ from those given, or the session cannot be resumed.
SessionLog resumed(CLI::App& verb, const RunArguments& arguments, const std::string& folder) {
  SessionLog log = load_session_log(folder);
  check_resume(verb, log, folder);
  if (const std::string& asked = arguments.session.subject; !asked.empty() && asked != log.subject)
    throw input_error(fmt::format("{} is a session of '{}', not of '{}'", folder, log.subject, asked));
  require_confirmed(verb, log.config, folder);
  apply_config(verb, log.config, folder);
  return log;
}

/// Shows a programme on the terminal and on the page while it runs.
class ProgrammeScreen {
 public:
  /// Borrows everything. Without a plan, the length of a repetition is unknown.
  ProgrammeScreen(const Programme& programme, const std::optional<ProgrammePlan>& plan, const SessionLog& log,
                  LiveGuidance& commands, LivePage& page, const Output& output)
      : programme_(programme), plan_(plan), shown_(log), commands_(commands), page_(page), output_(output) {}

  /// Is told of every step from now on.
  void watch(ProgrammeOptions& options) {
    options.announces = [this](const TrainingTrial& trial) {
      page_.training([&](TrainingProgress& screen) { screen.begin(trial); });
    };
    options.begins = [this](const ScheduledTrial& trial, const TrialSettings& settings, std::size_t number,
                            std::size_t of) { begin(trial, settings, number, of); };
    options.ended = [this](const LoggedTrial& trial) { end(trial); };
    options.rests = [this](double left) { rest(left); };
    options.asks = [this](double left) { return ask(left); };
  }

  void finish(bool complete) {
    page_.training([&](TrainingProgress& screen) { screen.finish(!complete); });
    clear();
  }

  /// Returns the expected duration of the present repetition [s]; 0: unknown.
  [[nodiscard]] double expected() const noexcept { return expected_; }

 private:
  void begin(const ScheduledTrial& trial, const TrialSettings& settings, std::size_t number, std::size_t of) {
    const Exercise& exercise = programme_.exercise(trial.exercise);
    clear();
    output_.remark(
        fmt::format("{} of {}: {}, repetition {}{} ({})", number, of, exercise.name, trial.repetition,
                    programme_.rounds > 1 ? fmt::format(", round {}", trial.round) : "",
                    trial.reach ? describe(*exercise.reach, *trial.reach) : settings_text(exercise, settings)));
    expected_ = plan_ ? plan_->parts[trial.exercise].trial : 0;
    progress_.current = trial.exercise;
    show();
  }

  void end(const LoggedTrial& trial) {
    clear();
    (void)commands_.answer_of(false);
    if (const std::string text = figures_text(trial.figures); !text.empty() && !trial.sense)
      output_.remark((trial.figures.contains("at_limit") ? "  at least: " : "  ") + text);
    for (const char* key : {"refused", "at_limit"})
      if (trial.figures.is_object() && trial.figures.contains(key))
        output_.remark("  " + trial.figures[key].get<std::string>());
    // The participant may read this: whether the answer was right would teach.
    if (trial.sense) output_.remark(trial.sense->answer == 0 ? "  no answer" : "  answered");
    page_.training([&](TrainingProgress& screen) { screen.end(trial, shown_.trials); });
    shown_.trials.push_back(trial);
    show();
  }

  void rest(double left) {
    page_.training([&](TrainingProgress& screen) { screen.rest(left); });
    show();
    if (!live_) return;
    if (std::isnan(left))
      show_line("paused; p resumes");
    else
      show_line(fmt::format("rest {:.0f} s", left));
  }

  int ask(double left) {
    page_.training([&](TrainingProgress& screen) { screen.ask(left); });
    show();
    if (live_) show_line(fmt::format("which place was farther? 1: first, 2: second ({:.0f} s)", left));
    return commands_.answer_of(true);
  }

  void show() {
    progress_.paused = commands_.paused();
    progress_.elapsed = watch_.seconds();
    page_.programme(programme_message(programme_, shown_, progress_));
  }

  void clear() const {
    if (live_) clear_line();
  }

  const Programme& programme_;
  const std::optional<ProgrammePlan>& plan_;
  SessionLog shown_;  ///< the log as the page shows it
  LiveGuidance& commands_;
  LivePage& page_;
  const Output& output_;
  const bool live_ = !output_.quiet && isatty(STDERR_FILENO) != 0;
  const Stopwatch watch_;
  ProgrammeProgress progress_;
  double expected_ = 0;
};

/// Throws Error(input) unless the command line names a programme or a session to resume, without contradictions.
void check_arguments(const RunArguments& arguments) {
  const bool resumes = !arguments.resume.empty();
  if (resumes == !arguments.programme.empty())
    throw input_error(resumes ? "--resume uses the programme of the session; do not name another one"
                              : "haptrace run needs PROGRAMME.json, or --resume FOLDER; see haptrace run --help");
  arguments.profile.check();
  if (arguments.dry_run && resumes)
    throw input_error("--dry-run prints the plan of a new session; haptrace report shows what --resume would continue");
  if (arguments.dry_run && arguments.fit && arguments.session.device.empty())
    throw input_error("--fit needs the workspace of a device: give --device too");
}

/// Returns the folder of the session.
std::string session_folder(const RunArguments& arguments) {
  if (!arguments.resume.empty()) return arguments.resume;
  if (!arguments.folder.empty()) return arguments.folder;
  return fs::path(arguments.programme).replace_extension().string() + "-session";
}

/// Returns the plan of a new session after printing its notes. Without a device, its workspace is unknown.
ProgrammePlan noted_plan(const RunArguments& arguments, const Programme& programme,
                         const std::optional<DeviceInfo>& device, const Output& output) {
  ProgrammePlan plan = plan_programme(programme, folder_of(arguments.programme), arguments.programme,
                                      device ? &*device : nullptr, arguments.fit);
  for (const std::string& note : plan.notes) output.remark(note);
  return plan;
}

/// Prints the warnings about the supports of the arm that a real run of the programme would have on the device. The
/// weight of an arm, and so a share of it, is not known yet.
void note_supports(const Programme& programme, const DeviceInfo& device, SessionOptions session, const Output& output) {
  std::set<std::string> printed;
  for (std::size_t i = 0; i < programme.size(); ++i) {
    session.support = {.force = support_of(programme, i).force, .up = programme.up};
    if (session.support.force == 0) continue;
    for (const std::string& text : plan_support(device, session).warnings)
      if (printed.insert(text).second) output.warn({Severity::warning, "support", kNaN, text});
  }
}

/// Prints the plan and the warnings that a real run would have, and returns the exit code.
int dry_run(const RunArguments& arguments, const Programme& programme, const ProgrammePlan& plan,
            const std::optional<DeviceInfo>& device, const Output& output) {
  if (device) note_supports(programme, *device, arguments.session.options("", {}), output);
  output.tell(to_json(plan, programme), plan_text(programme, plan));
  return kDone;
}

/// Prints the notes of the device, and a warning if its time does not wait for answers to the programme's questions.
void note_device(const RunArguments& arguments, const Programme& programme, const DeviceInfo& device,
                 const Output& output) {
  for (const std::string& note : device.notes) output.remark(note);
  bool asks = false;
  for (std::size_t i = 0; i < programme.size(); ++i) asks |= programme.exercise(i).sense.has_value();
  if (asks && device.virtual_time && arguments.session.clock != "real")
    output.warn({Severity::warning, "plan", kNaN,
                 "in virtual time a question does not wait for an answer: add --clock real to answer"});
}

/// Returns the device's profile. The profile from the start of a session applies to all of it.
std::optional<DeviceProfile> session_profile(const RunArguments& arguments, const DeviceInfo& device,
                                             const std::string& folder, const Output& output) {
  if (arguments.resume.empty()) return arguments.profile.find(device, arguments.session.rate_hz, output);
  const std::string kept = (fs::path(folder) / kSessionProfile).string();
  if (!fs::exists(kept)) return std::nullopt;
  return profile_for(device, kept, arguments.session.rate_hz, output);
}

/// Returns the exit code of a sitting, and prints why it ended.
int conclude_sitting(const ProgrammeResult& result, const StopRequest& stop, const Output& output) {
  const bool skipped = !result.log.trials.empty() && result.log.trials.back().skipped();
  int code = result.last && !skipped ? conclude(output, *result.last) : kDone;
  // The programme itself ended a repetition at its force dose.
  if (code == kInterrupted && stop.count() == 0 && result.log.sittings.back().ended_by == "force_dose") code = kDone;
  if (code == kDone && stop.count() > 0) code = kInterrupted;
  return code;
}

/// Runs the verb and returns its exit code.
int run_command(CLI::App& verb, RunArguments& arguments, const Output& output) {
  check_arguments(arguments);
  const bool resumes = !arguments.resume.empty();
  const std::string folder = session_folder(arguments);
  std::optional<SessionLog> log;
  if (resumes) log = resumed(verb, arguments, folder);
  const nlohmann::json json = resumes ? log->programme : programme_for(arguments);
  const std::string where = resumes ? folder : arguments.programme;
  const Programme programme = programme_from_json(json, where);

  const Signals signals;
  StopRequest stop(&signals.stop());
  LivePage page(arguments.view, arguments.session, output, "run", stop);
  TrialDevices devices(arguments.session, resumes ? log->trials.size() : 0, folder);
  std::optional<DeviceInfo> device;
  if (!arguments.session.device.empty()) device = devices.info();
  std::optional<ProgrammePlan> plan;
  if (!resumes) plan = noted_plan(arguments, programme, device, output);
  if (arguments.dry_run) return dry_run(arguments, programme, *plan, device, output);
  require(verb, "--device");
  note_device(arguments, programme, *device, output);

  ProgrammeOptions options{
      .folder = folder,
      .session = arguments.session.options((fs::path(folder) / "trial.h5").string(), shared_config(verb)),
      .max_deviation = arguments.max_deviation,
      .open = [&](const Exercise& exercise, const TrialSettings& settings, const std::string& path) {
        return devices.open(exercise, settings, path);
      }};
  note_limits(output, options.session, *device);
  options.profile = session_profile(arguments, *device, folder, output);
  if (options.profile) take_motor_limit(*options.profile, *device, output, options.session);
  if (!resumes) log = begin_session(json, where, *plan, *device, options);

  page.watch(options.session);
  page.expect_more(true);  // the end of the programme is release()
  LiveGuidance commands(command_options(options, stop));
  options.live = &commands;
  const LivePage::Use use(page, commands);
  const TuningInputs inputs(arguments.tuning, commands);
  for (const std::string& hint : inputs.hints()) output.remark(hint);
  const Keys keys(options.session.recording->options.annotations, arguments.session.mark_texts, arguments.session.keys,
                  commands, Keys::guide_keys());
  ProgrammeScreen screen(programme, plan, *log, commands, page, output);
  screen.watch(options);
  const Progress progress = [&](const SessionView& view) {
    progress_bar(output, screen.expected(), &keys, &commands)(view);
  };
  const ProgrammeResult result = run_programme(options, stop, progress);
  screen.finish(result.log.complete);

  nlohmann::json answer = to_json(result);
  answer["folder"] = folder;
  answer["tuning"] = commands.history();
  const int code = conclude_sitting(result, stop, output);
  output.tell(answer, result_text(result, folder, resume_command(verb, shared_config(verb), folder)));
  return code;
}

}  // namespace

Verb add_run(CLI::App& app) {
  const auto arguments = std::make_shared<RunArguments>();
  CLI::App* verb = app.add_subcommand("run", "run a programme of exercises; one recording per repetition");
  verb->footer(
      "A programme is a JSON file (docs/programmes.md; examples in samples/programmes). The session is a folder\n"
      "with session.json, a recording of every repetition and the paths that were followed; haptrace report shows it.\n"
      "Keys: p pauses after the repetition and resumes; s skips, a repeats a repetition; + - stiffer or softer walls;\n"
      "w n wider or narrower tunnel; r resets; m or space sets a mark, 1 to 9 a mark with one of --mark-texts, t a\n"
      "mark with a typed text; q ends the session. --resume continues it later, even on another day.\n"
      "  haptrace run samples/programmes/reaching.json --dry-run\n"
      "  haptrace run samples/programmes/reaching.json -d falcon --subject P07 --mirror x -o p07-monday\n"
      "  haptrace run --resume p07-monday -d falcon\n"
      "  haptrace run samples/programmes/lesson.json -d 'sim:preset=falcon,hand=relaxed,intent={path}' -o try");
  verb->add_option("programme", arguments->programme, "programme to run")->type_name("PROGRAMME.json");
  verb->add_option("-o,--output", arguments->folder, "folder of the session (default: PROGRAMME-session)")
      ->type_name("FOLDER");
  verb->add_option("--resume", arguments->resume,
                   "resume an unfinished session; give the device and all changed limits again")
      ->type_name("FOLDER");
  verb->add_flag("--dry-run", arguments->dry_run, "print the plan and its duration; with --device, also check it");
  arguments->change.add_to(*verb, "Participant");
  verb->add_flag("--fit", arguments->fit, "move and scale all paths together into the workspace")->group("Participant");
  verb->add_option("--max-deviation", arguments->max_deviation, "distance from the path at which the session stops [m]")
      ->capture_default_str()
      ->group("Safety");
  arguments->profile.add_to(*verb, "Safety", "run without a device profile");
  arguments->tuning.add_to(*verb, false);
  arguments->view.add_to(*verb);
  arguments->session.add_to(*verb);
  arguments->session.add_wait_to(*verb);

  return {verb, [verb, arguments](const Output& output) { return run_command(*verb, *arguments, output); }};
}

}  // namespace haptrace::cli
