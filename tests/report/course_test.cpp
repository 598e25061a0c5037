// Summaries of sessions, and the changes between them.
#include "report/course.h"

#include "report/local_time.h"
#include "report/page.h"
#include "tests/report/support.h"
#include "tests/support/errors.h"

#include <cstdlib>
#include <ctime>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <pugixml.hpp>

namespace haptrace {
namespace {

using test::error_of;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using Verdict = ReportChange::Verdict;

constexpr std::size_t kContour = 0;  // index of contour_rms_m

/// A repetition with a contour error [m], or one that ran out of time after a share of the path.
ReportTrial trial_of(double contour, const std::string& stopped_by = "finished", double share = 1) {
  ReportTrial trial{.stopped_by = stopped_by,
                    .figures = std::vector<std::optional<double>>(all_trial_figures().size())};
  trial.figures[kContour] = contour;
  trial.figures[static_cast<std::size_t>(&trial_figure("completion") - all_trial_figures().data())] = share;
  return trial;
}

/// A session of one exercise without guidance on one path.
ReportSession session_of(const std::string& date, const std::vector<double>& contours, std::size_t partial = 0) {
  ReportExercise exercise{.name = "Circle", .mode = "free", .path = "circle", .task = 0, .figure = "contour_rms_m"};
  for (const double contour : contours) exercise.trials.push_back(trial_of(contour));
  for (std::size_t i = 0; i < partial; ++i) exercise.trials.push_back(trial_of(1e-4, "time_over", 0.4));
  return {.title = "Lesson",
          .subject = "Ada L.",
          .created = date + "T09:30:00Z",
          .device = "Novint Falcon (7)",
          .exercises = {exercise}};
}

Report report_of(std::vector<ReportSession> sessions) {
  Report report{.sessions = std::move(sessions)};
  report.persons = persons_of(report.sessions);
  return report;
}

Norms norms_of(MetricNorm norm) {
  return {.file = "norms.json",
          .source = "A. Author 2024",
          .age_from = 20,
          .age_to = 60,
          .device = "falcon",
          .task = "circle",
          .mode = "free",
          .metrics = {{"contour_rms_m", std::move(norm)}}};
}

ReportChange change_of(const Report& report) {
  const ReportCourse& course = report.persons.at(0).courses.at(0);
  return change_between(report, course.points.front(), course.points.back(), kContour);
}

TEST(ReportSummary, RanksRepetitionsThatRanOutOfTimeBelowFinishedOnes) {
  const auto summary = [](const std::vector<double>& contours, std::size_t partial) {
    return summary_of(session_of("2026-03-04", contours, partial).exercises[0], kContour);
  };
  EXPECT_EQ(summary({1e-3, 3e-3, 2e-3}, 0).median, 2e-3);
  EXPECT_EQ(summary({1e-3, 2e-3}, 0).median, 1.5e-3);
  EXPECT_EQ(summary({1e-3, 3e-3, 2e-3}, 2).median, 3e-3)
      << "the partial ones have 0.1 mm and are the worst nevertheless";
  EXPECT_TRUE(std::isnan(summary({1e-3, 3e-3}, 2).median)) << "between a finished and a partial one";
  EXPECT_TRUE(std::isnan(summary({1e-3}, 3).median));
  EXPECT_EQ(summary({1e-3, 2e-3, 3e-3, 4e-3, 5e-3}, 0).better_quartile, 2e-3);
  EXPECT_EQ(summary({1e-3, 2e-3, 3e-3, 4e-3, 5e-3}, 0).worse_quartile, 4e-3);
  EXPECT_TRUE(std::isnan(summary({1e-3, 2e-3, 3e-3}, 2).worse_quartile));
  EXPECT_EQ(summary({1e-3, 2e-3, 3e-3}, 2).partial, 2U);
  EXPECT_TRUE(std::isnan(summary({}, 0).median));
}

TEST(ReportSummary, RanksTheBestOfAMetricFirstOfWhichMoreIsBetter) {
  const std::size_t sparc = static_cast<std::size_t>(&trial_figure("sparc") - all_trial_figures().data());
  ReportExercise exercise = session_of("2026-03-04", {1e-3, 1e-3, 1e-3}, 1).exercises[0];
  for (std::size_t i = 0; i < 3; ++i) exercise.trials[i].figures[sparc] = -1.5 - 0.1 * static_cast<double>(i);
  EXPECT_NEAR(summary_of(exercise, sparc).better_quartile, -1.575, 1e-9);
  EXPECT_NEAR(summary_of(exercise, sparc).median, -1.65, 1e-9) << "of -1.5, -1.6, -1.7 and a partial one";
}

TEST(ReportChange, IsNotClaimedFromTheSpreadOfRepetitions) {
  const Report report =
      report_of({session_of("2026-03-04", {9e-3, 9.1e-3, 9.2e-3}), session_of("2026-03-11", {1e-3, 1e-3})});
  const ReportChange change = change_of(report);
  EXPECT_EQ(change.verdict, Verdict::unknown) << "far beyond the spread of the repetitions, which says nothing";
  EXPECT_NEAR(change.change, -8.1e-3, 1e-12);
  EXPECT_EQ(change.words, "repetition spread; day-to-day error unknown");
}

TEST(ReportChange, IsClaimedOnlyBeyondTheMinimalDetectableChange) {
  Report report = report_of({session_of("2026-03-04", {5e-3}), session_of("2026-03-11", {4e-3})});
  set_norms(report, norms_of({.mdc95 = 1.2e-3}));
  EXPECT_EQ(change_of(report).verdict, Verdict::none);
  EXPECT_THAT(change_of(report).words, HasSubstr("no change that this test can show"));
  set_norms(report, norms_of({.mdc95 = 0.8e-3}));
  EXPECT_EQ(change_of(report).verdict, Verdict::beyond);
  EXPECT_THAT(change_of(report).words, HasSubstr("better by more than the measurement error"));
  std::swap(report.sessions[0].exercises, report.sessions[1].exercises);
  EXPECT_THAT(change_of(report).words, HasSubstr("worse by more"));
}

TEST(ReportChange, FollowsEveryWayToStateTheError) {
  EXPECT_NEAR(*mdc95_of({.sem = 1e-3}), 2.7718e-3, 1e-6);
  EXPECT_NEAR(*mdc95_of({.sd = 2e-3, .icc = 0.75}), 2.7718e-3, 1e-6) << "SEM = SD sqrt(1 - ICC)";
  EXPECT_NEAR(*mdc95_of({.retest = {{1, 2}, {3, 4}, {7, 8}}}), 2.7718 * std::sqrt(0.5), 1e-3);
  EXPECT_FALSE(mdc95_of({.low = 1, .high = 2})) << "a reference range is not an error";
}

TEST(ReportChange, IsNotJudgedWhenDeviceSideOrAssistanceChanged) {
  const auto changed = [](const std::function<void(ReportSession&)>& change) {
    Report report = report_of({session_of("2026-03-04", {5e-3}), session_of("2026-03-11", {1e-3})});
    change(report.sessions[1]);
    set_norms(report, norms_of({.mdc95 = 1e-4}));
    return change_of(report);
  };
  EXPECT_THAT(changed([](ReportSession& s) { s.device = "Falcon (8)"; }).words, HasSubstr("the device changed"));
  EXPECT_THAT(changed([](ReportSession& s) { s.meta["side"] = "left"; }).words, HasSubstr("the side changed"));
  const ReportChange softer = changed([](ReportSession& s) { s.exercises[0].trials[0].stiffness = 300; });
  EXPECT_EQ(softer.verdict, Verdict::incomparable);
  EXPECT_THAT(softer.words, HasSubstr("the assistance changed"));
  EXPECT_EQ(changed([](ReportSession&) {}).verdict, Verdict::beyond);
}

TEST(ReportChange, DoesNotUseNormsOfAnotherDeviceTaskOrMode) {
  for (const auto& alter : std::vector<std::function<void(Norms&)>>{[](Norms& n) { n.device = "omega"; },
                                                                    [](Norms& n) { n.task = "square"; },
                                                                    [](Norms& n) { n.mode = "tunnel"; }}) {
    Report report = report_of({session_of("2026-03-04", {5e-3}), session_of("2026-03-11", {1e-3})});
    Norms norms = norms_of({.mdc95 = 1e-4});
    alter(norms);
    set_norms(report, norms);
    EXPECT_EQ(change_of(report).verdict, Verdict::unknown);
    EXPECT_THAT(change_of(report).words, HasSubstr("the norms are for"));
    EXPECT_THAT(report.sessions[0].remarks, testing::Contains(HasSubstr("hold for no exercise")));
    EXPECT_EQ(to_json(report)["norms"]["hold"], false);
  }
  Report report;
  Norms norms = norms_of({});
  norms.metrics["contour_rms"] = {};
  EXPECT_THAT(error_of([&] { set_norms(report, norms); }), AllOf(HasSubstr("norms.json"), HasSubstr("contour_rms_m")));
}

TEST(ReportCourse, HasOneValuePerSessionAndALineFromFiveSessionsOn) {
  std::vector<ReportSession> sessions;
  for (int i = 0; i < 4; ++i)
    sessions.push_back(session_of(fmt::format("2026-03-{:02}", 2 + 7 * i), {5e-3 - 1e-4 * i, 9e-3, 1e-3}));
  Report report = report_of(sessions);
  ASSERT_EQ(report.persons.size(), 1U);
  ASSERT_EQ(report.persons[0].courses.size(), 1U);
  EXPECT_EQ(report.persons[0].courses[0].points.size(), 4U);
  EXPECT_EQ(report.persons[0].courses[0].points[3].day, 21);
  EXPECT_FALSE(line_of(report, report.persons[0].courses[0], kContour)) << "12 repetitions are still four sessions";
  EXPECT_THAT(report_page(report), HasSubstr("no line below 5 comparable sessions"));

  sessions.push_back(session_of("2026-03-30", {4.6e-3, 9e-3, 1e-3}));
  report = report_of(sessions);
  const CourseLine line = line_of(report, report.persons[0].courses[0], kContour).value();
  EXPECT_EQ(line.sessions, 5U);
  EXPECT_NEAR(line.first, 5e-3, 1e-9);
  EXPECT_NEAR(line.last, 4.6e-3, 1e-9);
  EXPECT_NEAR(line.half_width, 0, 1e-9);
  sessions[2].device = "another one";
  report = report_of(sessions);
  EXPECT_FALSE(line_of(report, report.persons[0].courses[0], kContour));
}

// Facts of least squares: the half width of the fitted change over n even sessions, in residual standard deviations.
TEST(ReportCourse, HasTheIntervalOfTheFittedChange) {
  const std::vector<double> noise{0.3, -0.5, 0.4, -0.6, 0.5};
  std::vector<ReportSession> sessions;
  for (std::size_t i = 0; i < noise.size(); ++i)
    sessions.push_back(session_of(fmt::format("2026-03-{:02}", 2 + i), {1e-3 * (5 + noise[i])}));
  const Report report = report_of(sessions);
  const CourseLine line = line_of(report, report.persons[0].courses[0], kContour).value();
  double residuals = 0;
  for (std::size_t i = 0; i < noise.size(); ++i)
    residuals +=
        std::pow(1e-3 * (5 + noise[i]) - line.first - (line.last - line.first) * static_cast<double>(i) / 4, 2);
  EXPECT_NEAR(line.half_width / std::sqrt(residuals / 3), 4.0, 0.05);
}

/// Returns the cells of the results over sessions, by the name of the result.
std::map<std::string, std::vector<std::string>> results_over_sessions(const Report& report) {
  pugi::xml_document document;
  const std::string page = report_page(report);
  EXPECT_TRUE(document.load_string(page.c_str(), pugi::parse_full));
  std::map<std::string, std::vector<std::string>> cells;
  for (const pugi::xpath_node& row :
       document.select_nodes("//table[caption[contains(., 'results, one for each session')]]/tbody/tr")) {
    std::vector<std::string>& values = cells[row.node().child("th").text().get()];
    for (const pugi::xml_node& cell : row.node().children("td")) values.emplace_back(cell.text().get());
  }
  return cells;
}

TEST(ReportCourse, ShowsTheBestOfEveryDirectionForEverySession) {
  std::vector<ReportSession> sessions;
  for (int i = 0; i < 3; ++i) {
    sessions.push_back(session_of(fmt::format("2026-03-{:02}", 2 + i), {1e-3}));
    ReportExercise& exercise = sessions.back().exercises[0];
    exercise.mode = "range";
    exercise.figure = "";
    exercise.assessment = AssessmentSummary{
        .goal = ReachGoal::range,
        .trials = 2,
        .directions = {{.angle = 0, .tries = 1, .best = 0.05 + 0.01 * i}, {.angle = 90, .tries = 1, .best = {}}},
        .area = {},
        .rms = {},
        .gain = {},
        .delay = {}};
  }
  sessions[1].exercises[0].assessment->directions[0].at_limit = true;
  sessions[2].exercises[0].reach = "held for longer";
  const auto cells = results_over_sessions(report_of(sessions));
  ASSERT_EQ(cells.size(), 2U);
  EXPECT_EQ(cells.begin()->second, (std::vector<std::string>{"50.0 mm", "\u2265 60.0 mm", "70.0 mm"}));
  EXPECT_EQ(std::next(cells.begin())->second, (std::vector<std::string>{"\u2013", "\u2013", "\u2013"}));
  EXPECT_THAT(report_page(report_of(sessions)), HasSubstr("not comparable with the first: "));
  const nlohmann::json points = to_json(report_of(sessions))["persons"][0]["over_sessions"][0]["sessions"];
  EXPECT_TRUE(points[1]["not_comparable_with_first"].is_null());
  EXPECT_EQ(points[2]["not_comparable_with_first"], "the settings of the exercise changed");
  EXPECT_TRUE(points[1]["metrics"].is_null()) << "lower bounds of different directions have no median";
  EXPECT_DOUBLE_EQ(points[1]["assessment"]["directions"][0]["best_m"].get<double>(), 0.06);
}

TEST(ReportCourse, DoesNotComparePressesUnderAnotherForceLimit) {
  std::vector<ReportSession> sessions{session_of("2026-03-02", {1e-3}), session_of("2026-03-03", {1e-3})};
  for (ReportSession& session : sessions) session.exercises[0].mode = "press";
  sessions[1].force_limit = 2;
  const Report report = report_of(sessions);
  const ReportCourse& course = report.persons[0].courses[0];
  EXPECT_EQ(obstacle(report, course.points[0], course.points[1]), "the force limit changed");
}

TEST(ReportTrial, SaysHowAPairOfPlacesEnded) {
  const auto words = [](const std::string& stopped_by, int answer) {
    ReportTrial trial = trial_of(1e-3, stopped_by);
    trial.answer = answer;
    return trial.end_in_words();
  };
  EXPECT_EQ(words("finished", 2), "finished");
  EXPECT_EQ(words("time_over", 0), "no answer");
  EXPECT_EQ(words("device_lost", 0), "device lost");
  EXPECT_EQ(words("", 0), "unknown");
}

TEST(ReportCourse, ShowsTheThresholdOfEverySessionWithItsInterval) {
  std::vector<ReportSession> sessions;
  for (int i = 0; i < 2; ++i) {
    sessions.push_back(session_of(fmt::format("2026-03-{:02}", 2 + i), {1e-3}));
    ReportExercise& exercise = sessions.back().exercises[0];
    exercise.mode = "sense";
    exercise.figure = "";
    exercise.sense = SenseSummary{.answers = 120, .right = 90, .fit = {}};
  }
  sessions[1].exercises[0].sense->fit =
      SenseFit{.threshold = 0.0041, .low = 0.0032, .high = 0.0055, .bias = -0.0003, .slope = 60};
  const auto cells = results_over_sessions(report_of(sessions));
  EXPECT_EQ(cells.at("threshold"), (std::vector<std::string>{"\u2013", "4.1 mm (95 % interval 3.2 to 5.5 mm)"}));
  EXPECT_EQ(cells.at("bias"), (std::vector<std::string>{"\u2013", "\u22120.3 mm"}));
  EXPECT_EQ(cells.at("answers"), (std::vector<std::string>{"120", "120"}));
}

TEST(ReportCourse, KeepsPersonsApartAndNamesThemInEveryRow) {
  ReportSession other = session_of("2026-03-05", {2e-3, 3e-3});
  other.subject = "Bo <b>";
  ReportSession unnamed = session_of("2026-03-06", {2e-3});
  unnamed.subject = "";
  const Report report =
      report_of({session_of("2026-03-04", {1e-3}), other, unnamed, unnamed, session_of("2026-03-11", {1e-3})});
  ASSERT_EQ(report.persons.size(), 4U);
  EXPECT_EQ(report.persons[0].sessions, (std::vector<std::size_t>{0, 4}));
  EXPECT_EQ(report.persons[0].courses.size(), 1U);
  EXPECT_TRUE(report.persons[2].courses.empty()) << "two sessions without a name may be of two persons";
  const std::string page = report_page(report);
  pugi::xml_document document;
  ASSERT_TRUE(document.load_string(page.c_str(), pugi::parse_full));
  EXPECT_EQ(document.select_nodes("//section[contains(@class, 'person ')]").size(), 4U);
  EXPECT_EQ(document.select_nodes("//div[@class='signature']").size(), 4U);
  for (const pugi::xpath_node& row : document.select_nodes("//section[@id]//tbody/tr"))
    EXPECT_FALSE(row.node().select_nodes("td[@data-label='participant']").empty());
  EXPECT_EQ(document.select_nodes("//h2[text()='Comparison']/following-sibling::div[1]//tbody/tr").size(), 5U);
  EXPECT_THAT(page, HasSubstr("@page person-2"));
  EXPECT_THAT(page, Not(HasSubstr("Bo <b>")));
}

TEST(ReportPage, ClaimsNoMoreThanItsDataShow) {
  std::vector<ReportSession> sessions;
  for (int i = 0; i < 6; ++i) {
    sessions.push_back(session_of(fmt::format("2026-03-{:02}", 2 + i), {5e-3 - 4e-4 * i, 5e-3 - 4e-4 * i}));
    sessions.back().exercises[0].mode = "tunnel";
    for (ReportTrial& trial : sessions.back().exercises[0].trials) trial.radius = 5e-3;
  }
  const std::string page = report_page(report_of(sessions));
  EXPECT_THAT(page, HasSubstr("They show how the practice went, not what was learned"));
  EXPECT_THAT(page, HasSubstr("day-to-day error unknown"));
  for (const char* claim : {"significant", "which is better", "normal range", "recovered"})
    EXPECT_THAT(page, Not(HasSubstr(claim)));
}

TEST(ReportPage, HasWhatAClinicianSigns) {
  ReportSession session = session_of("2026-03-04", {2e-3, 3e-3, 4e-3}, 1);
  session.meta = {{"side", "left"}, {"protocol", "P-7"}, {"protocol-reference", "doi:10.1/x"}};
  session.operator_name = "B. Therapist";
  session.software = "haptrace 0.1.0";
  session.force_limit = 4;
  Report report = report_of({session});
  set_norms(report, norms_of({.low = 1e-3, .high = 2.5e-3}));
  const std::string page = report_page(report);
  for (const char* fact :
       {"Ada L.", "left", "P-7", "doi:10.1/x", "B. Therapist", "haptrace 0.1.0", "Signature", "Adverse events",
        "3 of 4 done, 1 partial", "A. Author 2024", "ages 20 to 60", "counter(pages)"})
    EXPECT_THAT(page, HasSubstr(fact));
  EXPECT_THAT(page, HasSubstr("ran out of time at 40 % of the path"));
  EXPECT_THAT(page, HasSubstr("set for this session"));
}

TEST(ReportTime, IsLocalAndHasItsZone) {
  const char* before = std::getenv("TZ");
  const std::string kept = before != nullptr ? before : "";
  const auto in_zone = [](const char* zone) {
    setenv("TZ", zone, 1);
    tzset();
    return local_time("2026-03-04T23:30:00Z");
  };
  EXPECT_EQ(in_zone("CET-1CEST,M3.5.0,M10.5.0/3"), "05 March 2026, 00:30 CET (UTC+01:00)");
  EXPECT_EQ(local_date("2026-03-04T23:30:00Z"), "5 Mar 2026");
  EXPECT_EQ(local_minute("2026-03-04T23:30:00Z"), "5 Mar 2026, 00:30");
  EXPECT_EQ(in_zone("<-0330>3:30"), "04 March 2026, 20:00 UTC-03:30");
  EXPECT_EQ(in_zone("UTC0"), "04 March 2026, 23:30 UTC");
  EXPECT_EQ(local_time("yesterday"), "yesterday");
  if (before != nullptr)
    setenv("TZ", kept.c_str(), 1);
  else
    unsetenv("TZ");
  tzset();
}

TEST(ReportRank, PutsPartialRepetitionsLastByTheirShareOfThePath) {
  const TempFolder folder;
  test::SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  const auto logged = [&](double contour, double share, const char* end) {
    lesson.trial(exercise, {}, end).figures = {
        {"definitions", kFigureDefinitions}, {"contour_rms_m", contour}, {"completion", share}};
  };
  logged(3e-3, 1, "finished");
  logged(1e-4, 0.3, "time_over");
  logged(1e-3, 1, "finished");
  logged(1e-4, 0.6, "time_over");
  lesson.trial(exercise, {}, "deviation");
  lesson.save();
  const Report report = gather_report(std::vector{lesson.path()});
  std::vector<int> ranks;
  for (const ReportTrial& trial : report.sessions[0].exercises[0].trials) ranks.push_back(trial.rank.value_or(0));
  EXPECT_EQ(ranks, (std::vector{2, 4, 1, 3, 0}));
}

TEST(ReportProgress, GrowsFromTheFirstRecordingToTheLast) {
  const TempFolder folder;
  test::SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  for (int i = 0; i < 3; ++i) lesson.trial(exercise, {});
  lesson.save();
  test::write(folder / "one.h5", test::rows_of(test::expert_path(), {}, test::Reference::none), test::Reference::none);
  std::vector<double> shares;
  std::vector<std::string> files;
  gather_report(std::vector{lesson.path(), folder / "one.h5"}, [&](const std::string& file, double done) {
    files.push_back(file);
    shares.push_back(done);
  });
  EXPECT_THAT(shares,
              testing::ElementsAre(0, 0, testing::DoubleNear(1.0 / 6, 1e-9), testing::DoubleNear(1.0 / 3, 1e-9), 0.5));
  EXPECT_EQ(files.back(), folder / "one.h5");
}

TEST(ReportDefinitions, OfAnOlderLogAreReplacedByThoseOfTheRecording) {
  const TempFolder folder;
  test::SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  lesson.trial(exercise, {}).figures = {{"contour_rms_m", 0.5}};
  lesson.trial(exercise, {}).figures = {{"contour_rms_m", 0.5}};
  std::filesystem::remove(lesson.file(lesson.log.trials[1].file));
  lesson.save();
  const Report report = gather_report(std::vector{lesson.path()});
  const std::vector<ReportTrial>& trials = report.sessions[0].exercises[0].trials;
  EXPECT_LT(*trials[0].figures[kContour], 0.01);
  EXPECT_FALSE(trials[1].figures[kContour]);
  EXPECT_THAT(report.sessions[0].remarks, testing::Contains(HasSubstr("definitions of an older version")));
}

}  // namespace
}  // namespace haptrace
