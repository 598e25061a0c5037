#include "report/course.h"

#include "base/error.h"
#include "base/rfc3339.h"
#include "base/statistics.h"
#include "base/units.h"
#include "metrics/reliability.h"
#include "report/chart.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <map>
#include <tuple>

namespace haptrace {
namespace {

bool contains(const std::string& text, const std::string& part) {
  return lower_case(text).find(lower_case(part)) != std::string::npos;
}

/// Returns a quantile of values of which the first `known` are finite and the others worse than all of them; NaN if it
/// falls among those.
double quantile_of_known(const std::vector<double>& values, std::size_t failures, double q) {
  if (values.empty()) return kNaN;
  const double at = q * static_cast<double>(values.size() + failures - 1);
  if (std::ceil(at - 1e-9) >= static_cast<double>(values.size())) return kNaN;
  const auto i = static_cast<std::size_t>(at + 1e-9);
  const std::size_t next = std::min(i + 1, values.size() - 1);
  return std::lerp(values[i], values[next], at - static_cast<double>(i));
}

std::string meta_of(const ReportSession& session, const std::string& key) {
  const auto found = session.meta.find(key);
  return found != session.meta.end() ? lower_case(found->second) : "";
}

/// Returns the median of a setting over the finished repetitions.
double typical(const ReportExercise& exercise, std::optional<double> ReportTrial::*setting) {
  std::vector<double> values;
  for (const ReportTrial& trial : exercise.trials)
    if (trial.finished() && trial.*setting) values.push_back(*(trial.*setting));
  return median(std::move(values));
}

bool assistance_changed(const ReportExercise& a, const ReportExercise& b) {
  for (const auto setting : {&ReportTrial::pace, &ReportTrial::radius, &ReportTrial::stiffness,
                             &ReportTrial::assistance, &ReportTrial::level}) {
    constexpr double kSame = 1e-3;
    const double x = typical(a, setting), y = typical(b, setting);
    if (std::isnan(x) != std::isnan(y) || std::abs(x - y) > kSame * std::max(std::abs(x), std::abs(y))) return true;
  }
  // A share of a weight that is measured anew differs a little from day to day.
  constexpr double kSameSupport = 0.2;
  double x = typical(a, &ReportTrial::support), y = typical(b, &ReportTrial::support);
  if (std::isnan(x)) x = 0;
  if (std::isnan(y)) y = 0;
  return std::abs(x - y) > kSameSupport * std::max(x, y);
}

/// Returns the courses of one participant.
std::vector<ReportCourse> courses_of(std::span<const ReportSession> sessions, const std::vector<std::size_t>& of) {
  // The last number counts exercises that are otherwise the same within one session.
  using Key = std::tuple<std::optional<std::size_t>, std::string, std::string, std::string, std::size_t>;
  std::map<Key, std::size_t> known;
  std::vector<ReportCourse> courses;
  for (const std::size_t s : of) {
    if (sessions[s].steered) continue;
    std::map<Key, std::size_t> within;
    for (std::size_t e = 0; e < sessions[s].exercises.size(); ++e) {
      const ReportExercise& exercise = sessions[s].exercises[e];
      if (exercise.warm_up || exercise.trials.empty()) continue;
      Key key{exercise.task, exercise.task ? "" : exercise.path, exercise.mode, exercise.test, 0};
      std::get<4>(key) = within[key]++;
      const auto [found, added] = known.try_emplace(key, courses.size());
      if (added) courses.emplace_back();
      std::vector<ReportCourse::Point>& points = courses[found->second].points;
      double day = kNaN;
      const auto now = parse_rfc3339(sessions[s].created);
      if (points.empty())
        day = now ? 0 : kNaN;
      else if (const auto first = parse_rfc3339(sessions[points.front().session].created); now && first)
        day = std::chrono::duration<double>(*now - *first).count() / 86'400;
      points.push_back({.session = s, .exercise = e, .day = day});
    }
  }
  std::erase_if(courses, [](const ReportCourse& course) { return course.points.size() < 2; });
  return courses;
}

std::string other_norms(const Norms& norms) {
  return fmt::format("the norms are for {}, {}, {}", norms.device, norms.task, norms.mode);
}

}  // namespace

ReportSummary summary_of(const ReportExercise& exercise, std::size_t figure) {
  ReportSummary summary;
  const int better = all_trial_figures()[figure].better;
  std::vector<double> values;
  for (const ReportTrial& trial : exercise.trials) {
    if (trial.finished() && figure < trial.figures.size() && trial.figures[figure])
      values.push_back(*trial.figures[figure]);
    summary.partial += trial.out_of_time() ? 1 : 0;
  }
  summary.finished = values.size();
  std::sort(values.begin(), values.end());
  if (better > 0) std::reverse(values.begin(), values.end());
  // A metric without a better direction cannot rank a repetition that was not finished.
  const std::size_t failures = better != 0 ? summary.partial : 0;
  summary.better_quartile = quantile_of_known(values, failures, 0.25);
  summary.median = quantile_of_known(values, failures, 0.5);
  summary.worse_quartile = quantile_of_known(values, failures, 0.75);
  return summary;
}

std::string why_undefined(const ReportExercise& exercise, std::size_t figure) {
  if (exercise.finished() == 0) return "no repetition was finished";
  if (summary_of(exercise, figure).finished == 0) return "the metric is undefined in every finished repetition";
  return "half of the repetitions or more ran out of time";
}

std::vector<ReportPerson> persons_of(std::span<const ReportSession> sessions) {
  std::vector<ReportPerson> persons;
  for (std::size_t s = 0; s < sessions.size(); ++s) {
    const std::string& name = sessions[s].subject;
    const auto found = std::find_if(persons.begin(), persons.end(), [&](const ReportPerson& person) {
      return !name.empty() && sessions[person.sessions.front()].subject == name;
    });
    if (found != persons.end())
      found->sessions.push_back(s);
    else
      persons.push_back({.name = name, .sessions = {s}, .courses = {}});
  }
  std::size_t unnamed = 0;
  for (ReportPerson& person : persons) {
    if (person.name.empty()) person.name = fmt::format("Participant without a name {}", ++unnamed);
    person.courses = courses_of(sessions, person.sessions);
  }
  return persons;
}

void set_norms(Report& report, Norms norms) {
  for (const auto& [name, norm] : norms.metrics) try {
      (void)trial_figure(name);
    } catch (const Error& error) {
      throw input_error(fmt::format("{}: metrics: {}", norms.file, error.what()));
    }
  report.norms = std::move(norms);
  if (norms_hold(report)) return;
  for (ReportSession& session : report.sessions)
    session.remarks.push_back(
        fmt::format("the norms of {} are for {}, {}, {}: they hold for no exercise of this report", report.norms->file,
                    report.norms->device, report.norms->task, report.norms->mode));
}

std::optional<double> mdc95_of(const MetricNorm& norm) {
  if (norm.mdc95) return norm.mdc95;
  if (norm.sem) return mdc95(*norm.sem);
  if (norm.sd && norm.icc) return mdc95(standard_error_of_measurement(*norm.sd, *norm.icc));
  if (const std::optional<Reliability> found = reliability(norm.retest)) return found->mdc95;
  return std::nullopt;
}

const MetricNorm* norm_of(const Report& report, const ReportCourse::Point& point, std::size_t figure) {
  if (!report.norms) return nullptr;
  const Norms& norms = *report.norms;
  const ReportExercise& exercise = exercise_of(report, point);
  if (!contains(report.sessions[point.session].device, norms.device) || exercise.mode != norms.mode ||
      (!contains(exercise.name, norms.task) && !contains(exercise.path, norms.task)))
    return nullptr;
  const auto found = norms.metrics.find(all_trial_figures()[figure].name);
  return found != norms.metrics.end() ? &found->second : nullptr;
}

bool norms_hold(const Report& report) {
  for (std::size_t s = 0; s < report.sessions.size(); ++s)
    for (std::size_t e = 0; e < report.sessions[s].exercises.size(); ++e)
      for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
        if (norm_of(report, {.session = s, .exercise = e}, i) != nullptr) return true;
  return false;
}

std::string obstacle(const Report& report, const ReportCourse::Point& from, const ReportCourse::Point& to) {
  const ReportSession &a = report.sessions[from.session], &b = report.sessions[to.session];
  if (a.device != b.device) return "the device changed";
  for (const char* key : {"side", "hand"})
    if (meta_of(a, key) != meta_of(b, key)) return "the side changed";
  if (assistance_changed(exercise_of(report, from), exercise_of(report, to))) return "the assistance changed";
  const ReportExercise& exercise = exercise_of(report, to);
  if (exercise_of(report, from).reach != exercise.reach)
    return exercise.sense        ? "the places changed"
           : exercise.assessment ? "the settings of the exercise changed"
                                 : "the force field, the clamp or the blocks changed";
  if ((exercise.mode == "press" || exercise.mode == "weigh") && a.force_limit != b.force_limit)
    return "the force limit changed";
  return "";
}

ReportChange change_between(const Report& report, const ReportCourse::Point& from, const ReportCourse::Point& to,
                            std::size_t figure) {
  using enum ReportChange::Verdict;
  const TrialFigure& of = all_trial_figures()[figure];
  ReportChange change{.change = summary_of(exercise_of(report, to), figure).median -
                                summary_of(exercise_of(report, from), figure).median};
  if (!std::isfinite(change.change)) {
    change.verdict = undefined;
    const ReportExercise& undefined_in = std::isfinite(summary_of(exercise_of(report, from), figure).median)
                                             ? exercise_of(report, to)
                                             : exercise_of(report, from);
    change.words = "undefined: " + why_undefined(undefined_in, figure);
    return change;
  }
  if (const std::string reason = obstacle(report, from, to); !reason.empty()) {
    change.verdict = incomparable;
    change.words = "not comparable: " + reason;
    return change;
  }
  const MetricNorm* norm = norm_of(report, to, figure);
  if (norm != nullptr) change.mdc95 = mdc95_of(*norm);
  if (!change.mdc95) {
    change.words = "repetition spread; day-to-day error unknown";
    if (report.norms && norm == nullptr) change.words += " (" + other_norms(*report.norms) + ")";
    return change;
  }
  const std::string limit = shown(of, *change.mdc95);
  if (std::abs(change.change) <= *change.mdc95) {
    change.verdict = none;
    change.words = fmt::format("no change that this test can show (minimal detectable change {})", limit);
    return change;
  }
  change.verdict = beyond;
  const char* direction = of.better == 0 ? "changed" : (of.better < 0) == (change.change < 0) ? "better" : "worse";
  change.words = fmt::format("{} by more than the measurement error (minimal detectable change {})", direction, limit);
  return change;
}

std::optional<CourseLine> line_of(const Report& report, const ReportCourse& course, std::size_t figure) {
  std::vector<double> days, values;
  for (const ReportCourse::Point& point : course.points) {
    const double value = summary_of(exercise_of(report, point), figure).median;
    if (!std::isfinite(value) || !std::isfinite(point.day)) continue;
    if (!obstacle(report, course.points.front(), point).empty()) return std::nullopt;
    days.push_back(point.day);
    values.push_back(value);
  }
  if (values.size() < kFewestForLine) return std::nullopt;
  const std::optional<LearningTrend> trend = fit_trend(days, values);
  if (!trend) return std::nullopt;
  const double span = days.back() - days.front();
  return CourseLine{.first = trend->first,
                    .last = trend->first + trend->slope * span,
                    .half_width = trend->slope_half_width * span,
                    .from_day = days.front(),
                    .to_day = days.back(),
                    .sessions = values.size()};
}

}  // namespace haptrace
