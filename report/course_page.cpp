#include "report/course_page.h"

#include "report/chart.h"
#include "report/local_time.h"
#include "report/markup.h"
#include "report/table.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <set>

namespace haptrace {
namespace {

using pugi::xml_node;

/// Returns the primary metric of the first session of a course that has one.
std::optional<std::size_t> primary_figure(const Report& report, const ReportCourse& course) {
  for (const ReportCourse::Point& point : course.points)
    if (const auto figure = haptrace::primary_figure(exercise_of(report, point))) return figure;
  return std::nullopt;
}

std::string settings_in_words(const ReportExercise& exercise) {
  std::vector<std::string> parts;
  const auto add_setting = [&](const char* name, std::optional<double> ReportTrial::*setting, double scale, int digits,
                               const char* unit) {
    double low = kNaN, high = kNaN;
    for (const ReportTrial& trial : exercise.trials)
      if (const std::optional<double>& value = trial.*setting) {
        low = std::isnan(low) ? *value : std::min(low, *value);
        high = std::isnan(high) ? *value : std::max(high, *value);
      }
    if (std::isnan(low)) return;
    const std::string a = fmt::format("{:.{}f}", scale * low, digits), b = fmt::format("{:.{}f}", scale * high, digits);
    parts.push_back(fmt::format("{} {}{}", name, a == b ? a : a + " to " + b, unit));
  };
  add_setting("radius", &ReportTrial::radius, 1e3, 1, " mm");
  add_setting("stiffness", &ReportTrial::stiffness, 1, 0, " N/m");
  add_setting("pace", &ReportTrial::pace, 1, 2, "");
  add_setting("assistance allowed", &ReportTrial::assistance, 100, 0, " %");
  add_setting("level", &ReportTrial::level, 1, 2, "");
  add_setting("support of the arm", &ReportTrial::support, 1, 1, " N");
  return parts.empty() ? "no guidance" : fmt::format("{}", fmt::join(parts, ", "));
}

void add_sessions(xml_node parent, const Report& report, const ReportPerson& person, const ReportCourse& course,
                  std::size_t primary) {
  const TrialFigure& figure = all_trial_figures()[primary];
  const std::string unit = *figure.unit != '\0' ? fmt::format(" ({})", figure.unit) : "";
  Table table(
      parent,
      fmt::format("{}: {}{}, one summary per session. Repetitions that ran out of time rank below finished ones.",
                  person.name, figure.title, unit),
      course.points.size());
  table.column("Session");
  if (report.persons.size() > 1) table.column("Participant");
  table.column("Repetitions");
  table.column("Settings");
  table.column("Median", true);
  table.column("Middle half", true);
  table.column("Change from the first", true);
  table.column("Meaning of the change");
  for (const ReportCourse::Point& point : course.points) {
    const ReportExercise& exercise = exercise_of(report, point);
    const ReportSummary summary = summary_of(exercise, primary);
    table.row(local_minute(report.sessions[point.session].created));
    if (report.persons.size() > 1) table.text(person.name);
    table.text(counts_in_words(exercise));
    table.text(settings_in_words(exercise));
    table.number(shown(figure, summary.median, false));
    table.number(middle_half(figure, summary));
    if (&point == &course.points.front()) {
      table.number(kUndefined);
      table.text(kUndefined);
      continue;
    }
    const ReportChange change = change_between(report, course.points.front(), point, primary);
    table.number(shown(figure, change.change, false, true));
    table.text(change.words);
  }
}

/// Returns the results of an assessment; none of other exercises.
std::vector<NamedResult> results_of(const ReportExercise& exercise) {
  if (exercise.sense) return haptrace::results_of(*exercise.sense);
  return exercise.assessment ? haptrace::results_of(*exercise.assessment) : std::vector<NamedResult>();
}

/// Adds the results of an assessment, one column for each session.
void add_results(xml_node parent, const Report& report, const ReportPerson& person, const ReportCourse& course) {
  std::vector<std::string> names;  // of all sessions: an area needs three directions
  for (const ReportCourse::Point& point : course.points)
    for (const NamedResult& one : results_of(exercise_of(report, point)))
      if (std::ranges::find(names, one.name) == names.end()) names.push_back(one.name);
  if (names.empty()) return;
  Table table(parent,
              fmt::format("{}: results, one for each session. Their error between sessions is not known: two sessions "
                          "differ by chance as well.",
                          person.name),
              names.size());
  table.column("Result");
  for (const ReportCourse::Point& point : course.points) {
    const std::string why = obstacle(report, course.points.front(), point);
    table.column(local_minute(report.sessions[point.session].created) +
                     (why.empty() ? "" : fmt::format(" (not comparable with the first: {})", why)),
                 true);
  }
  for (const std::string& name : names) {
    table.row(name);
    for (const ReportCourse::Point& point : course.points) {
      const std::vector<NamedResult> results = results_of(exercise_of(report, point));
      const auto found = std::ranges::find(results, name, &NamedResult::name);
      if (found == results.end() || found->value == "undefined")
        table.number(kUndefined);
      else if (found->value.starts_with(">="))
        table.number("\u2265" + found->value.substr(2));
      else
        table.number(with_minus(found->value));
    }
  }
}

void add_exploratory(xml_node parent, const Report& report, const ReportCourse& course, std::size_t primary) {
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < all_trial_figures().size(); ++i)
    if (i != primary && std::any_of(course.points.begin(), course.points.end(), [&](const ReportCourse::Point& point) {
          return std::isfinite(summary_of(exercise_of(report, point), i).median);
        }))
      others.push_back(i);
  if (others.empty()) return;
  xml_node details = parent.append_child("details");
  add(details, "summary", "Exploratory metrics over sessions");
  Table table(details, "Medians of the other metrics, one per session. They were not named beforehand.", others.size());
  table.column("Metric");
  for (const ReportCourse::Point& point : course.points)
    table.column(local_minute(report.sessions[point.session].created), true);
  for (const std::size_t i : others) {
    const TrialFigure& figure = all_trial_figures()[i];
    table.row(*figure.unit != '\0' ? fmt::format("{} ({})", figure.title, figure.unit) : figure.title);
    for (const ReportCourse::Point& point : course.points)
      table.number(shown(figure, summary_of(exercise_of(report, point), i).median, false));
  }
}

}  // namespace

