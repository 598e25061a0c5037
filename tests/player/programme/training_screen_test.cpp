// Tests of what a trainee and a therapist see of a session.
#include "player/programme/training_screen.h"

#include "base/json_reader.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;
using Screen = TrainingScreen::State;

Programme shown_programme(const std::string& exercise, const std::string& keys = "", const std::string& warm_up = "") {
  const std::string shape = R"("shape": {"kind": "circle"})";
  return programme_from_json(
      parse_json(fmt::format(R"({{"haptrace_programme": 1, {} "warm_up": [{}], "exercises": [{{{}, {}}}]}})", keys,
                             warm_up.empty() ? "" : fmt::format("{{{}, {}}}", shape, warm_up), shape, exercise),
                 "p.json"),
      "p.json");
}

/// Returns for every repetition whether it shows a part, as in "1101".
std::string shown(const Programme& programme, ScreenPart part, std::size_t i = 0) {
  std::string text;
  const int rounds = i < programme.warm_up.size() ? 1 : programme.rounds;
  for (int round = 1; round <= rounds; ++round)
    for (int repetition = 1; repetition <= programme.exercise(i).repetitions; ++repetition)
      text += shown_parts(programme, i, round, repetition)[static_cast<std::size_t>(part)] ? '1' : '0';
  return text;
}

TEST(ShownParts, AreAllByDefaultButATestHidesTunnelTrailAndScore) {
  const Programme tunnel = shown_programme(R"("mode": "tunnel", "repetitions": 3)");
  for (std::size_t part = 0; part < kScreenParts; ++part)
    EXPECT_EQ(shown(tunnel, static_cast<ScreenPart>(part)), "111") << part;
  for (const char* mode : {R"("mode": "free", "test": "before")", R"("mode": "free")"}) {
    const Programme test = shown_programme(mode, R"("show": {"trail": "always", "tool": "always"},)");
    EXPECT_EQ(shown(test, ScreenPart::tool), "1");
    EXPECT_EQ(shown(test, ScreenPart::path), "1");
    EXPECT_EQ(shown(test, ScreenPart::tunnel), "0");
    EXPECT_EQ(shown(test, ScreenPart::trail), "0") << "the programme's wish is not for tests";
    EXPECT_EQ(shown(test, ScreenPart::score), "0");
  }
  EXPECT_EQ(
      shown(shown_programme(R"("mode": "free", "test": "after", "show": {"score": "always"})"), ScreenPart::score), "1")
      << "the exercise's own wish is";
}

TEST(ShownParts, AreNoneInATestOfPositionSenseBecauseTheEyesWouldTell) {
  const Programme programme = programme_from_json(
      parse_json(
          R"({"haptrace_programme": 1, "show": {"tool": "always"}, "exercises": [{"mode": "sense", "sense": {}}]})",
          "p.json"),
      "p.json");
  for (std::size_t part = 0; part < kScreenParts; ++part)
    EXPECT_EQ(shown(programme, static_cast<ScreenPart>(part)).find('1'), std::string::npos) << part;
}

TEST(TrainingProgress, AsksUntilTheRepetitionEnds) {
  TrainingProgress progress;
  progress.begin({.exercise = "position sense"});
  progress.ask(12);
  EXPECT_EQ(progress.screen().state, Screen::question);
  EXPECT_EQ(to_json(progress.screen())["rest_s"], 12);
  EXPECT_FALSE(progress.observe({.phase = Phase::hold}));
  progress.end(false, std::nullopt);
  EXPECT_EQ(progress.screen().state, Screen::done);
}

TEST(ShownParts, OfAnExerciseOverrideThoseOfTheProgramme) {
  const Programme programme = shown_programme(R"("mode": "tunnel", "repetitions": 2, "show": {"path": "always"})",
                                              R"("show": {"path": "never", "trail": "never"},)");
  EXPECT_EQ(shown(programme, ScreenPart::path), "11");
  EXPECT_EQ(shown(programme, ScreenPart::trail), "00");
}

TEST(ShownParts, AreSpreadEvenlyAndFadeAsAsked) {
  const Programme half =
      shown_programme(R"("mode": "tunnel", "repetitions": 8, "show": {"score": 0.5, "trail": 0.25})");
  EXPECT_EQ(shown(half, ScreenPart::score), "10101010");
  const std::string quarter = shown(half, ScreenPart::trail);
  EXPECT_EQ(std::count(quarter.begin(), quarter.end(), '1'), 2);
  EXPECT_EQ(quarter.substr(0, 4), quarter.substr(4));

  const Programme fading = shown_programme(
      R"("mode": "tunnel", "repetitions": 20, "show": {"path": {"from": 1, "to": 0.2}})", R"("rounds": 2,)");
  const std::string all = shown(fading, ScreenPart::path);
  EXPECT_EQ(all.substr(0, 3), "111");
  EXPECT_NEAR(static_cast<double>(std::count(all.begin(), all.end(), '1')), 0.6 * 40, 1);
  EXPECT_NEAR(static_cast<double>(std::count(all.end() - 10, all.end(), '1')), 3, 1) << "the last ten of both rounds";
  EXPECT_EQ(all, shown(fading, ScreenPart::path)) << "the same in every run";
}

