#include "player/programme/programme_session.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "base/rfc3339.h"
#include "base/stopwatch.h"
#include "base/units.h"
#include "control/event_words.h"
#include "control/norm.h"
#include "control/path/min_jerk.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "metrics/assessment_summary.h"
#include "metrics/position_sense.h"
#include "metrics/reach_blocks.h"
#include "metrics/recorded_trial.h"
#include "player/calibration/device_identity.h"
#include "player/device_path.h"
#include "player/guidance/guide.h"
#include "player/playback/playback.h"
#include "player/programme/progression.h"
#include "player/programme/reach_order.h"
#include "player/programme/reach_session.h"
#include "player/programme/trial_order.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <iterator>
#include <random>
#include <set>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

constexpr double kApproachSpeed = 0.1;            // peak speed of the approach [m/s]
constexpr double kGuidedTimes = 5;                // time limit of a repetition, in durations of the path ...
constexpr double kGuidedGrace = 10;               // ... plus this [s]
constexpr const char* kForceDose = "force_dose";  // end of a sitting, and of the repetition in which it happened
constexpr double kLeastAssistance = 0.01;         // below this there is no assistance
constexpr double kUsualReach = 0.6;               // duration of a straight reach, for plans and simulated hands [s]

std::string now_text() {
  return rfc3339(std::chrono::system_clock::now());
}

/// Returns a name that is valid in every file system.
std::string file_name(const std::string& name) {
  std::string result;
  for (const char c : name) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (plain)
      result += c;
    else if (!result.empty() && result.back() != '-')
      result += '-';
  }
  constexpr std::size_t kLongest = 40;
  result = result.substr(0, kLongest);
  while (!result.empty() && result.back() == '-') result.pop_back();
  return result;
}

/// Integrates the magnitude of the force, ends the repetition when the sitting's dose is reached, and detects the end
/// of the time limit.
class TrialWatch final : public SampleSink {
 public:
  /// Raises `end` when the dose reaches `limit` [N s]; 0: no limit.
  TrialWatch(double limit, StopRequest& end) noexcept : limit_(limit), end_(end) {}

  void push(const Sample& sample) noexcept override {
    if (last_ns_) dose_ += 1e-9 * static_cast<double>(sample.time_ns - *last_ns_) * force_;
    last_ns_ = sample.time_ns;
    force_ = norm_of(sample.force);
    if (limit_ <= 0 || dose_ < limit_ || over_.load(std::memory_order_relaxed)) return;
    over_.store(true, std::memory_order_relaxed);
    end_.raise();
  }
  void push(const Event& event) noexcept override {
    // While a device is lost or silent, no force acts.
    if (event.code == EventCode::device_lost || event.code == EventCode::states_stopped) force_ = 0;
    if (event.code != EventCode::time_over) return;
    time_over_ = true;
    without_cue_ = std::isfinite(event.values[2]);
  }
  [[nodiscard]] double dose() const noexcept { return dose_; }  ///< [N s]
  [[nodiscard]] bool time_over() const noexcept { return time_over_; }
  [[nodiscard]] bool without_cue() const noexcept { return without_cue_; }  ///< the hand did not hold in the start
  [[nodiscard]] bool dose_reached() const noexcept { return over_.load(std::memory_order_relaxed); }  ///< any thread

 private:
  std::optional<std::int64_t> last_ns_;
  double limit_;
  StopRequest& end_;
  std::atomic<bool> over_{false};
  double force_ = 0, dose_ = 0;
  bool time_over_ = false, without_cue_ = false;
};

ScheduledTrial scheduled(const Programme& programme, const PlannedTrial& trial) {
  const Exercise& exercise = programme.exercise(trial.exercise);
  return {trial.exercise,   trial.round,
          trial.repetition, exercise.rest + (trial.repetition == exercise.repetitions ? exercise.rest_after : 0),
          trial.reach,      trial.sense};
}

double length_of(const Path& path) {
  double length = 0;
  for (std::size_t i = 1; i < path.size(); ++i) length += (path.position[i] - path.position[i - 1]).norm();
  return length;
}

double time_limit_of(const Exercise& exercise, double path_duration) {
  return exercise.time_limit > 0 ? exercise.time_limit : kGuidedTimes * path_duration + kGuidedGrace;
}

/// Returns the expected duration of a repetition [s].
double expected_time(const Exercise& exercise, const Path& path) {
  if (exercise.reach) {
    const ReachTask& task = *exercise.reach;
    constexpr double kReaction = 0.3, kBack = 1, kUsualRange = 2;  // [s]
    const double before = kBack + 0.5 * (task.least_start_hold + task.most_start_hold);
    if (is_held(task.goal) || task.goal == ReachGoal::track) return before + exercise.time_limit + exercise.hold;
    const double movement = task.goal == ReachGoal::range ? kUsualRange : kUsualReach;
    return before + kReaction + movement + task.target_hold + exercise.hold;
  }
  if (exercise.sense) {
    constexpr double kAnswer = 2, kBefore = 0.5;  // [s]
    return kBefore + exercise.sense->duration() + exercise.hold + kAnswer;
  }
  const bool has_pace = exercise.mode == ExerciseMode::passive || exercise.mode == ExerciseMode::assisted ||
                        exercise.mode == ExerciseMode::cursor;
  const double way_back = (path.position.front() - path.position.back()).norm();
  constexpr double kShortest = 0.5;  // [s]
  return std::max(kShortest, MinJerk::kPeakSpeed * way_back / kApproachSpeed) +
         path.duration() / (has_pace ? exercise.pace : 1) + exercise.hold;
}

/// Returns a note if catch trials are so many that they teach, too.
std::optional<std::string> note_on_catch_trials(const Programme& programme) {
  constexpr double kMost = 0.2;
  int catches = 0, all = 0;
  for (const Exercise& exercise : programme.exercises) {
    all += exercise.repetitions;
    if (exercise.catch_trial) catches += exercise.repetitions;
  }
  if (catches <= kMost * all) return std::nullopt;
  return fmt::format("{} of {} repetitions of a round are catch trials; above 20 % they disturb what the others teach",
                     catches, all);
}

/// Returns the index of a target in the path of a reaching exercise, see path_of().
std::size_t place_of_target(int target) {
  return 2 * static_cast<std::size_t>(target) + 1;
}

/// Returns the file of a movement of movements_of(), beside the exercise's path.
std::string movement_file(const std::string& path, int movement) {
  return (fs::path(path).parent_path() / fmt::format("{}-target-{}.h5", fs::path(path).stem().string(), movement + 1))
      .string();
}

