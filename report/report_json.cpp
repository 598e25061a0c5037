#include "base/json_reader.h"
#include "report/session_report.h"

namespace haptrace {
namespace {

using nlohmann::json;

json json_of_optional(const std::optional<double>& value) {
  return value ? json_of_number(*value) : json(nullptr);
}

json json_of_trial(const ReportTrial& trial) {
  json figures = json::object();
  const std::span<const TrialFigure> known = all_trial_figures();
  for (std::size_t i = 0; i < known.size(); ++i) figures[known[i].name] = json_of_optional(trial.figures[i]);
  return {{"round", trial.round},
          {"repetition", trial.repetition},
          {"attempt", trial.attempt},
          {"file", trial.file},
          {"began", trial.began},
          {"stopped_by", trial.stopped_by},
          {"partial", trial.out_of_time()},
          {"detail", trial.detail},
          {"missing", trial.missing},
          {"duration_s", trial.duration},
          {"settings",
           {{"pace", json_of_optional(trial.pace)},
            {"radius_m", json_of_optional(trial.radius)},
            {"stiffness_n_per_m", json_of_optional(trial.stiffness)},
            {"assistance", json_of_optional(trial.assistance)},
            {"level", json_of_optional(trial.level)}}},
          {"figures", std::move(figures)}};
}

json json_of_trend(const ReportTrend& trend) {
  json result{{"learning_curve", nullptr}, {"line", nullptr}};
  if (trend.curve)
    result["learning_curve"] = {{"law", trend.curve->law == LearningLaw::power ? "power" : "exponential"},
                                {"first", json_of_number(trend.curve->first)},
                                {"plateau", json_of_number(trend.curve->plateau)},
                                {"rate", json_of_number(trend.curve->rate)},
                                {"r_squared", json_of_number(trend.curve->r_squared)}};
  if (trend.line)
    result["line"] = {{"first", json_of_number(trend.line->first)},
                      {"slope", json_of_number(trend.line->slope)},
                      {"slope_half_width_95", json_of_number(trend.line->slope_half_width)},
                      {"r_squared", json_of_number(trend.line->r_squared)}};
  return result;
}

json json_of_exercise(const ReportExercise& exercise) {
  json trials = json::array(), trends = json::object();
  for (const ReportTrial& trial : exercise.trials) trials.push_back(json_of_trial(trial));
  for (const ReportTrend& trend : exercise.trends)
    trends[all_trial_figures()[trend.figure].name] = json_of_trend(trend);
  return {{"name", exercise.name},
          {"mode", exercise.mode},
          {"test", exercise.test},
          {"warm_up", exercise.warm_up},
          {"path", exercise.path},
          {"path_length_m", exercise.path_length > 0 ? json(exercise.path_length) : json(nullptr)},
          {"trials", std::move(trials)},
          {"trends", std::move(trends)}};
}

const char* name_of(ReportEvent::Kind kind) {
  switch (kind) {
    case ReportEvent::Kind::stop:
      return "stop";
    case ReportEvent::Kind::warning:
      return "warning";
    case ReportEvent::Kind::mark:
      break;
  }
  return "mark";
}

json json_of_session(const ReportSession& session) {
  json sittings = json::array(), exercises = json::array(), events = json::array();
  for (const Sitting& sitting : session.sittings)
    sittings.push_back({{"began", sitting.began},
                        {"ended", sitting.ended},
                        {"ended_by", sitting.ended_by},
                        {"detail", sitting.detail},
                        {"duration_s", sitting.duration},
                        {"force_dose_n_s", sitting.force_dose}});
  for (const ReportExercise& exercise : session.exercises) exercises.push_back(json_of_exercise(exercise));
  for (const ReportEvent& event : session.events)
    events.push_back({{"kind", name_of(event.kind)},
                      {"where", event.where},
                      {"time_s", json_of_optional(event.time)},
                      {"times", event.times},
                      {"text", event.text}});
  return {{"source", session.source},
          {"title", session.title},
          {"subject", session.subject},
          {"operator", session.operator_name},
          {"notes", session.notes},
          {"created", session.created},
          {"software", session.software},
          {"device", session.device},
          {"complete", session.complete},
          {"duration_s", session.duration},
          {"sittings", std::move(sittings)},
          {"exercises", std::move(exercises)},
          {"events", std::move(events)},
          {"remarks", session.remarks},
          {"settings", session.settings},
          {"steered", session.steered},
          {"touches", json_of(session.touches)}};
}

json json_of_comparison(const ReportComparison& comparison, const Report& report) {
  json groups = json::object();
  const std::span<const TrialFigure> known = all_trial_figures();
  for (const ReportComparison::Group& group : comparison.groups) {
    json figures = json::object();
    for (std::size_t i = 0; i < known.size(); ++i)
      figures[known[i].name] = {{"repetitions", group.values[i].size()},
                                {"mean", json_of_number(group.mean(i))},
                                {"standard_deviation", json_of_number(group.spread(i))},
                                {"partial", group.partial.size()},
                                {"ranked_median", json_of_number(group.ranked_median(i))}};
    groups[group.test] = std::move(figures);
  }
  return {{"subject", comparison.subject},
          {"session", comparison.session ? json(report.sessions[*comparison.session].source) : json(nullptr)},
          {"path", comparison.task},
          {"tests", std::move(groups)}};
}

}  // namespace

json to_json(const Report& report) {
  json sessions = json::array(), comparisons = json::array();
  for (const ReportSession& session : report.sessions) sessions.push_back(json_of_session(session));
  for (const ReportComparison& comparison : report.comparisons)
    comparisons.push_back(json_of_comparison(comparison, report));
  return {{"sessions", std::move(sessions)}, {"comparisons", std::move(comparisons)}};
}

}  // namespace haptrace
