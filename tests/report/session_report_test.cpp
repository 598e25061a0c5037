// Reports of sessions and recordings as data.
#include "report/session_report.h"

#include "report/page.h"
#include "report/report_table.h"
#include "tests/report/support.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sstream>

namespace haptrace {
namespace {

using test::error_of;
using test::Hand;
using test::Reference;
using test::rows_of;
using test::SessionFolder;
using test::TempFolder;
using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

Report report_of(const std::string& input) {
  return gather_report(std::vector{input});
}

std::size_t index_of_figure(const char* name) {
  return static_cast<std::size_t>(&trial_figure(name) - all_trial_figures().data());
}

const ReportTrend& trend_of(const ReportExercise& exercise, const char* name) {
  for (const ReportTrend& trend : exercise.trends)
    if (trend.figure == index_of_figure(name)) return trend;
  throw std::runtime_error("no trend");
}

/// Returns the fields of each line of a table without quotes.
std::vector<std::vector<std::string>> fields_of(const std::string& table) {
  std::vector<std::vector<std::string>> lines;
  std::istringstream stream(table);
  for (std::string line; std::getline(stream, line);) {
    lines.emplace_back(1);
    for (const char c : line.substr(0, line.size() - 1))
      if (c == ',')
        lines.back().emplace_back();
      else
        lines.back().back() += c;
  }
  return lines;
}

TEST(SessionReport, HasEveryRepetitionWithTheMetricsOfTheLog) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  const Report report = report_of(lesson.path());
  ASSERT_EQ(report.sessions.size(), 1);
  const ReportSession& session = report.sessions[0];
  EXPECT_EQ(session.subject, "Ada L.");
  EXPECT_THAT(session.remarks, IsEmpty());
  std::size_t trials = 0;
  for (const ReportExercise& exercise : session.exercises) trials += exercise.trials.size();
  EXPECT_EQ(trials, lesson.log.trials.size());
  std::vector<std::size_t> next(session.exercises.size(), 0);
  for (const LoggedTrial& logged : lesson.log.trials) {
    const ReportTrial& trial = session.exercises[logged.exercise].trials[next[logged.exercise]++];
    EXPECT_EQ(trial.finished(), logged.finished());
    for (std::size_t i = 0; i < all_trial_figures().size(); ++i) {
      const nlohmann::json value = logged.finished() ? logged.figures[all_trial_figures()[i].name] : nlohmann::json();
      ASSERT_EQ(trial.figures[i].has_value(), value.is_number());
      if (!value.is_number()) continue;
      EXPECT_EQ(*trial.figures[i], value.get<double>());
    }
    EXPECT_FALSE(trial.way.empty());
    EXPECT_FALSE(trial.deviation.arc.empty());
  }
  const ReportExercise& tunnel = session.exercises[2];
  EXPECT_EQ(tunnel.figure, "contour_rms_m");
  EXPECT_EQ(session.exercises[1].figure, "deviation_rms_m") << "the path of a passive exercise has its own time";
  EXPECT_FALSE(tunnel.expert_force.empty());
  EXPECT_FALSE(tunnel.radius.arc.empty());
  EXPECT_EQ(tunnel.trials[0].radius, 5e-3);
  EXPECT_FALSE(session.exercises[0].trials[0].radius) << "free: there is no tunnel";
}

TEST(SessionReport, FitsTrendsToFinishedRepetitionsOnly) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  const Report report = report_of(lesson.path());
  const ReportExercise& tunnel = report.sessions[0].exercises[2];
  const ReportTrend& trend = trend_of(tunnel, "contour_rms_m");
  EXPECT_TRUE(std::isnan(trend.values[4])) << "that one was stopped, and keeps its number";
  ASSERT_TRUE(trend.curve && trend.line);
  EXPECT_LT(trend.line->slope + trend.line->slope_half_width, 0) << "it got better";
  EXPECT_GT(trend.curve->r_squared, 0.9);
  EXPECT_FALSE(trend_of(tunnel, "sparc").curve) << "more is better, and it has no least";
  EXPECT_FALSE(trend_of(report.sessions[0].exercises[0], "contour_rms_m").line) << "three are too few";
}