/// Returns a minimum-jerk movement from the start to a target, or that of the target itself. A simulated hand can
/// intend it.
Path movement_to(const Exercise& exercise, const Path& places, int target) {
  constexpr double kStep = 0.01;  // [s]
  const Vec3 start = places.position.front(), way = places.position.at(place_of_target(target)) - start;
  Path path{.name = fmt::format("target {}", target + 1)};
  if (exercise.reach->goal == ReachGoal::weigh) {
    path.time = {0, exercise.time_limit};
    path.position = {start, start};
    return path;
  }
  if (exercise.reach->goal == ReachGoal::track) {
    for (int i = 0; i * kStep <= exercise.time_limit; ++i) {
      path.time.push_back(i * kStep);
      path.position.push_back(start + exercise.reach->track.at(i * kStep) * way);
    }
    return path;
  }
  for (int i = 0; i * kStep <= kUsualReach + 0.5 * kStep; ++i) {
    path.time.push_back(i * kStep);
    path.position.push_back(start + MinJerk::at(i * kStep / kUsualReach).s * way);
  }
  return path;
}

/// Returns the task of an exercise in the coordinates of its placed path, see path_of().
SenseTask placed(const SenseTask& task, const Path& path) {
  SenseTask result = task;
  result.start = path.position.front();
  result.axis = (path.position.back() - path.position.front()) / (task.reference + task.differences.back());
  return result;
}

/// Returns the movements that the trials of an exercise choose from: to each target, or of each pair of places. Others
/// have none.
std::vector<Path> movements_of(const Exercise& exercise, const Path& path) {
  std::vector<Path> movements;
  if (exercise.reach)
    for (int target = 0; target < static_cast<int>(exercise.reach->targets.size()); ++target)
      movements.push_back(movement_to(exercise, path, target));
  if (exercise.sense) {
    const SenseTask task = placed(*exercise.sense, path);
    for (int pair = 0; pair < static_cast<int>(task.pairs().size()); ++pair)
      movements.push_back(path_of_pair(task, pair));
  }
  return movements;
}

/// Returns the part of an exercise's path that the hand must reach: the targets of a range, a press and a weight are
/// directions.
Path reached_part(const Exercise& exercise, const Path& path) {
  const bool places =
      !exercise.reach || exercise.reach->goal == ReachGoal::target || exercise.reach->goal == ReachGoal::track;
  if (places) return path;
  return {.name = path.name, .time = {path.time.front()}, .position = {path.position.front()}};
}

/// Checks that the device has the motors and sensors of an exercise. Throws Error(input).
void check_means(const Exercise& exercise, const Path& path, const DeviceInfo& device, const std::string& where) {
  try {
    if (exercise.sense) check_motors(device, (path.position.back() - path.position.front()).normalized(), "it");
    if (!exercise.reach || !is_held(exercise.reach->goal)) return;
    for (int target = 0; target < static_cast<int>(exercise.reach->targets.size()); ++target)
      check_press(device, path.position.at(place_of_target(target)) - path.position.front(), exercise.reach->locked);
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: '{}': {}", where, exercise.name, error.what()));
  }
}

/// Fits all paths with one transformation, so that they keep their positions relative to each other.
std::optional<Fit> fit_together(const Programme& programme, std::vector<Path>& paths, const DeviceInfo& device) {
  const Box workspace = workspace_of(device);
  Box bounds;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const Box own = reached_part(programme.exercise(i), paths[i]).bounds();
    bounds.include(own.min);
    bounds.include(own.max);
  }
  for (int axis = 0; axis < 3; ++axis)
    if (!device.force_axes[static_cast<std::size_t>(axis)])
      bounds.min[axis] = bounds.max[axis] = workspace.center()[axis];
  if (distance_outside(bounds.min, workspace) == 0 && distance_outside(bounds.max, workspace) == 0) return std::nullopt;
  const Fit fit = fit_into(bounds, workspace);
  for (Path& path : paths) apply(fit, path);
  return fit;
}

/// Result of one repetition.
struct TrialRun {
  SessionResult session;
  std::vector<std::string> notes;
  std::optional<double> stiffness;  ///< stiffness of the walls as applied [N/m]
  std::optional<Initiation> initiation;
  std::optional<ReachTrial> places = {};  ///< of a trial with a cue, with what the device decided
};

class ProgrammeRun {
 public:
  ProgrammeRun(const ProgrammeOptions& options, const StopRequest& stop, const Progress& progress)
      : lock_(options.folder),
        result_{.log = load_session_log(options.folder), .last = {}},
        programme_(programme_from_json(result_.log.programme, options.folder)),
        options_(options),
        stop_(stop),
        progress_(progress) {
    for (std::size_t i = 0; i < programme_.size(); ++i) {
      states_.emplace_back(programme_.exercise(i));
      paths_.push_back(load_path(file(result_.log.paths[i])));
      curves_.push_back(path_of(paths_.back()));
    }
    for (const LoggedTrial& trial : result_.log.trials)
      if (measures(trial)) states_[trial.exercise].learn(trial);
    if (options_.profile) identified_ = options_.profile->identified();
  }

  ProgrammeResult run() {
    log().sittings.push_back({.began = now_text(), .first_trial = log().trials.size()});
    save();
    try {
      go_through();
    } catch (const Error& error) {
      // A start that was refused is no sitting.
      if (error.kind() == Error::Kind::input && sitting().duration == 0)
        withdraw();
      else
        note_failure(error.what());
      throw;
    } catch (const std::exception& error) {
      note_failure(error.what());
      throw;
    }
    return std::move(result_);
  }

 private:
  [[nodiscard]] SessionLog& log() noexcept { return result_.log; }
  [[nodiscard]] Sitting& sitting() noexcept { return log().sittings.back(); }
  [[nodiscard]] std::string file(const std::string& name) const { return (fs::path(options_.folder) / name).string(); }
  [[nodiscard]] std::string absolute(const std::string& name) const { return fs::absolute(file(name)).string(); }
  void save() { save_session_log(log(), options_.folder); }

  /// Writes the error to the log. A failure to write the log must not hide the error.
  void note_failure(const std::string& why) noexcept try {
    if (log().trials.size() > sitting().first_trial && log().trials.back().stopped_by.empty()) {
      log().trials.back().stopped_by = "fault";
      log().trials.back().detail = why;
    }
    end("stopped", why);
  } catch (...) {
  }

  /// Takes this sitting out of the log. A failure to write the log must not hide the error.
  void withdraw() noexcept try {
    log().trials.resize(sitting().first_trial);
    log().sittings.pop_back();
    save();
  } catch (...) {
  }

  void end(const char* reason, std::string detail) {
    sitting().ended = now_text();
    sitting().ended_by = reason;
    sitting().detail = std::move(detail);
    save();
  }

  /// Returns all trials. The log keeps a random order, so that another version resumes the session as it began.
  [[nodiscard]] std::vector<ScheduledTrial> whole_schedule() const {
    if (result_.log.schedule.empty()) return schedule(programme_);
    std::vector<ScheduledTrial> trials;
    for (const PlannedTrial& trial : result_.log.schedule) trials.push_back(scheduled(programme_, trial));
    trials.back().rest = 0;
    return trials;
  }