std::optional<std::size_t> primary_figure(const ReportExercise& exercise) {
  if (exercise.figure.empty()) return std::nullopt;
  return static_cast<std::size_t>(&trial_figure(exercise.figure) - all_trial_figures().data());
}

std::string counts_in_words(const ReportExercise& exercise) {
  const std::size_t done = exercise.finished(), late = exercise.out_of_time(), all = exercise.trials.size();
  std::string words = fmt::format("{} of {} done", done, all);
  if (late > 0) words += fmt::format(", {} partial", late);
  if (all > done + late) words += fmt::format(", {} stopped", all - done - late);
  return words;
}

std::string middle_half(const TrialFigure& figure, const ReportSummary& summary) {
  if (summary.finished < 2 || !std::isfinite(summary.better_quartile)) return kUndefined;
  if (!std::isfinite(summary.worse_quartile))
    return fmt::format("{} to not finished", shown(figure, summary.better_quartile, false));
  const double low = std::min(summary.better_quartile, summary.worse_quartile),
               high = std::max(summary.better_quartile, summary.worse_quartile);
  return fmt::format("{} to {}", shown(figure, low, false), shown(figure, high, false));
}

std::string reference_range(const Report& report, const ReportCourse::Point& point, std::size_t figure) {
  const MetricNorm* norm = norm_of(report, point, figure);
  if (norm == nullptr || !norm->low || !norm->high) return "";
  const TrialFigure& of = all_trial_figures()[figure];
  const Norms& norms = *report.norms;
  return fmt::format("{} to {} ({}{}; ages {:g} to {:g})", shown(of, *norm->low, false), shown(of, *norm->high),
                     norms.source, norms.population.empty() ? "" : ", " + norms.population, norms.age_from,
                     norms.age_to);
}

void add_course(xml_node parent, const Report& report, const ReportPerson& person, const ReportCourse& course,
                const char* heading) {
  const ReportExercise& last = exercise_of(report, course.points.back());
  const std::optional<std::size_t> primary = primary_figure(report, course);
  if (!primary && results_of(last).empty()) return;
  // The name of a recording without a title is that of its file, which says nothing about several of them.
  const std::string name = last.task || last.path.empty() ? last.name : last.path;
  add(parent, heading, fmt::format("Over sessions: {}{}", name, last.test.empty() ? "" : " (" + last.test + ")"));
  static const std::set<std::string> kUnguided{"free",  "recording", "reach", "range",
                                               "press", "track",     "weigh", "sense"};
  const bool guided = !kUnguided.contains(last.mode);
  set(add(parent, "p",
          last.mode == "sense"                           ? "In these repetitions the device moved the hand."
          : last.mode == "press" || last.mode == "weigh" ? "In these repetitions the device held the hand."
          : guided ? "These repetitions were guided. They show how the practice went, not what was learned: only tests "
                     "without forces show that, above all a day or more later."
                   : "These repetitions had no guidance."),
      "class", "about");
  add_results(parent, report, person, course);
  if (!primary) return;
  xml_node charts = parent.append_child("div");
  set(charts, "class", "charts");
  add_course_chart(charts, report, course, *primary);
  if (!charts.first_child()) parent.remove_child(charts);
  add_sessions(parent, report, person, course, *primary);
  add_exploratory(parent, report, course, *primary);
}

}  // namespace haptrace