TEST(SessionReport, SaysWhyTheMedianOfAMetricIsUndefined) {
  const std::size_t rms = index_of_figure("contour_rms_m");
  const auto exercise = [&](const std::vector<std::string>& ends, std::optional<double> value) {
    ReportExercise one;
    for (const std::string& end : ends) {
      ReportTrial trial{.stopped_by = end};
      trial.figures.resize(all_trial_figures().size());
      trial.figures[rms] = value;
      one.trials.push_back(std::move(trial));
    }
    EXPECT_TRUE(std::isnan(summary_of(one, rms).median));
    return why_undefined(one, rms);
  };
  EXPECT_EQ(exercise({"time_over", "interrupted"}, 1e-3), "no repetition was finished");
  EXPECT_EQ(exercise({"finished", "finished"}, {}), "the metric is undefined in every finished repetition");
  EXPECT_EQ(exercise({"finished", "time_over", "time_over"}, 1e-3), "half of the repetitions or more ran out of time");
}

TEST(SessionReport, ComparesUnguidedTestsOfOneParticipantOnOnePathAlsoAcrossSessions) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson"), later(folder / "later"), other(folder / "other");
  write_lesson(lesson);
  later.log.created = "2026-03-11T09:00:00Z";
  const std::size_t retention = later.exercise("A week later", "free", {{"test", "retention"}});
  later.trial(retention, {.error = 3.5e-3});
  later.save();
  other.log.subject = "Somebody else";
  const std::size_t before = other.exercise("Hers", "free", {{"test", "before"}});
  other.trial(before, {.error = 9e-3});
  other.save();

  const std::vector<std::string> inputs{later.path(), lesson.path(), other.path() + "/session.json"};
  const Report report = gather_report(inputs);
  EXPECT_EQ(report.sessions.back().created, later.log.created) << "by date, in whatever order they are given";
  ASSERT_EQ(report.comparisons.size(), 1) << "a participant with one test has nothing to compare";
  const ReportComparison& comparison = report.comparisons[0];
  ASSERT_EQ(comparison.groups.size(), 3);
  EXPECT_EQ(comparison.subject, "Ada L.");
  const std::size_t rms = index_of_figure("contour_rms_m");
  EXPECT_EQ(comparison.groups[0].test, "before");
  EXPECT_EQ(comparison.groups[0].summaries[rms].finished, 3);
  EXPECT_EQ(comparison.groups[2].test, "retention");
  EXPECT_EQ(comparison.groups[2].session, 2);
  const auto median_of = [&](std::size_t group) { return comparison.groups[group].summaries[rms].median; };
  EXPECT_LT(median_of(1), median_of(2));
  EXPECT_LT(median_of(2), median_of(0));
  const std::size_t tunnel = index_of_figure("time_in_tunnel");
  EXPECT_TRUE(std::isnan(comparison.groups[0].summaries[tunnel].median));
}

TEST(SessionReport, NamesARecordingThatIsMissingOrDamagedAndKeepsItsMetrics) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  std::filesystem::remove(lesson.file(lesson.log.trials[5].file));
  std::filesystem::resize_file(lesson.file(lesson.log.trials[6].file), 100);
  std::filesystem::remove(lesson.file(lesson.log.paths[3]));
  const Report report = report_of(lesson.path());
  const ReportSession& session = report.sessions[0];
  EXPECT_THAT(session.remarks, Contains(HasSubstr(lesson.log.trials[5].file)));
  EXPECT_THAT(session.remarks, Contains(HasSubstr(lesson.log.trials[6].file)));
  EXPECT_THAT(session.remarks, Contains(HasSubstr("the path of Circle alone, after")));
  const ReportTrial& missing = session.exercises[2].trials[0];
  EXPECT_THAT(missing.missing, HasSubstr(lesson.log.trials[5].file));
  EXPECT_TRUE(missing.way.empty());
  EXPECT_EQ(missing.figures[0], lesson.log.trials[5].figures["contour_rms_m"].get<double>());
}