  /// Returns the remaining trials. Every further sitting starts with the warm-up again.
  [[nodiscard]] std::vector<ScheduledTrial> left() {
    const int number = static_cast<int>(log().sittings.size());
    std::vector<ScheduledTrial> trials;
    for (ScheduledTrial trial : whole_schedule()) {
      if (trial.exercise < programme_.warm_up.size()) trial.round = number;
      if (!is_done(trial)) trials.push_back(trial);
    }
    const bool only_warm_up = std::all_of(trials.begin(), trials.end(), [&](const ScheduledTrial& trial) {
      return trial.exercise < programme_.warm_up.size();
    });
    return only_warm_up ? std::vector<ScheduledTrial>{} : trials;
  }

  static bool same(const LoggedTrial& logged, const ScheduledTrial& trial) {
    return logged.exercise == trial.exercise && logged.round == trial.round && logged.repetition == trial.repetition;
  }

  [[nodiscard]] bool is_done(const ScheduledTrial& trial) const {
    return std::any_of(result_.log.trials.begin(), result_.log.trials.end(),
                       [&](const LoggedTrial& logged) { return same(logged, trial) && logged.done(); });
  }

  /// Returns true if a trial measures the participant's skill: it was done, by the participant's own hand.
  static bool measures(const LoggedTrial& trial) {
    return trial.done() && !trial.skipped() && trial.input.empty() && !trial.unattended;
  }

  /// Sets the attempt's number and a file name that does not exist yet.
  void name_attempt(const ScheduledTrial& scheduled, LoggedTrial& trial) const {
    trial.attempt =
        1 + static_cast<int>(std::count_if(result_.log.trials.begin(), result_.log.trials.end(),
                                           [&](const LoggedTrial& logged) { return same(logged, scheduled); }));
    const std::string stem =
        fmt::format("{:02}-{}-{:02}-{:03}", trial.exercise + 1, file_name(programme_.exercise(trial.exercise).name),
                    trial.round, trial.repetition);
    for (int again = trial.attempt - 1;; ++again) {
      trial.file = again > 0 ? fmt::format("{}-again-{}.h5", stem, again) : stem + ".h5";
      if (!fs::exists(file(trial.file))) return;
    }
  }

  void go_through() {
    std::vector<ScheduledTrial> trials = left();
    for (std::size_t i = 0; i < trials.size(); ++i) {
      if (!wait_while_paused()) return interrupted();
      // Asked for in the rest or the pause.
      if (i > 0 && options_.live != nullptr && options_.live->take_repeat()) repeat(trials, i - 1);
      if (options_.announces) options_.announces(training_trial(trials, i));
      if (options_.begins) options_.begins(trials[i], next_settings(trials[i].exercise), i + 1, trials.size());
      const SessionResult& session = run_trial(trials[i]);
      if (options_.ended) options_.ended(log().trials.back());
      const bool skipped = log().trials.back().skipped();
      if (log().trials.back().stopped_by == kForceDose) return end(kForceDose, dose_text());
      if (session.servo.cause == StopCause::interrupted && !skipped) return interrupted();
      if (session.servo.cause != StopCause::finished && !skipped) return end("stopped", session.servo.detail);
      if (!session.recorded_all())
        return end("stopped", "the recording could not be completed: " + session.recording_error);
      // A stop in the question of the last trial is no answer.
      if (stop_.count() > 0 && !log().trials.back().done()) return interrupted();
      if (options_.live != nullptr && options_.live->take_repeat()) repeat(trials, i);
      if (i + 1 == trials.size()) break;
      if (programme_.limits.force_dose > 0 && sitting().force_dose >= programme_.limits.force_dose)
        return end(kForceDose, dose_text());
      if (would_pass_time(trials[i].rest, trials[i + 1]))
        return end("time", "the time limit of the sitting is reached");
      if (tired(trials[i].exercise))
        return end("fatigue",
                   fmt::format("the last {} repetitions of '{}' were worse than the best before them by more "
                               "than {:.0f} %",
                               programme_.limits.fatigue->repetitions, programme_.exercise(trials[i].exercise).name,
                               100 * programme_.limits.fatigue->worse));
      if (!rest(trials[i].rest)) return interrupted();
    }
    log().complete = true;
    end("complete", "");
  }

  [[nodiscard]] std::string dose_text() {
    return fmt::format("{:.4g} N s of {:.4g}", sitting().force_dose, programme_.limits.force_dose);
  }

  /// Ends the sitting because something asked for it, which the programme or the repetition knows.
  void interrupted() {
    const bool within = stop_.count() == 0 && result_.last;
    const StopSource source = within ? result_.last->servo.stopped_from : stop_.source();
    sitting().stopped_from = to_string(source);
    end("interrupted", source == StopSource::user ? "" : interruption_text(source));
  }

  [[nodiscard]] TrainingTrial training_trial(const std::vector<ScheduledTrial>& trials, std::size_t i) const {
    const ScheduledTrial& trial = trials[i];
    const Exercise& exercise = programme_.exercise(trial.exercise);
    return {.exercise = exercise.name,
            .mode = to_string(exercise.mode),
            .number = i + 1,
            .of = trials.size(),
            .repetition = trial.repetition,
            .repetitions = exercise.repetitions,
            .show = shown_parts(programme_, trial.exercise, trial.round, trial.repetition),
            .next = i + 1 < trials.size() ? programme_.exercise(trials[i + 1].exercise).name : ""};
  }

  /// Schedules trial `i` once more, directly after itself.
  void repeat(std::vector<ScheduledTrial>& trials, std::size_t i) const {
    ScheduledTrial again = trials[i];
    // The last repetition had no rest after it.
    trials[i].rest = std::max(trials[i].rest, programme_.exercise(again.exercise).rest);
    trials.insert(trials.begin() + static_cast<std::ptrdiff_t>(i) + 1, again);
  }

  [[nodiscard]] bool would_pass_time(double rest, const ScheduledTrial& trial) {
    return programme_.limits.time > 0 &&
           sitting().duration + rest + expected_time(programme_.exercise(trial.exercise), paths_[trial.exercise]) >
               programme_.limits.time;
  }

  [[nodiscard]] bool tired(std::size_t exercise) {
    if (!programme_.limits.fatigue || programme_.exercise(exercise).test != TestLabel::none) return false;
    std::vector<nlohmann::json> figures;
    for (std::size_t i = sitting().first_trial; i < log().trials.size(); ++i)
      if (const LoggedTrial& trial = log().trials[i]; trial.exercise == exercise && measures(trial))
        figures.push_back(trial.finished() ? trial.figures : nlohmann::json());
    return is_tired(*programme_.limits.fatigue, figures);
  }

  /// Returns false when a stop was requested meanwhile.
  bool wait_while_paused() {
    while (options_.live != nullptr && options_.live->paused() && stop_.count() == 0) sitting().duration += idle(kNaN);
    return stop_.count() == 0;
  }

  bool rest(double seconds) {
    if (virtual_) {
      sitting().duration += seconds;
      return stop_.count() == 0;
    }
    for (double left = seconds; left > 0 && stop_.count() == 0;) {
      const double passed = idle(left);
      sitting().duration += passed;
      left -= passed;
    }
    return stop_.count() == 0;
  }

