#include "metrics/assessment_summary.h"

#include "base/json_reader.h"
#include "control/path/shapes.h"
#include "metrics/recorded_trial.h"

#include <algorithm>
#include <boost/geometry/algorithms/area.hpp>
#include <boost/geometry/algorithms/convex_hull.hpp>
#include <boost/geometry/geometries/multi_point.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/geometries/polygon.hpp>
#include <boost/geometry/strategies/strategies.hpp>
#include <fmt/format.h>
#include <numeric>

namespace haptrace {
namespace {

/// Returns the area of the convex hull of the best places, in the plane of the task.
std::optional<double> area_of(const ReachTask& task, const std::vector<DirectionSummary>& directions) {
  namespace bg = boost::geometry;
  using Point = bg::model::point<double, 2, bg::cs::cartesian>;
  const auto [right, up] = plane_axes(task.plane);
  bg::model::multi_point<Point> places;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    if (!directions[i].best) continue;
    const Vec3 place = *directions[i].best * (task.targets[i] - task.start).normalized();
    places.emplace_back(place.dot(right), place.dot(up));
  }
  constexpr std::size_t kLeast = 3;
  if (places.size() < kLeast) return std::nullopt;
  bg::model::polygon<Point> hull;
  bg::convex_hull(places, hull);
  return std::abs(bg::area(hull));
}

std::optional<double> mean_figure(const std::vector<const LoggedTrial*>& trials, const char* name) {
  double sum = 0, n = 0;
  for (const LoggedTrial* trial : trials)
    if (const std::optional<double> value = figure_in(trial->figures, name)) {
      sum += *value;
      n += 1;
    }
  return n > 0 ? std::optional(sum / n) : std::nullopt;
}

const char* figure_of(ReachGoal goal) {
  return goal == ReachGoal::range   ? "range_m"
         : goal == ReachGoal::press ? "press_force_n"
         : goal == ReachGoal::weigh ? "arm_weight_n"
                                    : "tracking_rms_m";
}

/// Returns true if a goal has results by direction.
bool has_directions(ReachGoal goal) {
  return goal == ReachGoal::range || goal == ReachGoal::press;
}

/// Returns true if a trial counts in results: the participant did it, attended.
bool counts(const LoggedTrial& trial) {
  return trial.reach && trial.done() && trial.input.empty() && !trial.unattended;
}

}  // namespace

bool AssessmentSummary::at_limit() const {
  return heavier ||
         std::any_of(directions.begin(), directions.end(), [](const DirectionSummary& one) { return one.at_limit; });
}

std::optional<AssessmentSummary> summarise_assessment(const Programme& programme, std::size_t i,
                                                      const SessionLog& log) {
  const Exercise& exercise = programme.exercise(i);
  if (!exercise.reach || exercise.reach->goal == ReachGoal::target) return std::nullopt;
  const ReachTask& task = *exercise.reach;
  AssessmentSummary summary{
      .goal = task.goal, .directions = {}, .area = {}, .rms = {}, .gain = {}, .delay = {}, .weight = {}};
  if (has_directions(task.goal))
    for (std::size_t target = 0; target < task.targets.size(); ++target)
      summary.directions.push_back({.angle = angle_of(task, target), .best = {}});
  std::vector<const LoggedTrial*> trials;
  for (const LoggedTrial& trial : log.trials) {
    if (trial.exercise != i || !counts(trial)) continue;
    const std::optional<double> value = figure_in(trial.figures, figure_of(task.goal));
    if (!value) continue;
    trials.push_back(&trial);
    if (task.goal == ReachGoal::weigh) summary.heavier = summary.heavier || trial.figures.contains("at_limit");
    if (!has_directions(task.goal)) continue;
    DirectionSummary& direction = summary.directions.at(static_cast<std::size_t>(trial.reach->target));
    ++direction.tries;
    if (direction.best && *value <= *direction.best) continue;
    direction.best = value;
    direction.at_limit = trial.figures.contains("at_limit");
  }
  summary.trials = trials.size();
  if (task.goal == ReachGoal::range) summary.area = area_of(task, summary.directions);
  if (task.goal == ReachGoal::track) {
    summary.rms = mean_figure(trials, "tracking_rms_m");
    summary.gain = mean_figure(trials, "tracking_gain");
    summary.delay = mean_figure(trials, "tracking_delay_s");
  }
  if (task.goal == ReachGoal::weigh) summary.weight = mean_figure(trials, figure_of(task.goal));
  return summary;
}