TEST(SessionReport, ListsStopsWarningsAndMarks) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  lesson.log.sittings.front().ended_by = "fatigue";
  lesson.save();
  const Report report = report_of(lesson.path());
  std::vector<std::string> stops, warnings;
  for (const ReportEvent& event : report.sessions[0].events)
    (event.kind == ReportEvent::Kind::stop ? stops : warnings).push_back(event.where + ": " + event.text);
  EXPECT_THAT(stops, Contains(AllOf(HasSubstr("Circle in the tunnel, repetition 5"), HasSubstr("0.104 m"))));
  EXPECT_THAT(stops, Contains(HasSubstr("fatigue")));
  EXPECT_THAT(warnings, Contains(AllOf(HasSubstr("repetition 3"), HasSubstr("warm"))));

  // The report of a recording lists a repeated event once per repetition, but every mark.
  const std::string file = folder / "one.h5";
  test::Recorded recorded;
  recorded.events = {{0, 1, "started"}, {1, 10, "overrun"}, {2, 10, "overrun"},
                     {2.5, 50, "a"},    {2.6, 50, "b"},     {3, 2, "finished"}};
  test::write(file, rows_of(lesson.expert, {}, Reference::playback), Reference::playback, recorded);
  const std::vector<ReportEvent> events = report_of(file).sessions[0].events;
  ASSERT_EQ(events.size(), 3);
  EXPECT_EQ(events[0].times, 2);
  EXPECT_EQ(events[0].time, 1);
  EXPECT_EQ(events[2].kind, ReportEvent::Kind::mark);
}

TEST(SessionReport, AcceptsRecordingsOfEveryKind) {
  const TempFolder folder;
  const Path path = test::expert_path();
  const std::vector<std::pair<Reference, std::string>> kinds{
      {Reference::none, "recording"}, {Reference::playback, "playback"}, {Reference::guidance, "tunnel"}};
  for (const auto& [reference, mode] : kinds) {
    const std::string file = folder / (mode + ".h5");
    test::write(file, rows_of(path, {}, reference), reference);
    const Report report = report_of(file);
    const ReportExercise& exercise = report.sessions[0].exercises[0];
    EXPECT_EQ(exercise.mode, mode);
    ASSERT_EQ(exercise.trials.size(), 1);
    EXPECT_TRUE(exercise.trials[0].finished());
    EXPECT_EQ(exercise.path_length > 0, reference != Reference::none);
    EXPECT_EQ(exercise.trials[0].figures[index_of_figure("completion")].has_value(), reference != Reference::none);
    EXPECT_EQ(exercise.expert_force.empty(), reference != Reference::guidance);
  }

  // A guidance without forces records the same columns as one with forces.
  for (const std::string mode : {"free", "tunnel"}) {
    test::Recorded recorded;
    recorded.header.config = {{"mode", mode}, {"stiffness", 700}};
    recorded.supported = mode == "tunnel";
    std::vector<Sample> rows = rows_of(path, {}, Reference::guidance);
    for (std::size_t i = 0; i < rows.size(); ++i)
      rows[i].support = std::min(1.5, 0.01 * static_cast<double>(i)) * Vec3::UnitZ();
    const std::string file = folder / (mode + "-guided.h5");
    test::write(file, rows, Reference::guidance, recorded);
    const Report report = report_of(file);
    const ReportExercise& exercise = report.sessions[0].exercises[0];
    EXPECT_EQ(exercise.mode, mode);
    EXPECT_EQ(exercise.trials[0].stiffness.has_value(), mode == "tunnel");
    EXPECT_EQ(exercise.trials[0].radius.has_value(), mode == "tunnel");
    EXPECT_EQ(exercise.trials[0].support, mode == "tunnel" ? std::optional(1.5) : std::nullopt);
  }
}

TEST(SessionReport, TakesNoSteeredHandForAMeasureOfSkill) {
  const TempFolder folder;
  test::Recorded steered;
  steered.header.meta["input"] = "view";
  test::write(folder / "steered.h5", rows_of(test::expert_path(), {}, Reference::guidance), Reference::guidance,
              steered);
  const ReportSession recording = report_of(folder / "steered.h5").sessions[0];
  EXPECT_TRUE(recording.steered);
  EXPECT_THAT(recording.remarks, Contains(HasSubstr("do not measure skill")));
  EXPECT_THAT(recording.exercises[0].trends, IsEmpty());

  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  EXPECT_FALSE(report_of(lesson.path()).comparisons.empty());
  for (LoggedTrial& trial : lesson.log.trials) trial.input = "view";
  save_session_log(lesson.log, lesson.path());
  const Report report = report_of(lesson.path());
  EXPECT_TRUE(report.sessions[0].steered);
  EXPECT_THAT(report.comparisons, IsEmpty());
  for (const ReportExercise& exercise : report.sessions[0].exercises) EXPECT_THAT(exercise.trends, IsEmpty());
}