  /// Sleeps for a moment and returns its duration [s].
  double idle(double seconds_left) {
    if (options_.rests) options_.rests(seconds_left);
    return wait_a_moment(seconds_left);
  }

  /// Sleeps for a tenth of a second, or less if less is left, and returns the duration [s].
  static double wait_a_moment(double seconds_left) {
    const Stopwatch watch;
    constexpr double kStep = 0.1;  // [s]
    std::this_thread::sleep_for(
        std::chrono::duration<double>(std::isnan(seconds_left) ? kStep : std::min(kStep, seconds_left)));
    return watch.seconds();
  }

  /// Waits for the participant's answer. Returns 0 if there is none within `patience` [s] or before a stop.
  int ask(double patience) {
    if (!options_.asks) return 0;
    for (double left = patience; left > 0 && stop_.count() == 0;) {
      if (const int answer = options_.asks(left); answer != 0 || virtual_) return answer;
      const double passed = wait_a_moment(left);
      sitting().duration += passed;
      left -= passed;
    }
    return 0;
  }

  /// Returns the file of the path of a trial, relative to the session's folder.
  [[nodiscard]] std::string path_of_trial(const LoggedTrial& trial) const {
    const std::string& path = result_.log.paths[trial.exercise];
    if (trial.reach) return movement_file(path, trial.reach->target);
    return trial.sense ? movement_file(path, trial.sense->pair) : path;
  }

  /// Returns the settings with which the next repetition of exercise `i` begins, with what commands changed.
  [[nodiscard]] TrialSettings next_settings(std::size_t i) const {
    TrialSettings settings = states_[i].settings();
    if (options_.live == nullptr) return settings;
    const double force = programme_.exercise(i).force_scale;
    const GuidanceValues values =
        options_.live->next(i, {.radius = settings.radius, .force = force, .assist = settings.assistance});
    settings.radius = values.radius;
    settings.assistance = values.assist;
    if (!paths_[i].force.empty() && values.force != force) settings.force_scale = values.force;
    return settings;
  }

  /// Returns a trial that is about to run, with its settings and the name of its file.
  LoggedTrial prepared(const ScheduledTrial& scheduled) {
    const std::size_t i = scheduled.exercise;
    LoggedTrial trial{.exercise = i,
                      .round = scheduled.round,
                      .repetition = scheduled.repetition,
                      .settings = states_[i].settings(),
                      .began = now_text(),
                      .shown = shown_parts(programme_, i, scheduled.round, scheduled.repetition)};
    if (programme_.exercise(i).reach) place_reach(scheduled, trial);
    trial.sense = scheduled.sense;
    support_arm(trial);
    trial.settings.assistance = next_settings(i).assistance;
    name_attempt(scheduled, trial);
    return trial;
  }

  /// Runs one repetition, logs it, and updates the progression.
  const SessionResult& run_trial(const ScheduledTrial& scheduled) {
    const Exercise& exercise = programme_.exercise(scheduled.exercise);
    LoggedTrial trial = prepared(scheduled);
    const std::shared_ptr<Device> device = options_.open(exercise, trial.settings, file(path_of_trial(trial)));
    check(device->info());
    if (steering_of(*device) != nullptr) trial.input = kIntentOfView;
    log().trials.push_back(trial);
    save();

    virtual_ = device->info().virtual_time && options_.session.clock != ClockChoice::real;
    StopRequest end(&stop_);
    const double limit = programme_.limits.force_dose;
    TrialWatch watch(limit > 0 ? limit - sitting().force_dose : 0, end);
    LiveSession::Trial commanded(options_.live, end, trial.file, trial.exercise);
    const double begins = sitting().duration;
    motors_.rested = begins - cools_from_;
    TrialRun run = run_mode(*device, exercise, trial, watch, end);
    cools_from_ = begins + run.session.servo.duration;
    log_run(trial, run, watch, commanded.finish());
    log_settings(trial, run);
    if (trial.sense && trial.finished()) log_answer(trial);
    measure(trial, watch.without_cue());
    sitting().duration += trial.duration;
    sitting().force_dose += trial.force_dose;
    log().trials.back() = std::move(trial);
    save();
    result_.last = std::move(run.session);
    return *result_.last;
  }

  /// Logs what a repetition was like and what ended it. Takes its notes.
  void log_run(LoggedTrial& trial, TrialRun& run, const TrialWatch& watch, const LiveSession::TrialEnd& end) {
    trial.unattended = end.unattended;
    // A note that concerns the device rather than the trial is reported once.
    for (std::string& note : run.notes)
      if (told_.insert(note).second) trial.notices.push_back(std::move(note));
    // The recording stores events, and the log stores the end of the trial.
    for (const Warning& warning : run.session.warnings)
      if (!is_of_event(warning.code) && warning.code != "stopped") trial.notices.push_back(warning.text);
    const ServoReport& servo = run.session.servo;
    trial.duration = servo.duration;
    trial.force_dose = watch.dose();
    trial.stopped_by = to_string(servo.cause);
    if (trial.finished() && watch.time_over()) trial.stopped_by = "time_over";
    if (watch.dose_reached() && servo.cause == StopCause::interrupted && stop_.count() == 0)
      trial.stopped_by = kForceDose;
    // A skip may come too late to matter, and Ctrl+C counts for more.
    if (end.skipped && servo.cause == StopCause::interrupted && stop_.count() == 0) trial.stopped_by = "skipped";
    trial.detail = trial.stopped_by == kForceDose ? "" : servo.detail;
    trial.initiation = run.initiation;
    if (run.places) trial.places = run.places;
  }

  /// Logs the settings that were in force.
  void log_settings(LoggedTrial& trial, const TrialRun& run) const {
    const Exercise& exercise = programme_.exercise(trial.exercise);
    if (trial.settings.support) trial.settings.support = run.session.support;
    if (exercise.mode == ExerciseMode::passive || exercise.reach) return;
    trial.settings.stiffness = run.stiffness;
    if (options_.live != nullptr) note_changes(trial.exercise, run, trial.settings);
  }

  /// Asks which of two places was farther, and logs the answer.
  void log_answer(LoggedTrial& trial) {
    trial.sense->answer = ask(programme_.exercise(trial.exercise).sense->answer);
    if (trial.sense->answer != 0) return;
    // A stop in the question leaves it open: the trial will be done again.
    trial.stopped_by = stop_.count() > 0 ? to_string(StopCause::interrupted) : "time_over";
    const char* const kNoWait = "in virtual time a question does not wait for an answer; use --clock real";
    if (virtual_ && told_.insert(kNoWait).second) trial.notices.emplace_back(kNoWait);
  }