TEST(ShownParts, RejectWhatIsNoShare) {
  for (const char* show :
       {R"({"path": "often"})", R"({"path": 2})", R"({"path": [1]})", R"({"path": {"from": 1}})", R"({"way": 1})", "1"})
    EXPECT_NE(error_of([&] { (void)shown_programme(fmt::format(R"("mode": "tunnel", "show": {})", show)); }), "")
        << show;
  EXPECT_THAT(error_of([&] { (void)shown_programme(R"("mode": "tunnel", "show": {"path": true})"); }),
              HasSubstr("show.path: must be \"always\", \"never\", a share"));
}

Sample training_sample(double time, Phase phase, double x = 0) {
  Sample sample;
  sample.time_ns = static_cast<std::int64_t>(1e9 * time);
  sample.phase = phase;
  sample.position = Vec3(x, 0, 0);
  return sample;
}

LoggedTrial scored(double inside, double time, double assistance = 1) {
  LoggedTrial trial{.stopped_by = "finished", .figures = {{"time_in_tunnel", inside}, {"movement_time_s", time}}};
  trial.settings.assistance = assistance;
  return trial;
}

TEST(TrainingProgress, PassesThroughTheStatesOfARepetition) {
  TrainingProgress progress;
  progress.begin({.exercise = "Curve", .mode = "tunnel", .number = 2, .of = 8, .next = "Test"});
  EXPECT_EQ(progress.screen().state, Screen::waiting);
  EXPECT_TRUE(progress.observe(training_sample(0, Phase::approach)));
  EXPECT_EQ(progress.screen().state, Screen::approach);
  EXPECT_FALSE(progress.observe(training_sample(0.1, Phase::approach)));
  progress.observe(training_sample(1, Phase::run));
  EXPECT_EQ(progress.screen().state, Screen::go);
  progress.observe(training_sample(1.5, Phase::run, 1e-3));
  EXPECT_EQ(progress.screen().state, Screen::go) << "nobody has moved yet";
  progress.observe(training_sample(1.6, Phase::run, 3e-3));
  EXPECT_EQ(progress.screen().state, Screen::moving);
  progress.observe(training_sample(5, Phase::hold, 0.1));
  EXPECT_EQ(progress.screen().state, Screen::done);
  EXPECT_FALSE(progress.screen().score) << "not measured yet";
  progress.end(scored(0.93, 6.2), {});
  ASSERT_TRUE(progress.screen().score);
  EXPECT_EQ(progress.screen().score->time_in_tunnel, 0.93);
  progress.rest(12);
  const nlohmann::json json = to_json(progress.screen());
  EXPECT_EQ(json["type"], "training");
  EXPECT_EQ(json["state"], "rest");
  EXPECT_EQ(json["rest_s"], 12);
  EXPECT_EQ(json["next"], "Test");
  EXPECT_EQ(json["trial"], 2);
  EXPECT_EQ(json["show"]["tunnel"], true);
  EXPECT_EQ(json["score"]["time_s"], 6.2);
  progress.rest(kNaN);
  EXPECT_EQ(progress.screen().state, Screen::waiting) << "paused";
  progress.finish(false);
  EXPECT_EQ(progress.screen().state, Screen::finished);
}

TEST(TrainingProgress, EndsTheStateGoAfterASecond) {
  TrainingProgress progress;
  progress.begin({});
  progress.observe(training_sample(1, Phase::run));
  progress.observe(training_sample(1.9, Phase::run));
  EXPECT_EQ(progress.screen().state, Screen::go);
  progress.observe(training_sample(2.1, Phase::run));
  EXPECT_EQ(progress.screen().state, Screen::moving);
}

TEST(TrainingProgress, HidesTheScoreOfATestAndOfAStoppedRepetition) {
  TrainingProgress progress;
  progress.begin({.show = {true, true, false, false, false}});
  progress.end(scored(0.9, 5), {});
  EXPECT_EQ(progress.screen().state, Screen::done);
  EXPECT_FALSE(progress.screen().score);

  progress.begin({});
  LoggedTrial stopped = scored(0.9, 5);
  stopped.stopped_by = "deviation";
  progress.end(stopped, {});
  EXPECT_EQ(progress.screen().state, Screen::stopped);
  EXPECT_FALSE(progress.screen().score);
  EXPECT_FALSE(progress.observe(training_sample(9, Phase::run))) << "a late sample does not undo it";
}