TEST(SessionReport, AcceptsARecordingThatIsEmptyOrWasCutOff) {
  const TempFolder folder;
  const Path path = test::expert_path();
  test::write(folder / "empty.h5", {}, Reference::none);
  const Report empty = report_of(folder / "empty.h5");
  EXPECT_TRUE(empty.sessions[0].exercises[0].trials.empty());
  EXPECT_THAT(empty.sessions[0].remarks, Contains(HasSubstr("no samples")));

  const test::Recorded killed{.header = {}, .events = {{0, 1, "started"}}, .finish = false};
  test::write(folder / "killed.h5", rows_of(path, {.until = 0.6}, Reference::guidance), Reference::guidance, killed);
  const Report cut = report_of(folder / "killed.h5");
  const ReportSession& session = cut.sessions[0];
  EXPECT_FALSE(session.complete);
  EXPECT_THAT(session.remarks, Contains(HasSubstr("is incomplete")));
  const ReportTrial& trial = session.exercises[0].trials.at(0);
  EXPECT_FALSE(trial.finished());
  EXPECT_FALSE(trial.figures[index_of_figure("completion")]) << "the end of the path is unknown";
  EXPECT_TRUE(session.exercises[0].trends.empty());
}

TEST(SessionReport, SaysWhichRepetitionRanOutOfTimeAndWhichWasStopped) {
  const TempFolder folder;
  const Path path = test::expert_path();
  std::vector<Sample> rows = rows_of(path, {}, Reference::guidance);
  const double second = 1e-9 * static_cast<double>(rows.back().time_ns) + 0.004;
  for (const Sample& row :
       rows_of(path, {.until = 0.3}, Reference::guidance, rows.back().time_ns + 4'000'000, rows.back().tick + 1))
    rows.push_back(row);
  test::Recorded recorded;
  recorded.events = {{0, 1, "started"}, {second + 2, 63, "the time limit was reached"}, {second + 3, 2, "finished"}};
  test::write(folder / "time.h5", rows, Reference::guidance, recorded);
  const Report report = report_of(folder / "time.h5");
  const std::vector<ReportTrial>& trials = report.sessions[0].exercises[0].trials;
  ASSERT_EQ(trials.size(), 2);
  EXPECT_TRUE(trials[0].finished());
  EXPECT_EQ(trials[1].stopped_by, "time_over");
  EXPECT_NEAR(trials[1].figures[index_of_figure("completion")].value(), 0.16, 0.05) << "the first came to the end";

  recorded.events = {{0, 1, "started"}, {second + 1, 23, "0.11 m from the path"}};
  test::write(folder / "stopped.h5", rows, Reference::guidance, recorded);
  const Report other = report_of(folder / "stopped.h5");
  EXPECT_TRUE(other.sessions[0].exercises[0].trials[0].finished());
  EXPECT_EQ(other.sessions[0].exercises[0].trials[1].stopped_by, "limit");
  EXPECT_EQ(other.sessions[0].exercises[0].trials[1].detail, "0.11 m from the path");
}