  /// Sets the part of the arm's weight that the device carries in a trial.
  void support_arm(LoggedTrial& trial) {
    const ArmSupportTask task = support_of(programme_, trial.exercise);
    double force = task.force;
    if (task.share) {
      const std::optional<ArmWeight> arm = weight_of_arm(programme_, log());
      force = arm ? *task.share * arm->weight : 0;
      const auto tell = [&](const char* what) {
        if (told_.insert(what).second) trial.notices.emplace_back(what);
      };
      if (!arm) tell("the arm is not supported, because no trial measured its weight");
      if (arm && arm->is_earlier) tell("the support is a share of the weight that an earlier sitting measured");
    }
    if (!(force > 0)) return;
    trial.settings.support = options_.live != nullptr ? options_.live->next_support(trial.exercise, force) : force;
  }

  /// Computes the metrics of a repetition that was done, and updates the progression.
  void measure(LoggedTrial& trial, bool without_cue) {
    if (!trial.done() || trial.skipped()) return;
    trial.figures = figures_of(trial, without_cue);
    for (const char* key : {"refused", "at_limit"})
      if (trial.figures.is_object() && trial.figures.contains(key))
        trial.notices.push_back(trial.figures[key].get<std::string>());
    if (measures(trial)) states_[trial.exercise].learn(trial);
  }

  /// Logs the values that commands put in force.
  void note_changes(std::size_t i, const TrialRun& run, TrialSettings& settings) const {
    const Exercise& exercise = programme_.exercise(i);
    const GuidanceValues values = options_.live->wanted();
    const bool assisted = exercise.mode == ExerciseMode::assisted;
    if (assisted) settings.assistance = values.assist;
    if (!run.stiffness) return;  // no force acted
    settings.radius = values.radius;
    settings.stiffness = values.stiffness * (assisted ? values.assist : 1);
    if (!paths_[i].force.empty() && values.force != exercise.force_scale) settings.force_scale = values.force;
  }

  void check(const DeviceInfo& info) {
    const DeviceIdentity device = identity_of(info), begun = log().device;
    if (device == begun) return;
    throw input_error(fmt::format(
        "{}: this session was started with {} {} {}, but the device is {} {} {}; metrics of different devices cannot "
        "be compared: start a new session for this device",
        options_.folder, begun.backend, begun.model, begun.serial, device.backend, device.model, device.serial));
  }

  [[nodiscard]] nlohmann::json figures_of(const LoggedTrial& trial, bool without_cue) const {
    const std::string recording = file(trial.file);
    std::vector<RecordedTrial> runs = read_trials(RecordingReader(recording), recording);
    if (runs.empty()) return nullptr;
    // The movement before a lost device does not count, if no cue came after it.
    if (without_cue) runs.back() = {.kind = TrialKind::reach, .reach = runs.back().reach};
    std::optional<PlantModel> plant;
    if (identified_) plant = identified_->plant;
    return to_json(trial_figures(runs.back(), curves_[trial.exercise], plant));
  }

  /// Returns the session options of a trial. `config` holds the command that it names and the options that repeat this
  /// trial.
  [[nodiscard]] SessionOptions session_for(const DeviceInfo& device, const Exercise& exercise, const LoggedTrial& trial,
                                           const TrialWatch& watch, nlohmann::json config) {
    SessionOptions session = options_.session;
    session.loop.motors = &motors_;
    if (trial.settings.support)
      session.support = {.force = *trial.settings.support, .adjustable = true, .up = programme_.up};
    session.also_warn([&watch, warned = false, limit = programme_.limits.force_dose]() mutable {
      if (!watch.dose_reached() || std::exchange(warned, true)) return std::vector<Warning>{};
      const std::string text =
          fmt::format("the force dose of the sitting reached {:g} N s, so the session ends", limit);
      return known_warnings(Severity::warning, kForceDose, std::span(&text, 1));
    });
    SessionOptions::Recording& recording = *session.recording;
    recording.file = file(trial.file);
    recording.options.tell_room = false;
    const std::string& title = recording.title.empty() ? programme_.title : recording.title;
    recording.title =
        fmt::format("{}{}{}: repetition {}", title, title.empty() ? "" : ", ", exercise.name, trial.repetition);
    recording.meta["exercise"] = exercise.name;
    recording.meta["mode"] = to_string(exercise.mode);
    recording.meta["round"] = std::to_string(trial.round);
    recording.meta["repetition"] = std::to_string(trial.repetition);
    if (exercise.test != TestLabel::none) recording.meta["test"] = to_string(exercise.test);
    config["device"] = device.name;
    config["hold"] = exercise.hold;
    if (options_.profile) config["profile"] = absolute(kSessionProfile);
    // The recording's config holds the options of every command that runs a session, and those of this trial.
    recording.config.update(config);
    return session;
  }

  /// Runs a repetition in the way of its mode. A further kind of exercise adds a case here.
  TrialRun run_mode(Device& device, const Exercise& exercise, const LoggedTrial& trial, TrialWatch& watch,
                    const StopRequest& stop) {
    switch (exercise.mode) {
      case ExerciseMode::passive:
      case ExerciseMode::sense:
        return move(device, exercise, trial, watch, stop);
      case ExerciseMode::reach:
      case ExerciseMode::range:
      case ExerciseMode::press:
      case ExerciseMode::track:
      case ExerciseMode::weigh:
        return reach_target(device, exercise, trial, watch, stop);
      default:
        return guide_trial(device, exercise, trial, watch, stop);
    }
  }

  /// Sets the target, the kind and the places of a reach.
  void place_reach(const ScheduledTrial& scheduled, LoggedTrial& trial) const {
    const Exercise& exercise = programme_.exercise(trial.exercise);
    trial.reach = scheduled.reach;
    trial.settings.start_hold = scheduled.reach->start_hold;
    const std::vector<Vec3>& places = paths_[trial.exercise].position;
    trial.places = reach_trial(*exercise.reach, *scheduled.reach, turn_of(programme_, exercise), places.front(),
                               places.at(place_of_target(scheduled.reach->target)));
  }

  /// Adds the texts that no earlier repetition had to the warnings of a session.
  void warn_once(SessionOptions& session, Severity severity, const std::vector<std::string>& texts) {
    std::vector<std::string> fresh;
    std::copy_if(texts.begin(), texts.end(), std::back_inserter(fresh),
                 [&](const std::string& text) { return told_.insert(text).second; });
    session.also_warn(
        [warnings = known_warnings(severity, "reach", fresh)]() mutable { return std::exchange(warnings, {}); });
  }

