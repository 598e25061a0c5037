#include "player/programme/training_screen.h"

#include "base/enum_names.h"
#include "base/json_reader.h"
#include "base/statistics.h"
#include "metrics/recorded_trial.h"
#include "player/programme/progression.h"

#include <algorithm>
#include <fmt/ranges.h>
#include <iterator>
#include <utility>

namespace haptrace {
namespace {

constexpr EnumNames<TrainingScreen::State, 10> kStates{
    "state", {"waiting", "approach", "go", "moving", "done", "rest", "question", "skipped", "stopped", "finished"}};

constexpr std::size_t kLeastEarlier = 3;  // repetitions that have a spread
constexpr double kSpreads = 1.5;          // median absolute deviations: about one standard deviation
constexpr double kSameTime = 0.005;       // difference of times in the tunnel that nobody sees on the screen

double spread(const std::vector<double>& values) {
  const double middle = median(values);
  std::vector<double> distances;
  for (const double value : values) distances.push_back(std::abs(value - middle));
  return median(std::move(distances));
}

/// Returns true if `value` is larger than all `earlier` ones, and beyond their spread.
bool beats(double value, const std::vector<double>& earlier) {
  return value > *std::max_element(earlier.begin(), earlier.end()) &&
         value - median(earlier) > kSpreads * spread(earlier);
}

/// Returns the settings of a repetition that its exercise's mode uses, in words.
std::vector<std::string> setting_words(const Exercise& exercise, const TrialSettings& settings) {
  std::vector<std::string> words;
  if (exercise.mode != ExerciseMode::free && exercise.mode != ExerciseMode::passive && !exercise.reach &&
      !exercise.sense)
    words.push_back(fmt::format("radius {:.1f} mm", 1e3 * settings.radius));
  if (exercise.mode == ExerciseMode::assisted)
    words.push_back(fmt::format("assistance {:.0f} %", 100 * settings.assistance));
  if (settings.pace != 1) words.push_back(fmt::format("pace {:.2f}", settings.pace));
  if (settings.force_scale) words.push_back(fmt::format("force {:.0f} %", 100 * *settings.force_scale));
  return words;
}

}  // namespace

const char* to_string(TrainingScreen::State state) {
  return kStates.name(state);
}

nlohmann::json to_json(const TrainingScreen& screen) {
  const TrainingTrial& trial = screen.trial;
  nlohmann::json show = nlohmann::json::object();
  for (std::size_t part = 0; part < kScreenParts; ++part)
    show[to_string(static_cast<ScreenPart>(part))] = trial.show[part];
  nlohmann::json json{{"type", "training"},
                      {"state", to_string(screen.state)},
                      {"exercise", trial.exercise},
                      {"mode", trial.mode},
                      {"trial", trial.number},
                      {"of", trial.of},
                      {"repetition", trial.repetition},
                      {"repetitions", trial.repetitions},
                      {"show", std::move(show)},
                      {"rest_s", json_of_number(screen.rest)},
                      {"next", trial.next},
                      {"score", nullptr}};
  if (screen.score)
    json["score"] = {{"time_in_tunnel", json_of_number(screen.score->time_in_tunnel)},
                     {"time_s", json_of_number(screen.score->time)},
                     {"best", screen.score->best}};
  return json;
}

std::optional<TrainingScore> training_score(const LoggedTrial& trial, const std::vector<LoggedTrial>& earlier) {
  const std::optional<double> inside = figure_in(trial.figures, "time_in_tunnel");
  if (!inside) return std::nullopt;
  const double time = figure_in(trial.figures, "movement_time_s").value_or(kNaN);
  TrainingScore score{.time_in_tunnel = *inside, .time = time};
  if (!trial.finished()) return score;

  std::vector<double> insides, paces;  // a pace is a negative time: more is better
  double best = -1, help = 0;
  for (const LoggedTrial& before : earlier) {
    if (before.exercise != trial.exercise || !before.finished()) continue;
    const auto was_inside = figure_in(before.figures, "time_in_tunnel");
    const auto took = figure_in(before.figures, "movement_time_s");
    if (!was_inside || !took) continue;
    insides.push_back(*was_inside);
    paces.push_back(-*took);
    if (*was_inside > best) {
      best = *was_inside;
      help = before.settings.assistance;
    }
  }
  if (insides.size() < kLeastEarlier || trial.settings.assistance > help) return score;
  const bool as_good = *inside >= best - kSameTime;
  score.best = beats(*inside, insides) || (as_good && std::isfinite(time) && beats(-time, paces));
  return score;
}

void TrainingProgress::begin(TrainingTrial trial) {
  screen_ = {.state = TrainingScreen::State::waiting, .trial = std::move(trial), .score = {}};
  go_since_.reset();
}

bool TrainingProgress::observe(const Sample& sample, bool skipped) {
  using Step = TrainingScreen::State;
  Step state = screen_.state;
  const double now = 1e-9 * static_cast<double>(sample.time_ns);
  if (state == Step::skipped || state == Step::stopped || state == Step::finished || state == Step::rest ||
      state == Step::question)
    return false;
  switch (sample.phase) {
    case Phase::approach:
      state = Step::approach;
      go_since_.reset();
      break;
    case Phase::run:
      if (!go_since_) {
        go_since_ = now;
        go_from_ = sample.position;
        state = Step::go;
      } else if (now - *go_since_ >= kLongestGo || (sample.position - go_from_).norm() >= kMoved) {
        state = Step::moving;
      }
      break;
    case Phase::hold:
      state = Step::done;
      go_since_.reset();
      break;
    case Phase::stopped:
      state = skipped ? Step::skipped : Step::stopped;
      break;
    default:
      break;
  }
  return std::exchange(screen_.state, state) != state;
}

void TrainingProgress::end(const LoggedTrial& trial, const std::vector<LoggedTrial>& earlier) {
  end(!trial.done() || trial.skipped(), training_score(trial, earlier));
  if (trial.skipped()) screen_.state = TrainingScreen::State::skipped;
}

void TrainingProgress::end(bool stopped, std::optional<TrainingScore> score) {
  screen_.state = stopped ? TrainingScreen::State::stopped : TrainingScreen::State::done;
  const bool shows = screen_.trial.show[static_cast<std::size_t>(ScreenPart::score)];
  screen_.score = shows && !stopped ? score : std::nullopt;
}

void TrainingProgress::rest(double left) {
  screen_.state = std::isnan(left) ? TrainingScreen::State::waiting : TrainingScreen::State::rest;
  screen_.rest = left;
}

void TrainingProgress::ask(double left) {
  screen_.state = TrainingScreen::State::question;
  screen_.rest = left;
}

void TrainingProgress::finish(bool stopped) {
  screen_.state = stopped ? TrainingScreen::State::stopped : TrainingScreen::State::finished;
  screen_.rest = kNaN;
}

std::string settings_text(const Exercise& exercise, const TrialSettings& settings) {
  std::vector<std::string> words{to_string(exercise.mode)};
  std::ranges::move(setting_words(exercise, settings), std::back_inserter(words));
  if (exercise.test != TestLabel::none) words.push_back(fmt::format("test {}", to_string(exercise.test)));
  return fmt::format("{}", fmt::join(words, ", "));
}

nlohmann::json programme_message(const Programme& programme, const SessionLog& log, const ProgrammeProgress& progress) {
  nlohmann::json json{{"type", "programme"},
                      {"title", programme.title},
                      {"subject", log.subject},
                      {"limit_s", programme.limits.time > 0 ? nlohmann::json(programme.limits.time) : nlohmann::json()},
                      {"elapsed_s", progress.elapsed},
                      {"paused", progress.paused},
                      {"current", progress.current},
                      {"exercises", nlohmann::json::array()},
                      {"trials", nlohmann::json::array()}};
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const Exercise& exercise = programme.exercise(i);
    const LoggedTrial* last = nullptr;
    int done = 0, skipped = 0;
    for (const LoggedTrial& trial : log.trials) {
      if (trial.exercise != i) continue;
      last = &trial;
      skipped += trial.skipped() ? 1 : 0;
      done += trial.done() && !trial.skipped() ? 1 : 0;
    }
    json["exercises"].push_back(
        {{"name", exercise.name},
         {"mode", to_string(exercise.mode)},
         {"settings",
          fmt::format("{}", fmt::join(setting_words(exercise, last != nullptr ? last->settings
                                                                              : ProgressionState(exercise).settings()),
                                      ", "))},
         {"repetitions", exercise.repetitions * (i < programme.warm_up.size() ? 1 : programme.rounds)},
         {"done", done},
         {"skipped", skipped},
         {"test", exercise.test != TestLabel::none}});
  }
  for (const LoggedTrial& trial : log.trials) {
    if (trial.stopped_by.empty()) continue;  // it is running
    const Exercise& exercise = programme.exercise(trial.exercise);
    const bool has_target = exercise.progression && exercise.progression->figure == "contour_rms_m";
    json["trials"].push_back(
        {{"exercise", trial.exercise},
         {"repetition", trial.repetition},
         {"rms_m", json_of_number(figure_in(trial.figures, "contour_rms_m").value_or(kNaN))},
         // The help that was felt; logs of older versions know only what was allowed.
         {"help", exercise.mode == ExerciseMode::assisted
                      ? nlohmann::json(figure_in(trial.figures, "helped_time").value_or(trial.settings.assistance))
                      : nlohmann::json()},
         {"target_m", has_target ? nlohmann::json(exercise.progression->target) : nlohmann::json()},
         {"time_in_tunnel", json_of_number(figure_in(trial.figures, "time_in_tunnel").value_or(kNaN))},
         {"partial", !trial.finished()},
         {"skipped", trial.skipped()}});
  }
  return json;
}

}  // namespace haptrace
