#include "player/programme/progression.h"

#include "base/error.h"
#include "base/statistics.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

void check_figure(const std::string& name, const std::string& where) {
  try {
    if (trial_figure(name).better != 0) return;
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: {}", where, error.what()));
  }
  throw input_error(fmt::format("{}: a larger {} is neither better nor worse; choose another metric", where, name));
}

}  // namespace

double shortfall(const Progression& progression, std::optional<double> figure) {
  if (!figure || !std::isfinite(*figure)) return 1;
  const int better = trial_figure(progression.figure).better;
  return std::clamp(better * (progression.target - *figure) / std::abs(progression.target), 0.0, 1.0);
}

ProgressionState::ProgressionState(const Exercise& exercise) : exercise_(&exercise) {
  if (!exercise.progression) return;
  if (exercise.progression->assistance) assistance_ = exercise.progression->assistance->start;
  if (exercise.progression->difficulty) level_ = exercise.progression->difficulty->start;
}

TrialSettings ProgressionState::settings() const {
  TrialSettings settings{.pace = exercise_->pace,
                         .radius = exercise_->radius,
                         .stiffness = exercise_->stiffness,
                         .assistance = assistance_,
                         .level = level_};
  if (!exercise_->progression || !exercise_->progression->difficulty) return settings;
  const Progression::Difficulty& difficulty = *exercise_->progression->difficulty;
  if (difficulty.pace) settings.pace = difficulty.pace->at(level_);
  if (difficulty.radius) settings.radius = difficulty.radius->at(level_);
  if (difficulty.stiffness) settings.stiffness = difficulty.stiffness->at(level_);
  return settings;
}

void ProgressionState::learn(const LoggedTrial& trial) {
  if (!exercise_->progression) return;
  const Progression& progression = *exercise_->progression;
  learn(trial.finished() ? shortfall(progression, figure_in(trial.figures, progression.figure)) : 1);
}

void ProgressionState::learn(double e) {
  const Progression& progression = *exercise_->progression;
  if (const auto& law = progression.assistance)
    assistance_ = std::clamp(law->forget * assistance_ + law->gain * e, 0.0, 1.0);
  if (const auto& law = progression.difficulty) {
    shortfalls_.push_back(e);
    if (shortfalls_.size() < static_cast<std::size_t>(progression.window)) return;
    const double typical = median({shortfalls_.begin(), shortfalls_.end()});
    shortfalls_.pop_front();
    if (typical > 0 && typical <= progression.tolerance) return;
    level_ = std::clamp(level_ + (typical > 0 ? -law->step : law->step), 0.0, 1.0);
    shortfalls_.clear();
  }
}

bool is_tired(const ProgrammeLimits::Fatigue& fatigue, const std::vector<nlohmann::json>& figures) {
  const auto last = static_cast<std::size_t>(fatigue.repetitions);
  if (figures.size() <= last) return false;
  const int better = trial_figure(fatigue.figure).better;
  std::optional<double> best;
  for (const nlohmann::json& one : figures)
    if (const auto value = figure_in(one, fatigue.figure); value && (!best || better * (*value - *best) > 0))
      best = value;
  if (!best) return false;
  return std::all_of(figures.end() - fatigue.repetitions, figures.end(), [&](const nlohmann::json& one) {
    const auto value = figure_in(one, fatigue.figure);
    return !value || better * (*best - *value) > fatigue.worse * std::abs(*best);
  });
}

void check_figures(const Programme& programme, const std::string& where) {
  if (programme.limits.fatigue) check_figure(programme.limits.fatigue->figure, where + ": limits.fatigue.figure");
  for (std::size_t i = 0; i < programme.size(); ++i) {
    const bool warm_up = i < programme.warm_up.size();
    if (const auto& progression = programme.exercise(i).progression)
      check_figure(progression->figure,
                   fmt::format("{}: {}[{}].progression.figure", where, warm_up ? "warm_up" : "exercises",
                               warm_up ? i : i - programme.warm_up.size()));
  }
}

}  // namespace haptrace