  TrialRun reach_target(Device& device, const Exercise& exercise, const LoggedTrial& trial, TrialWatch& watch,
                        const StopRequest& stop) {
    const ReachTask& task = *exercise.reach;
    ReachOptions options{.trial = *trial.places,
                         .locked = task.locked,
                         .course = {.start_hold = trial.reach->start_hold,
                                    .target_hold = task.target_hold,
                                    .time_limit = exercise.time_limit,
                                    .hold = exercise.hold,
                                    .pull = task.pull,
                                    .approach_speed = kApproachSpeed,
                                    .max_deviation = options_.max_deviation},
                         .clamp_stiffness = task.clamp.stiffness,
                         .clamp_damping = task.clamp.damping,
                         .break_out = task.clamp.break_out,
                         .energy = task.energy,
                         .shortest_start_hold = task.least_start_hold,
                         .identified = identified_,
                         .sinks = {&watch},
                         .live = options_.live};
    if (options_.live != nullptr) options_.live->begin_unguided("no tunnel and no help act in this exercise");
    options.session = options_.session;
    const ReachPlan plan = plan_reach(device.info(), options);
    options.session =
        session_for(device.info(), exercise, trial, watch,
                    {{"verb", "run"}, {"mode", to_string(exercise.mode)}, {"reach", json_of(plan.trial)}});
    warn_once(options.session, Severity::note, plan.notes);
    warn_once(options.session, Severity::warning, plan.warnings);
    TrialRun run{reach(device, plan, options, stop, progress_), {}, {}, {}, plan.trial};
    if (plan.forces.clamp) run.stiffness = plan.forces.clamp->stiffness;
    return run;
  }

  TrialRun move(Device& device, const Exercise& exercise, const LoggedTrial& trial, TrialWatch& watch,
                const StopRequest& stop) {
    const std::string path = file(path_of_trial(trial));
    nlohmann::json config{{"verb", "play"},
                          {"path", absolute(path_of_trial(trial))},
                          {"speed", trial.settings.pace},
                          {"max-deviation", options_.max_deviation}};
    if (exercise.sense)
      config["sense"] = json_of(sense_pair(placed(*exercise.sense, paths_[trial.exercise]), trial.sense->pair));
    PlayOptions options{.identified = identified_,
                        .playback = {.speed = trial.settings.pace,
                                     .hold = exercise.hold,
                                     .approach_speed = kApproachSpeed,
                                     .max_deviation = options_.max_deviation},
                        .session = session_for(device.info(), exercise, trial, watch, std::move(config)),
                        .sinks = {&watch},
                        .live = options_.live};
    const PlayPlan plan = plan_playback(device.info(), open_path(path), options);
    if (options_.live != nullptr) options_.live->begin_unguided("the device moves the participant in this exercise");
    return {play(device, plan, options, stop, progress_).session, {}, {}, {}};
  }

  /// Returns the share of its help that an exercise gives.
  static double assistance_of(const Exercise& exercise, const TrialSettings& settings) {
    return exercise.mode == ExerciseMode::assisted ? settings.assistance : 1;
  }

  /// Returns the options of a guided repetition, without those of its session.
  [[nodiscard]] GuideOptions guide_options(const Exercise& exercise, const LoggedTrial& trial,
                                           TrialWatch& watch) const {
    const TrialSettings& settings = trial.settings;
    const double assistance = assistance_of(exercise, settings);
    const bool cursor = exercise.mode == ExerciseMode::cursor;
    GuideOptions options{.guidance = {.cursor = cursor,
                                      .allow_back = exercise.allow_back,
                                      .speed = cursor ? settings.pace : 1,
                                      .wait = exercise.wait,
                                      .hold = exercise.hold,
                                      .approach_speed = kApproachSpeed,
                                      .time_limit = time_limit_of(exercise, paths_[trial.exercise].duration()),
                                      .max_deviation = options_.max_deviation},
                         .radius = settings.radius,
                         .free = exercise.mode == ExerciseMode::free || assistance < kLeastAssistance,
                         .tunnel_without_walls = has_tunnel(exercise),
                         .stiffness = settings.stiffness,
                         .force_scale = paths_[trial.exercise].force.empty() ? 0 : exercise.force_scale,
                         .feel = exercise.resist_forces ? Feel::resist : Feel::active,
                         .viscosity = exercise.viscosity,
                         .identified = identified_,
                         .sinks = {&watch},
                         .live = options_.live};
    if (exercise.mode == ExerciseMode::assisted)
      options.pace = PaceHelpOptions{.pace = settings.pace, .max_force = assistance * exercise.assist_force};
    if (exercise.initiate && !options.free) {
      options.initiate = exercise.initiate;
      options.initiate->pace = (1 - PaceHelpOptions{}.margin) * settings.pace;
      options.initiate->max_force *= assistance;
    }
    if (exercise.mode == ExerciseMode::resist) options.resistance = exercise.resistance;
    // On the path no force is sent, and the hand may be anywhere. During the approach a force leads the hand.
    if (options.free) {
      options.guidance.max_approach_deviation = options_.max_deviation;
      options.guidance.max_deviation = 10;
    }
    return options;
  }

  /// Returns the command that repeats a guided repetition, for its recording, without what its plan decides.
  [[nodiscard]] nlohmann::json guide_config(const Exercise& exercise, const LoggedTrial& trial,
                                            const GuideOptions& options) const {
    const TrialSettings& settings = trial.settings;
    const bool cursor = options.guidance.cursor;
    nlohmann::json config{{"verb", "guide"},
                          {"expert", absolute(result_.log.paths[trial.exercise])},
                          {"mode", options.free ? "free"
                                   : cursor     ? "cursor"
                                                : "tunnel"},
                          {"time-limit", options.guidance.time_limit},
                          {"force-scale", options.force_scale},
                          {"feel", exercise.resist_forces ? "resist" : "active"},
                          {"viscosity", exercise.viscosity},
                          {"max-deviation", options.guidance.max_deviation},
                          {"allow-back", exercise.allow_back}};
    if (has_tunnel(exercise)) config["radius"] = settings.radius;
    if (cursor) config.update({{"speed", settings.pace}, {"wait", exercise.wait}});
    if (options.pace) config.update({{"pace", settings.pace}, {"pace-force", options.pace->max_force}});
    if (options.initiate)
      config.update({{"initiate", true},
                     {"initiate-wait", options.initiate->wait},
                     {"initiate-stiffness", options.initiate->stiffness},
                     {"initiate-force", options.initiate->max_force}});
    if (exercise.mode == ExerciseMode::resist) config["resistance"] = exercise.resistance;
    return config;
  }

  TrialRun guide_trial(Device& device, const Exercise& exercise, const LoggedTrial& trial, TrialWatch& watch,
                       const StopRequest& stop) {
    const std::string path = file(log().paths[trial.exercise]);
    GuideOptions options = guide_options(exercise, trial, watch);
    nlohmann::json config = guide_config(exercise, trial, options);
    GuidePlan plan = plan_guidance(device.info(), open_path(path), options);
    if (options_.live != nullptr) options_.live->begin(scope_of(exercise, trial, plan, options), trial.exercise);
    plan.stiffness *= assistance_of(exercise, trial.settings);
    if (!options.free) config["stiffness"] = plan.stiffness;
    if (options_.live != nullptr && !options.free) {
      const GuidanceValues values = options_.live->wanted();
      config.update({{"radius", values.radius},
                     {"stiffness", values.stiffness * (exercise.mode == ExerciseMode::assisted ? values.assist : 1)},
                     {"force-scale", values.force}});
    }
    options.session = session_for(device.info(), exercise, trial, watch, std::move(config));
    std::vector<std::string> notes = plan.notes;
    notes.insert(notes.end(), plan.warnings.begin(), plan.warnings.end());
    GuideResult result = guide(device, plan, options, stop, progress_);
    return {std::move(result.session), std::move(notes), options.free ? std::nullopt : std::optional(plan.stiffness),
            result.last.initiation};
  }