std::optional<ArmWeight> weight_of_arm(const Programme& programme, const SessionLog& log) {
  std::size_t end = log.trials.size();
  for (auto sitting = log.sittings.rbegin(); sitting != log.sittings.rend(); ++sitting) {
    std::vector<const LoggedTrial*> trials;
    for (std::size_t i = sitting->first_trial; i < end; ++i)
      if (programme.exercise(log.trials[i].exercise).mode == ExerciseMode::weigh && counts(log.trials[i]))
        trials.push_back(&log.trials[i]);
    if (const std::optional<double> weight = mean_figure(trials, figure_of(ReachGoal::weigh)))
      return ArmWeight{.weight = *weight, .is_earlier = sitting != log.sittings.rbegin()};
    end = sitting->first_trial;
  }
  return std::nullopt;
}

nlohmann::json to_json(const AssessmentSummary& summary) {
  nlohmann::json json{{"goal", to_string(summary.goal)}, {"trials", summary.trials}};
  if (summary.goal == ReachGoal::track) {
    json["rms_m"] = json_of_number(summary.rms);
    json["gain"] = json_of_number(summary.gain);
    json["delay_s"] = json_of_number(summary.delay);
    return json;
  }
  if (summary.goal == ReachGoal::weigh) {
    json["weight_n"] = json_of_number(summary.weight);
    json["at_limit"] = summary.at_limit();
    return json;
  }
  const char* const key = summary.goal == ReachGoal::range ? "best_m" : "best_n";
  json["directions"] = nlohmann::json::array();
  for (const DirectionSummary& one : summary.directions)
    json["directions"].push_back({{"angle_deg", json_of_number(one.angle)},
                                  {"tries", one.tries},
                                  {key, json_of_number(one.best)},
                                  {"at_limit", one.at_limit}});
  if (summary.goal == ReachGoal::range) {
    json["area_m2"] = json_of_number(summary.area);
    json["area_at_limit"] = summary.at_limit();
  }
  return json;
}

std::vector<NamedResult> results_of(const AssessmentSummary& summary) {
  const auto text = [](const std::optional<double>& value, double scale, int digits, const char* unit) {
    return value ? fmt::format("{:.{}f}{}", scale * *value, digits, unit) : std::string("undefined");
  };
  if (summary.goal == ReachGoal::track)
    return {{"rms error", text(summary.rms, 1e3, 1, " mm")},
            {"gain", text(summary.gain, 1, 2, "")},
            {"delay", text(summary.delay, 1e3, 0, " ms")}};
  if (summary.goal == ReachGoal::weigh)
    return {{"weight of the arm", (summary.at_limit() ? ">= " : "") + text(summary.weight, 1, 2, " N")}};
  std::vector<NamedResult> results;
  const bool range = summary.goal == ReachGoal::range;
  for (std::size_t i = 0; i < summary.directions.size(); ++i) {
    const DirectionSummary& one = summary.directions[i];
    results.push_back(
        {fmt::format("direction {} ({})", i + 1, angle_in_words(one.angle)),
         (one.at_limit ? ">= " : "") + (range ? text(one.best, 1e3, 1, " mm") : text(one.best, 1, 2, " N"))});
  }
  if (summary.area)
    results.push_back(
        {"area within these places", (summary.at_limit() ? ">= " : "") + text(summary.area, 1e4, 1, " cm2")});
  return results;
}

std::vector<std::string> describe(const AssessmentSummary& summary) {
  if (summary.trials == 0) return {"no trial with a metric"};
  const std::vector<NamedResult> results = results_of(summary);
  std::vector<std::string> lines;
  if (!has_directions(summary.goal)) {
    for (const NamedResult& one : results) lines.push_back(fmt::format("{} {}", one.name, one.value));
    return {fmt::format("{} trial{}: {}", summary.trials, summary.trials == 1 ? "" : "s", fmt::join(lines, ", "))};
  }
  for (std::size_t i = 0; i < results.size(); ++i) {
    lines.push_back(fmt::format("{}: {}", results[i].name, results[i].value));
    if (i < summary.directions.size()) lines.back() += fmt::format(", best of {}", summary.directions[i].tries);
  }
  if (summary.at_limit())
    lines.emplace_back(summary.goal == ReachGoal::range
                           ? ">=: the device ends there, and the person may come farther"
                           : ">=: the device had no more force, or gave way; the person may be stronger");
  return lines;
}

}  // namespace haptrace