TEST(SessionReport, CountsARepetitionThatRanOutOfTimeOnlyInItsOwnRow) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t before = lesson.exercise("before", "free", {{"test", "before"}}),
                    tunnel = lesson.exercise("practice", "tunnel"),
                    after = lesson.exercise("after", "free", {{"test", "after"}});
  for (const std::size_t exercise : {before, tunnel, after}) {
    for (int i = 0; i < 4; ++i) lesson.trial(exercise, {}).figures = {{"definitions", 2}, {"contour_rms_m", 2e-3}};
    lesson.trial(exercise, {.until = 0.5}, "time_over").figures = {{"definitions", 2}, {"contour_rms_m", 0.5}};
  }
  // The recording of this repetition reports the end of its time too, and its log has no metrics.
  const LoggedTrial& late = lesson.trial(tunnel, {.until = 0.5}, "time_over");
  const test::Recorded recorded{.header = {}, .events = {{0, 1, "started"}, {1, 63, "over"}, {2, 2, "finished"}}};
  std::filesystem::remove(lesson.file(late.file));
  test::write(lesson.file(late.file), rows_of(lesson.expert, {.until = 0.5}, Reference::guidance), Reference::guidance,
              recorded);
  lesson.save();

  const Report report = report_of(lesson.path());
  const ReportExercise& exercise = report.sessions[0].exercises[tunnel];
  const std::size_t rms = index_of_figure("contour_rms_m");
  EXPECT_FALSE(exercise.trials[4].finished());
  EXPECT_TRUE(exercise.trials[4].out_of_time());
  EXPECT_EQ(exercise.trials[4].end_in_words(), "ran out of time");
  EXPECT_EQ(exercise.trials[4].figures[rms], 0.5);
  EXPECT_NEAR(exercise.trials[5].figures[index_of_figure("completion")].value(), 0.5, 0.05);
  const ReportTrend& trend = trend_of(exercise, "contour_rms_m");
  EXPECT_TRUE(std::isnan(trend.values[4]) && std::isnan(trend.values[5]));
  EXPECT_NEAR(trend.line.value().slope, 0, 1e-9);
  ASSERT_EQ(report.comparisons.size(), 1);
  for (const ReportComparison::Group& group : report.comparisons[0].groups)
    EXPECT_EQ(group.summaries[rms].median, 2e-3) << group.test;
  for (const ReportComparison::Group& group : report.comparisons[0].groups) {
    EXPECT_EQ(group.summaries[rms].finished, 4);
    EXPECT_EQ(group.summaries[rms].partial, 1);
    EXPECT_EQ(group.summaries[rms].worse_quartile, 2e-3) << "at place 3 of 0 to 4, which is the last finished one";
  }
  std::vector<std::string> stops;
  for (const ReportEvent& event : report.sessions[0].events) stops.push_back(event.where + ": " + event.text);
  EXPECT_THAT(stops, testing::UnorderedElementsAre(
                         "before, repetition 5: ran out of time", "practice, repetition 5: ran out of time",
                         "practice, repetition 6: over", "after, repetition 5: ran out of time"))
      << "every end is listed once";
}

TEST(SessionReport, RanksPartialRepetitionsBelowEveryFinishedOne) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t before = lesson.exercise("before", "free", {{"test", "before"}}),
                    after = lesson.exercise("after", "free", {{"test", "after"}}),
                    later = lesson.exercise("later", "free", {{"test", "retention"}});
  const auto trials = [&](std::size_t exercise, std::initializer_list<double> finished, int partial) {
    for (const double rms : finished)
      lesson.trial(exercise, {}).figures = {{"definitions", 2}, {"contour_rms_m", rms}, {"sparc", -2}};
    // As far as it went, the partial repetition was perfect.
    for (int i = 0; i < partial; ++i)
      lesson.trial(exercise, {.until = 0.5}, "time_over").figures = {
          {"definitions", 2}, {"contour_rms_m", 1e-5}, {"sparc", -1.4}, {"completion", 0.4}};
  };
  trials(before, {2e-3, 3e-3, 4e-3}, 0);
  trials(after, {2e-3, 3e-3, 4e-3}, 2);
  trials(later, {1e-3}, 3);
  lesson.save();
  const Report report = report_of(lesson.path());
  ASSERT_EQ(report.comparisons.size(), 1);
  const std::vector<ReportComparison::Group>& groups = report.comparisons[0].groups;
  const std::size_t rms = index_of_figure("contour_rms_m"), sparc = index_of_figure("sparc");
  EXPECT_NEAR(groups[0].summaries[rms].median, 3e-3, 1e-12);
  EXPECT_NEAR(groups[1].summaries[rms].median, 4e-3, 1e-12) << "the third of five, of which the last two are partial";
  EXPECT_NEAR(groups[1].summaries[sparc].median, -2, 1e-12) << "more is better";
  EXPECT_TRUE(std::isnan(groups[2].summaries[rms].median)) << "the second and third of four";
  EXPECT_EQ(groups[2].summaries[rms].partial, 3);
  const nlohmann::json json = to_json(report);
  EXPECT_EQ(json["comparisons"][0]["tests"][2]["metrics"]["contour_rms_m"]["partial"], 3);
  EXPECT_EQ(json["sessions"][0]["exercises"][1]["trials"][3]["partial"], true);
  const std::string page = report_page(report);
  EXPECT_THAT(page, testing::HasSubstr("3 of 5 done, 2 partial"));
}