  /// Returns what commands can change of a repetition, before its assistance scales the walls of `plan`.
  [[nodiscard]] LiveGuidance::Scope scope_of(const Exercise& exercise, const LoggedTrial& trial, const GuidePlan& plan,
                                             const GuideOptions& options) const {
    LiveGuidance::Scope scope = guide_scope(plan, options);
    if (exercise.mode == ExerciseMode::free) scope.without = "no force acts in a free exercise";
    if (exercise.mode != ExerciseMode::assisted) return scope;
    scope.start.assist = states_[trial.exercise].settings().assistance;
    scope.composed.assist = trial.settings.assistance;
    scope.walls_help = true;
    scope.adapts = options.free;
    return scope;
  }

  SessionLock lock_;
  ProgrammeResult result_;
  Programme programme_;
  const ProgrammeOptions& options_;
  MotorHeat motors_;       ///< of the repetitions of this sitting
  double cools_from_ = 0;  ///< end of the last repetition [s]
  const StopRequest& stop_;
  const Progress& progress_;
  std::vector<ProgressionState> states_;  ///< indexed by exercise, like the next two
  std::vector<Path> paths_;
  std::vector<TrialPath> curves_;
  std::optional<IdentifiedDevice> identified_;
  std::set<std::string> told_;
  bool virtual_ = false;
};

}  // namespace

namespace {

/// Draws the reaches and pairs of every exercise and round, after the order, which does not depend on them.
void add_reaches(const Programme& programme, OrderDraw& draw, std::vector<ScheduledTrial>& trials) {
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    if (!exercise.reach && !exercise.sense) continue;
    const int rounds = i < programme.warm_up.size() ? 1 : programme.rounds;
    for (int round = 1; round <= rounds; ++round) {
      std::vector<PlannedReach> reaches;
      std::vector<SenseTrial> pairs;
      if (exercise.reach) reaches = order_of_reaches(*exercise.reach, draw);
      if (exercise.sense) pairs = order_of_pairs(*exercise.sense, draw);
      for (ScheduledTrial& trial : trials) {
        if (trial.exercise != i || trial.round != round) continue;
        const auto at = static_cast<std::size_t>(trial.repetition) - 1;
        if (exercise.reach) trial.reach = reaches.at(at);
        if (exercise.sense) trial.sense = pairs.at(at);
      }
    }
  }
}

}  // namespace

std::vector<ScheduledTrial> schedule(const Programme& programme) {
  std::vector<ScheduledTrial> trials;
  for (std::size_t i = 0; i < programme.warm_up.size(); ++i)
    for (int repetition = 1; repetition <= programme.warm_up[i].repetitions; ++repetition)
      trials.push_back(scheduled(programme, {i, 1, repetition, {}, {}}));
  OrderDraw draw(programme.seed.value_or(0));
  for (int round = 1; round <= programme.rounds; ++round)
    for (const OrderedTrial& trial : order_of_round(programme, draw))
      trials.push_back(scheduled(programme, {trial.exercise, round, trial.repetition, {}, {}}));
  add_reaches(programme, draw, trials);
  if (!trials.empty()) trials.back().rest = 0;
  return trials;
}

nlohmann::json with_seed(nlohmann::json programme, const std::string& where) {
  const Programme read = programme_from_json(programme, where);
  // 31 bits, so that every reader of JSON keeps it.
  if (read.is_random() && !read.seed) programme["seed"] = std::random_device()() >> 1;
  return programme;
}

namespace {

/// Throws Error(input) if a target came too near to the start when it was placed and scaled: the radii stay.
void check_scaled_targets(const Exercise& exercise, const Path& places, const std::string& where) {
  const ReachTask& task = *exercise.reach;
  for (std::size_t i = 0; i < task.targets.size(); ++i) {
    const Vec3& target = places.position.at(place_of_target(static_cast<int>(i)));
    const std::string why = too_near((target - places.position.front()).norm(), task.start_radius, task.target_radius);
    if (!why.empty())
      throw input_error(
          fmt::format("{}: target {} of '{}', as it is scaled, {}; scale it less, or make the radii smaller", where,
                      i + 1, exercise.name, why));
  }
}

}  // namespace

ProgrammePlan plan_programme(const Programme& programme, const std::string& folder, const std::string& where,
                             const DeviceInfo* device, bool fit) {
  check_figures(programme, where);
  ProgrammePlan plan{.trials = schedule(programme)};
  for (std::size_t i = 0; i < programme.size(); ++i)
    plan.paths.push_back(path_of(programme, programme.exercise(i), folder));
  std::optional<Fit> fitted;
  if (fit && device != nullptr) fitted = fit_together(programme, plan.paths, *device);
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    const Path& path = plan.paths[i];
    // Notes of a path that several exercises share are added once.
    const auto first = std::find_if(plan.parts.begin(), plan.parts.end(), [&](const ProgrammePlan::Part& other) {
      return programme.exercise(static_cast<std::size_t>(&other - plan.parts.data())).path == exercise.path;
    });
    if (exercise.path.empty() || first == plan.parts.end())
      for (const std::string& note : path.notes) plan.notes.push_back(fmt::format("{}: {}", path.name, note));
    if (device != nullptr) {
      (void)path_for(*device, source_of(reached_part(exercise, path)), false);
      check_means(exercise, path, *device, where);
    }
    if (exercise.reach && exercise.reach->goal == ReachGoal::target) check_scaled_targets(exercise, path, where);
    if (length_of(path) == 0 && exercise.mode != ExerciseMode::passive)
      throw input_error(fmt::format("{}: the path of '{}' has no length: there is nothing to follow in mode {}", where,
                                    exercise.name, to_string(exercise.mode)));
    plan.parts.push_back(
        {.path_length = exercise.reach ? (path.position[1] - path.position[0]).norm() : length_of(path),
         .path_duration = exercise.reach ? kUsualReach : path.duration(),
         .trial = expected_time(exercise, path),
         .fit = fitted});
  }
  double warm_up = 0;
  for (std::size_t i = 0; i < programme.warm_up.size(); ++i)
    warm_up += programme.warm_up[i].repetitions * (plan.parts[i].trial + programme.warm_up[i].rest);
  if (const double least = warm_up + plan.parts[programme.warm_up.size()].trial;
      programme.limits.time > 0 && least > programme.limits.time)
    throw input_error(
        fmt::format("{}: limits.time: {:g} s are too short for the warm-up and one repetition, which take {:.0f} s; "
                    "raise the limit",
                    where, programme.limits.time, least));
  if (const auto note = note_on_catch_trials(programme)) plan.notes.push_back(*note);
  for (std::size_t i = 0; i < programme.size(); ++i)
    if (const Exercise& exercise = programme.exercise(i);
        exercise.sense && exercise.sense->trials() < static_cast<int>(SenseFit::kLeastAnswers))
      plan.notes.push_back(fmt::format("'{}' has {} pairs of places, but a threshold needs {} answers: raise tries",
                                       exercise.name, exercise.sense->trials(), SenseFit::kLeastAnswers));
  if (fitted) plan.notes.push_back("all paths were moved and scaled into the workspace: " + describe(*fitted));
  for (const ScheduledTrial& trial : plan.trials) plan.duration += plan.parts[trial.exercise].trial + trial.rest;
  if (programme.limits.time > 0 && plan.duration > programme.limits.time)
    plan.notes.push_back(
        fmt::format("the programme takes about {}, and a sitting lasts at most {}: resume it in another sitting with "
                    "--resume",
                    long_duration_text(plan.duration), long_duration_text(programme.limits.time)));
  return plan;
}