TEST(TrainingProgress, SaysThatARepetitionWasSkippedAndNotThatItWasStopped) {
  TrainingProgress progress;
  progress.begin({.exercise = "curve"});
  progress.observe(training_sample(1, Phase::run));
  EXPECT_TRUE(progress.observe(training_sample(2, Phase::stopped), true));
  EXPECT_EQ(progress.screen().state, Screen::skipped);
  EXPECT_FALSE(progress.observe(training_sample(2.1, Phase::stopped))) << "a late sample does not undo it";
  LoggedTrial trial = scored(0.9, 5);
  trial.stopped_by = "skipped";
  progress.end(trial, {});
  EXPECT_EQ(to_json(progress.screen())["state"], "skipped");
  EXPECT_FALSE(progress.screen().score);

  progress.begin({.exercise = "curve"});
  EXPECT_TRUE(progress.observe(training_sample(1, Phase::stopped)));
  EXPECT_EQ(progress.screen().state, Screen::stopped);
}

TEST(TrainingScore, IsTheBestOnlyBeyondTheTraineesOwnSpread) {
  const std::vector<LoggedTrial> earlier{scored(0.80, 6), scored(0.84, 6.5), scored(0.88, 6.2)};
  EXPECT_FALSE(training_score(scored(0.95, 6), {earlier[0], earlier[1]})->best) << "two have no spread";
  EXPECT_TRUE(training_score(scored(0.95, 6), earlier)->best);
  EXPECT_FALSE(training_score(scored(0.87, 6), earlier)->best) << "not above all";
  EXPECT_FALSE(training_score(scored(0.885, 6), earlier)->best) << "above all, but within the spread";
  EXPECT_FALSE(
      training_score(scored(0.95, 6, 1.0), {scored(0.8, 6, 0.5), scored(0.84, 6, 0.5), scored(0.88, 6, 0.4)})->best)
      << "better with more help is no progress";
  EXPECT_TRUE(training_score(scored(1, 4), {scored(1, 6), scored(1, 6.5), scored(1, 6.2)})->best) << "faster";
  EXPECT_FALSE(training_score(scored(1, 6.2), {scored(1, 6.2), scored(1, 6.2), scored(1, 6.2)})->best);
  LoggedTrial other = scored(0.1, 6);
  other.exercise = 5;
  EXPECT_FALSE(training_score(scored(0.5, 6), {other, other, other})->best) << "other exercises do not count";
  EXPECT_FALSE(training_score(LoggedTrial{.stopped_by = "finished"}, earlier)) << "nothing was measured";
}

TEST(ProgrammeMessage, HasExercisesAndTheTrendOfTheirRepetitions) {
  const Programme programme = shown_programme(
      R"("mode": "assisted", "name": "Curve", "repetitions": 4,
         "progression": {"target": 0.002, "assistance": {"start": 0.8}})",
      R"("title": "Monday", "limits": {"time": 1800}, "rounds": 2,)", R"("mode": "passive", "name": "Warm")");
  SessionLog log;
  log.subject = "P07";
  LoggedTrial trial = scored(0.9, 5, 0.6);
  trial.exercise = 1;
  trial.figures["contour_rms_m"] = 0.0018;
  log.trials = {trial, trial, trial, LoggedTrial{.exercise = 1}};
  log.trials[1].stopped_by = "time_over";
  log.trials[1].figures["helped_time"] = 0.25;
  log.trials[2].stopped_by = "skipped";
  const nlohmann::json json = programme_message(programme, log, {.current = 1, .paused = true, .elapsed = 90});
  EXPECT_EQ(json["title"], "Monday");
  EXPECT_EQ(json["limit_s"], 1800);
  EXPECT_EQ(json["paused"], true);
  ASSERT_EQ(json["exercises"].size(), 2U);
  EXPECT_EQ(json["exercises"][1]["repetitions"], 8);
  EXPECT_EQ(json["exercises"][1]["done"], 2);
  EXPECT_EQ(json["exercises"][1]["skipped"], 1);
  ASSERT_EQ(json["trials"].size(), 3U) << "the running one has no figures";
  EXPECT_EQ(json["trials"][0]["rms_m"], 0.0018);
  EXPECT_EQ(json["trials"][0]["help"], 0.6);
  EXPECT_EQ(json["trials"][0]["target_m"], 0.002);
  EXPECT_EQ(json["trials"][0]["partial"], false);
  EXPECT_EQ(json["trials"][1]["help"], 0.25) << "the help that was felt, not the one that was allowed";
  EXPECT_EQ(json["trials"][1]["partial"], true);
  EXPECT_EQ(json["trials"][1]["skipped"], false);
  EXPECT_EQ(json["trials"][2]["skipped"], true);
}

}  // namespace
}  // namespace haptrace