TEST(SessionReport, ShowsTheStiffnessOfEveryRepetitionAsItWasLogged) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t assisted = lesson.exercise("helped", "assisted"), free = lesson.exercise("alone", "free");
  lesson.trial(assisted, {}).settings = {.stiffness = 650, .assistance = 1};
  lesson.trial(assisted, {}).settings = {.stiffness = 325, .assistance = 0.5};
  lesson.trial(assisted, {}).settings = {.stiffness = std::nullopt, .assistance = 0};
  lesson.trial(free, {}).settings = {.stiffness = std::nullopt};
  lesson.save();
  const Report report = report_of(lesson.path());
  const std::vector<ReportTrial>& trials = report.sessions[0].exercises[assisted].trials;
  EXPECT_EQ(trials[0].stiffness, 650);
  EXPECT_EQ(trials[1].stiffness, 325) << "not times its assistance once more";
  EXPECT_FALSE(trials[2].stiffness) << "there were no walls";
  EXPECT_FALSE(report.sessions[0].exercises[free].trials[0].stiffness);
}

TEST(SessionReport, CountsAnInputOnceUnderAnyName) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  const std::string file = folder / "one.h5", link = folder / "link.h5";
  test::write(file, rows_of(lesson.expert, {}, Reference::playback), Reference::playback);
  std::filesystem::create_symlink(file, link);
  const std::vector<std::string> inputs{
      lesson.path(),       lesson.path(), lesson.path() + "/session.json", lesson.path() + "/", file,
      folder / "./one.h5", link};
  const Report report = gather_report(inputs);
  EXPECT_EQ(report.sessions.size(), 2);
  EXPECT_EQ(report.comparisons.at(0).groups.at(0).summaries[index_of_figure("contour_rms_m")].finished, 3);
}

/// Writes a session with one test on the path of a file.
void write_test_about(SessionFolder& session, const std::string& test, const std::string& path) {
  const std::size_t i = session.exercise("alone", "free", {{"test", test}});
  nlohmann::json& exercise = session.log.programme["exercises"][i];
  exercise.erase("shape");
  exercise["path"] = path;
  session.trial(i, {});
  session.save();
}

TEST(SessionReport, ComparesTestsOfTheSameCurveWhateverItsFileIsCalled) {
  const TempFolder folder;
  SessionFolder first(folder / "first"), same(folder / "same"), larger(folder / "larger"), slower(folder / "slower");
  for (Vec3& p : larger.expert.position) p *= 1 + 1e-6;
  for (double& t : slower.expert.time) t *= 1.01;
  write_test_about(first, "before", "st.csv");
  write_test_about(same, "after", "lesson two/st again.csv");
  write_test_about(larger, "after", "st.csv");
  write_test_about(slower, "after", "st.csv");
  const auto comparisons = [&](const SessionFolder& other) {
    return gather_report(std::vector{first.path(), other.path()}).comparisons.size();
  };
  EXPECT_EQ(comparisons(same), 1);
  EXPECT_EQ(comparisons(larger), 0) << "another curve of that name";
  EXPECT_EQ(comparisons(slower), 0);

  std::filesystem::remove(same.file(same.log.paths[0]));
  const Report unknown = gather_report(std::vector{first.path(), same.path()});
  EXPECT_THAT(unknown.comparisons, IsEmpty()) << "the curve is unknown";
  EXPECT_THAT(unknown.sessions[1].remarks, Contains(HasSubstr("and its tests cannot be compared")));
}

TEST(SessionReport, ComparesParticipantsWithoutANameWithinOneSessionOnly) {
  const TempFolder folder;
  SessionFolder first(folder / "first"), second(folder / "second");
  first.log.subject = second.log.subject = "";
  second.log.created = "2026-03-11T09:00:00Z";
  write_test_about(first, "before", "st.csv");
  write_test_about(second, "after", "st.csv");
  const std::vector<std::string> inputs{first.path(), second.path()};
  EXPECT_THAT(gather_report(inputs).comparisons, IsEmpty());

  write_test_about(second, "before", "st.csv");
  const Report report = gather_report(inputs);
  ASSERT_EQ(report.comparisons.size(), 1);
  EXPECT_EQ(report.comparisons[0].session, 1);
  EXPECT_EQ(report.comparisons[0].groups[0].summaries[index_of_figure("contour_rms_m")].finished, 1);
  EXPECT_EQ(to_json(report)["comparisons"][0]["session"], second.path());
}