SessionLog begin_session(const nlohmann::json& programme, const std::string& where, const ProgrammePlan& plan,
                         const DeviceInfo& device, const ProgrammeOptions& options) {
  const fs::path folder(options.folder);
  std::error_code failed;
  if (is_session(options.folder)) {
    const bool complete = load_session_log(options.folder).complete;
    throw input_error(fmt::format(
        "{}: already contains a session{}", options.folder,
        complete ? ", which is complete; choose another folder"
                 : fmt::format("; resume it (haptrace run --resume {} --device {}), or choose another folder",
                               options.folder, device.name)));
  }
  const bool existed = fs::exists(folder, failed);
  if (existed && !(fs::is_directory(folder, failed) && fs::is_empty(folder, failed)))
    throw input_error(
        fmt::format("{}: exists and is not an empty folder; choose another folder for the session", options.folder));

  SessionLog log{.created = now_text(),
                 .software = software_name(),
                 .device = identity_of(device),
                 .programme = with_seed(programme, where)};
  const Programme read = programme_from_json(log.programme, where);
  if (read.is_random()) {
    for (const ScheduledTrial& trial : schedule(read))
      log.schedule.push_back({trial.exercise, trial.round, trial.repetition, trial.reach, trial.sense});
    log.generator = OrderDraw::kName;
  }
  if (!plan.parts.empty() && plan.parts.front().fit) log.fit = describe(*plan.parts.front().fit);
  if (const auto& recording = options.session.recording) {
    log.subject = recording->subject;
    log.operator_name = recording->operator_name;
    log.notes = recording->notes;
    log.config = recording->config;
  }
  // The data of a session belong to its participant: other users cannot open the folder, and its files inherit this.
  create_private_folders((folder / "paths").string());
  try {
    for (std::size_t i = 0; i < plan.paths.size(); ++i) {
      const std::string name = read.exercise(i).name;
      log.paths.push_back(fmt::format("paths/{:02}-{}.h5", i + 1, file_name(name)));
      save_path(plan.paths[i], (folder / log.paths.back()).string(), name, false);
      const std::vector<Path> movements = movements_of(read.exercise(i), plan.paths[i]);
      for (std::size_t k = 0; k < movements.size(); ++k)
        save_path(movements[k], (folder / movement_file(log.paths.back(), static_cast<int>(k))).string(),
                  fmt::format("{}, {}", name, movements[k].name), false);
    }
    if (options.profile) save_profile(*options.profile, (folder / kSessionProfile).string(), false);
    save_session_log(log, options.folder);
  } catch (...) {
    for (const auto& entry : fs::directory_iterator(folder, failed)) fs::remove_all(entry.path(), failed);
    if (!existed) fs::remove(folder, failed);
    throw;
  }
  return log;
}

ProgrammeResult run_programme(const ProgrammeOptions& options, const StopRequest& stop, const Progress& progress) {
  return ProgrammeRun(options, stop, progress).run();
}

nlohmann::json to_json(const ProgrammePlan& plan, const Programme& programme) {
  nlohmann::json json{{"title", programme.title},
                      {"duration_s", plan.duration},
                      {"trials", plan.trials.size()},
                      {"notes", plan.notes},
                      {"exercises", nlohmann::json::array()}};
  for (std::size_t i = 0; i < plan.parts.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    const bool warm_up = i < programme.warm_up.size();
    json["exercises"].push_back({{"name", exercise.name},
                                 {"warm_up", warm_up},
                                 {"mode", to_string(exercise.mode)},
                                 {"test", to_string(exercise.test)},
                                 {"repetitions", exercise.repetitions * (warm_up ? 1 : programme.rounds)},
                                 {"path_length_m", plan.parts[i].path_length},
                                 {"path_duration_s", plan.parts[i].path_duration},
                                 {"repetition_s", plan.parts[i].trial},
                                 {"rest_s", exercise.rest}});
  }
  return json;
}

nlohmann::json to_json(const ProgrammeResult& result) {
  const SessionLog& log = result.log;
  nlohmann::json json{{"complete", log.complete}, {"trials", nlohmann::json::array()}};
  const Programme programme = programme_from_json(log.programme, "programme");
  for (const LoggedTrial& trial : log.trials)
    json["trials"].push_back({{"exercise", programme.exercise(trial.exercise).name},
                              {"mode", to_string(programme.exercise(trial.exercise).mode)},
                              {"round", trial.round},
                              {"repetition", trial.repetition},
                              {"attempt", trial.attempt},
                              {"file", trial.file},
                              {"assistance", trial.settings.assistance},
                              {"radius_m", trial.settings.radius},
                              {"pace", trial.settings.pace},
                              {"support_n", json_of_number(trial.settings.support)},
                              {"stopped_by", trial.stopped_by},
                              {"partial", trial.partial()},
                              {"initiation", trial.initiation ? json_of(*trial.initiation) : nlohmann::json()},
                              {"reach", trial.reach ? json_of(*trial.reach) : nlohmann::json()},
                              {"unattended", trial.unattended},
                              {"figures", trial.figures}});
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const std::string& name = programme.exercise(i).name;
    if (programme.exercise(i).mode == ExerciseMode::reach)
      json["reaching"].push_back({{"exercise", name}, {"blocks", to_json(summarise_blocks(programme, i, log))}});
    if (const std::optional<AssessmentSummary> summary = summarise_assessment(programme, i, log))
      json["assessments"].push_back({{"exercise", name}, {"result", to_json(*summary)}});
    if (const std::optional<SenseSummary> summary = summarise_sense(programme, i, log))
      json["assessments"].push_back({{"exercise", name}, {"result", to_json(*summary)}});
  }
  if (!log.sittings.empty()) {
    const Sitting& sitting = log.sittings.back();
    json["sitting"] = {
        {"number", log.sittings.size()},
        {"ended_by", sitting.ended_by},
        {"stopped_from", sitting.stopped_from.empty() ? nlohmann::json() : nlohmann::json(sitting.stopped_from)},
        {"detail", sitting.detail},
        {"duration_s", sitting.duration},
        {"force_dose_n_s", sitting.force_dose}};
  }
  return json;
}

}  // namespace haptrace
