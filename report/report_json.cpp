#include "base/enum_names.h"
#include "base/json_reader.h"
#include "report/course.h"

namespace haptrace {
namespace {

using nlohmann::json;

constexpr EnumNames<ReportEvent::Kind, 3> kEventKinds{"kind of event", {"stop", "warning", "mark"}};
constexpr EnumNames<ReportChange::Verdict, 5> kVerdicts{
    "verdict", {"undefined", "not_comparable", "error_unknown", "within_error", "beyond_error"}};

json json_of_trial(const ReportTrial& trial) {
  json figures = json::object();
  const std::span<const TrialFigure> known = all_trial_figures();
  for (std::size_t i = 0; i < known.size(); ++i) figures[known[i].name] = json_of_number(trial.figures[i]);
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
          {"samples", trial.samples},
          {"rank", trial.rank ? json(*trial.rank) : json(nullptr)},
          {"settings",
           {{"pace", json_of_number(trial.pace)},
            {"radius_m", json_of_number(trial.radius)},
            {"stiffness_n_per_m", json_of_number(trial.stiffness)},
            {"assistance", json_of_number(trial.assistance)},
            {"level", json_of_number(trial.level)},
            {"support_n", json_of_number(trial.support)}}},
          {"reach", trial.target.empty() ? json() : json(trial.target)},
          {"at_limit", trial.at_limit},
          {"answer", trial.answer ? json(*trial.answer) : json()},
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

/// A metric of which neither less nor more is better has a lower and an upper quartile instead.
json json_of_summary(const ReportSummary& summary, const TrialFigure& figure) {
  const bool ranks = figure.better != 0;
  return {{"median", json_of_number(summary.median)},
          {ranks ? "better_quartile" : "lower_quartile", json_of_number(summary.better_quartile)},
          {ranks ? "worse_quartile" : "upper_quartile", json_of_number(summary.worse_quartile)},
          {"finished", summary.finished},
          {"partial", summary.partial}};
}

json json_of_assessment(const ReportExercise& exercise) {
  if (exercise.assessment) return to_json(*exercise.assessment);
  return exercise.sense ? to_json(*exercise.sense) : json(nullptr);
}

json json_of_exercise(const ReportExercise& exercise) {
  json trials = json::array(), trends = json::object();
  for (const ReportTrial& trial : exercise.trials) trials.push_back(json_of_trial(trial));
  for (const ReportTrend& trend : exercise.trends)
    trends[all_trial_figures()[trend.figure].name] = json_of_trend(trend);
  json summaries = json::object();
  for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
    summaries[all_trial_figures()[i].name] = json_of_summary(summary_of(exercise, i), all_trial_figures()[i]);
  return {{"name", exercise.name},
          {"primary_metric", exercise.figure.empty() ? json(nullptr) : json(exercise.figure)},
          {"summary",
           {{"begun", exercise.trials.size()},
            {"finished", exercise.finished()},
            {"partial", exercise.out_of_time()},
            {"metrics", std::move(summaries)}}},
          {"blocks", to_json(exercise.blocks)},
          {"assessment", json_of_assessment(exercise)},
          {"mode", exercise.mode},
          {"test", exercise.test},
          {"warm_up", exercise.warm_up},
          {"path", exercise.path},
          {"path_length_m", exercise.path_length > 0 ? json(exercise.path_length) : json(nullptr)},
          {"trials", std::move(trials)},
          {"trends", std::move(trends)}};
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
    events.push_back({{"kind", kEventKinds.name(event.kind)},
                      {"where", event.where},
                      {"time_s", json_of_number(event.time)},
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
          {"device_force_n", session.device_force > 0 ? json(session.device_force) : json(nullptr)},
          {"force_limit_n", json_of_number(session.force_limit)},
          {"meta", session.meta},
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

json json_of_change(const ReportChange& change) {
  return {{"change", json_of_number(change.change)},
          {"mdc95", json_of_number(change.mdc95)},
          {"verdict", kVerdicts.name(change.verdict)},
          {"words", change.words}};
}

json json_of_comparison(const ReportComparison& comparison, const Report& report) {
  json tests = json::array();
  const std::span<const TrialFigure> known = all_trial_figures();
  const ReportComparison::Group& first = comparison.groups.front();
  for (const ReportComparison::Group& group : comparison.groups) {
    json metrics = json::object();
    for (std::size_t i = 0; i < known.size(); ++i) {
      metrics[known[i].name] = json_of_summary(group.summaries[i], known[i]);
      if (&group != &first)
        metrics[known[i].name]["from_first"] =
            json_of_change(change_between(report, {first.session, first.exercise}, {group.session, group.exercise}, i));
    }
    tests.push_back({{"test", group.test},
                     {"session", report.sessions[group.session].source},
                     {"created", report.sessions[group.session].created},
                     {"metrics", std::move(metrics)}});
  }
  return {{"subject", comparison.subject},
          {"session", comparison.session ? json(report.sessions[*comparison.session].source) : json(nullptr)},
          {"path", comparison.task},
          {"tests", std::move(tests)}};
}

json json_of_course(const ReportCourse& course, const Report& report) {
  json points = json::array();
  const ReportExercise& last = exercise_of(report, course.points.back());
  for (const ReportCourse::Point& point : course.points) {
    const ReportExercise& exercise = exercise_of(report, point);
    // Directions and pairs differ: there is no typical one, and a lower bound does not compare.
    json metrics = exercise.has_typical_trial() ? json::object() : json(nullptr);
    for (std::size_t i = 0; metrics.is_object() && i < all_trial_figures().size(); ++i) {
      json& metric = metrics[all_trial_figures()[i].name] =
          json_of_summary(summary_of(exercise, i), all_trial_figures()[i]);
      if (&point != &course.points.front())
        metric["from_first"] = json_of_change(change_between(report, course.points.front(), point, i));
    }
    const std::string why = obstacle(report, course.points.front(), point);
    points.push_back({{"session", report.sessions[point.session].source},
                      {"not_comparable_with_first", why.empty() ? json(nullptr) : json(why)},
                      {"created", report.sessions[point.session].created},
                      {"exercise", exercise.name},
                      {"begun", exercise.trials.size()},
                      {"finished", exercise.finished()},
                      {"partial", exercise.out_of_time()},
                      {"assessment", json_of_assessment(exercise)},
                      {"metrics", std::move(metrics)}});
  }
  return {{"exercise", last.name}, {"mode", last.mode}, {"test", last.test}, {"sessions", std::move(points)}};
}

json json_of_person(const ReportPerson& person, const Report& report) {
  json sessions = json::array(), courses = json::array();
  for (const std::size_t s : person.sessions) sessions.push_back(report.sessions[s].source);
  for (const ReportCourse& course : person.courses) courses.push_back(json_of_course(course, report));
  return {{"name", person.name}, {"sessions", std::move(sessions)}, {"over_sessions", std::move(courses)}};
}

json json_of_norms(const Report& report) {
  const Norms& norms = *report.norms;
  json metrics = json::object();
  for (const auto& [name, norm] : norms.metrics)
    metrics[name] = {{"mdc95", json_of_number(mdc95_of(norm))},
                     {"low", json_of_number(norm.low)},
                     {"high", json_of_number(norm.high)}};
  return {{"file", norms.file},
          {"source", norms.source},
          {"population", norms.population},
          {"age", {norms.age_from, norms.age_to}},
          {"device", norms.device},
          {"task", norms.task},
          {"mode", norms.mode},
          {"hold", norms_hold(report)},
          {"metrics", std::move(metrics)}};
}

}  // namespace

json to_json(const Report& report) {
  json sessions = json::array(), comparisons = json::array(), persons = json::array();
  for (const ReportSession& session : report.sessions) sessions.push_back(json_of_session(session));
  for (const ReportComparison& comparison : report.comparisons)
    comparisons.push_back(json_of_comparison(comparison, report));
  for (const ReportPerson& person : report.persons) persons.push_back(json_of_person(person, report));
  return {{"sessions", std::move(sessions)},
          {"comparisons", std::move(comparisons)},
          {"persons", std::move(persons)},
          {"norms", report.norms ? json_of_norms(report) : json(nullptr)},
          {"definitions", definitions_of_figures()}};
}

}  // namespace haptrace