TEST(SessionReport, DoesNotOverwriteItsInputs) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson"), other(folder / "other");
  const std::string recording = lesson.trial(lesson.exercise("one", "tunnel"), {}).file;
  lesson.save();
  other.save();
  const std::string alone = folder.write("alone.h5", ""), part = folder.write("alone.part002.h5", "");
  const std::string link = folder / "link.html", page = folder / "page.html";
  std::filesystem::create_symlink(alone, link);
  const std::vector<std::string> inputs{lesson.path(), alone};
  for (const std::string& output :
       {lesson.file("session.json"), lesson.file("profile.json"), lesson.file(lesson.log.paths[0]),
        lesson.file(recording), folder / "lesson/../alone.h5", part, link, other.file("session.json")})
    EXPECT_THAT(error_of([&] {
                  check_report_outputs(std::vector{page, output}, inputs);
                }),
                AllOf(HasSubstr(output), HasSubstr("belongs to the recorded data")));
  EXPECT_THAT(error_of([&] {
                check_report_outputs(std::vector{page, folder / "./page.html"}, inputs);
              }),
              HasSubstr("both the page and the table"));
  EXPECT_NO_THROW(check_report_outputs(std::vector{lesson.file("report.html"), lesson.file("table.csv")}, inputs));
}

TEST(SessionReport, IsTheSameInJsonAndInATable) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  const Report report = report_of(lesson.path());
  const nlohmann::json json = to_json(report);
  const auto lines = fields_of(report_table(report));
  ASSERT_EQ(lines.size(), 1 + lesson.log.trials.size());
  const auto column = [&](std::string_view name) {
    return static_cast<std::size_t>(std::find(lines[0].begin(), lines[0].end(), name) - lines[0].begin());
  };
  std::size_t line = 0;
  for (const nlohmann::json& exercise : json["sessions"][0]["exercises"])
    for (const nlohmann::json& trial : exercise["trials"]) {
      // Names in this lesson contain commas, which shift the fields: they are counted from the end.
      const std::vector<std::string>& fields = lines[++line];
      const auto field = [&](std::string_view name) { return fields[fields.size() - lines[0].size() + column(name)]; };
      for (const TrialFigure& figure : all_trial_figures()) {
        const nlohmann::json& value = trial["figures"][figure.name];
        if (value.is_null()) {
          EXPECT_EQ(field(figure.name), "");
        } else {
          EXPECT_EQ(std::stod(field(figure.name)), value.get<double>()) << figure.name;
        }
      }
      EXPECT_EQ(field("stopped_by"), trial["stopped_by"]);
    }
  EXPECT_NO_THROW((void)json.dump());
  EXPECT_TRUE(json["comparisons"][0]["tests"][0]["metrics"]["contour_rms_m"]["median"].is_number());
  EXPECT_TRUE(json["comparisons"][0]["tests"][0]["metrics"]["time_in_tunnel"]["median"].is_null());
}

TEST(SessionReport, QuotesTextsInTheTable) {
  Report report;
  report.sessions.push_back({.source = "a,b", .subject = "say \"hi\"\nthere"});
  report.sessions[0].exercises.push_back({.name = "plain"});
  report.sessions[0].exercises[0].trials.push_back(
      {.figures = std::vector<std::optional<double>>(all_trial_figures().size())});
  EXPECT_THAT(report_table(report), HasSubstr("\r\n\"a,b\",\"say \"\"hi\"\"\nthere\",,plain,"));
}

TEST(SessionReport, RejectsInputsThatAreNeitherASessionNorARecording) {
  const TempFolder folder;
  EXPECT_THAT(error_of([&] { report_of(folder / "none.h5"); }), HasSubstr("none.h5"));
  EXPECT_THAT(error_of([&] { report_of(folder.path()); }), HasSubstr("contains no session.json"));
  const std::string text = folder.write("text.csv", "t,x\n");
  EXPECT_THAT(error_of([&] { report_of(text); }), HasSubstr("text.csv"));
  const std::string broken = folder.write("session.json", "{\"haptrace_session\": 1}");
  EXPECT_THAT(error_of([&] { report_of(broken); }), HasSubstr("session.json"));
}

}  // namespace
}  // namespace haptrace
