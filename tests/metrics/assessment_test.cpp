// Metrics of range of motion, press and tracking, from movements and forces with known answers.
#include "metrics/assessment.h"

#include "control/path/min_jerk.h"
#include "metrics/assessment_summary.h"
#include "metrics/position_sense.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <vector>

namespace haptrace {
namespace {

using testing::HasSubstr;

/// A trial of `duration` along x at 1 kHz.
struct AlongX {
  std::vector<double> time;
  std::vector<Vec3> position, force, measured;

  AlongX(double duration, const std::function<double(double)>& place, const std::function<double(double)>& hand = {},
         double rate_hz = 1000) {
    for (int i = 0; i <= std::lround(duration * rate_hz); ++i) {
      time.push_back(7 + i / rate_hz);
      position.emplace_back(place(i / rate_hz), 0, 0);
      if (hand) force.emplace_back(-hand(i / rate_hz), 0, 0);  // the device holds against the hand
    }
  }
  [[nodiscard]] Trial trial() const {
    return {.time = time, .position = position, .force = force, .measured = measured};
  }
};

ReachTrial ahead(ReachGoal goal) {
  ReachTrial trial{.geometry = {.target = Vec3(0.1, 0, 0)}, .goal = goal};
  if (goal == ReachGoal::track) trial.track = {.frequency = {0.1, 0.17, 0.31, 0.53, 0.79}, .phase = {1, 2, 3, 4, 5}};
  return trial;
}

TEST(RangeOfMotion, IsTheFarthestPlaceThatTheHandKeptForTheHold) {
  // Out to 80 mm in 1 s, a swing to 95 mm that lasts 0.3 s, then 78 mm for the rest.
  const AlongX tried(4, [](double t) {
    if (t > 1.5 && t < 1.8) return 0.095;
    return t < 1.5 ? 0.08 * MinJerk::at(std::min(t, 1.0)).s : 0.078;
  });
  const auto figures = range_figures(tried.trial(), ahead(ReachGoal::range));
  ASSERT_TRUE(figures);
  EXPECT_NEAR(figures->distance, 0.0791, 1e-3) << "0.5 s end at the swing; the place 0.5 s before it was 79 mm";
  EXPECT_FALSE(figures->at_limit) << "the workspace is unknown";
}

TEST(RangeOfMotion, IsALowerBoundWithinFiveMillimetresOfTheWorkspaceInItsDirection) {
  const AlongX tried(2, [](double t) { return 0.08 * MinJerk::at(std::min(t, 1.0)).s; });
  ReachTrial reach = ahead(ReachGoal::range);
  const auto at_limit = [&](double end) {
    reach.workspace = {.min = Vec3(-1, -0.001, -1), .max = Vec3(end, 0.001, 1)};
    return range_figures(tried.trial(), reach)->at_limit;
  };
  EXPECT_TRUE(at_limit(0.084));
  EXPECT_FALSE(at_limit(0.086)) << "the walls to its sides do not count";
}

TEST(RangeOfMotion, IsZeroForAHandThatGoesTheOtherWay) {
  const AlongX tried(2, [](double t) { return -0.04 * MinJerk::at(std::min(t, 1.0)).s - 0.001; });
  ReachTrial reach = ahead(ReachGoal::range);
  reach.workspace = {.min = Vec3(-1, -1, -1), .max = Vec3(0.002, 1, 1)};
  const auto figures = range_figures(tried.trial(), reach);
  ASSERT_TRUE(figures);
  EXPECT_EQ(figures->distance, 0);
  EXPECT_FALSE(figures->at_limit) << "what the hand did not try has no limit";
}

TEST(RangeOfMotion, DoesNotBridgeMissingPositionsAndNeedsAWholeHold) {
  AlongX tried(2, [](double t) { return t < 1 ? 0.05 : 0.07; });
  for (std::size_t i = 1300; i < 1400; ++i) tried.position[i] = nan3();
  // 70 mm were seen for 0.3 s and for 0.6 s: the second one counts.
  EXPECT_NEAR(range_figures(tried.trial(), ahead(ReachGoal::range))->distance, 0.07, 1e-12);
  for (std::size_t i = 1700; i < 1710; ++i) tried.position[i] = nan3();
  EXPECT_NEAR(range_figures(tried.trial(), ahead(ReachGoal::range))->distance, 0.05, 1e-12);
  EXPECT_FALSE(range_figures(AlongX(0.4, [](double) { return 0.1; }).trial(), ahead(ReachGoal::range)));
}

TEST(Press, IsTheLargestMeanOverHalfASecond) {
  // A triangle of 2 s with a peak of 10 N: the mean of the 0.5 s around the peak is 10 - 10 * 0.25 / 2.
  const AlongX tried(
      3, [](double) { return 0.0; }, [](double t) { return t < 2 ? 10 * (1 - std::abs(t - 1)) : 0.0; });
  const auto figures = press_figures(tried.trial(), ahead(ReachGoal::press));
  ASSERT_TRUE(figures);
  EXPECT_NEAR(figures->force, 8.75, 0.01);
  EXPECT_FALSE(figures->at_limit);
  const AlongX slow(
      3, [](double) { return 0.0; }, [](double t) { return t < 2 ? 10 * (1 - std::abs(t - 1)) : 0.0; }, 130);
  EXPECT_NEAR(press_figures(slow.trial(), ahead(ReachGoal::press))->force, 8.75, 0.05) << "at another rate";
}

TEST(Press, PrefersTheMeasuredForceAndSaysWhenTheDeviceCouldNotHoldMore) {
  AlongX tried(
      2, [](double) { return 0.0; }, [](double) { return 4.0; });
  ReachTrial reach = ahead(ReachGoal::press);
  reach.largest = 4.1;
  EXPECT_TRUE(press_figures(tried.trial(), reach)->at_limit) << "4 N of 4.1 N";
  reach.largest = 6;
  EXPECT_FALSE(press_figures(tried.trial(), reach)->at_limit);
  EXPECT_TRUE(press_figures(tried.trial(), reach, "the hand broke out of the channel")->at_limit);
  tried.measured.assign(tried.time.size(), Vec3(-5, 0, 0));
  EXPECT_NEAR(press_figures(tried.trial(), reach)->force, 5, 1e-9);
  tried.force.clear();
  tried.measured.clear();
  EXPECT_FALSE(press_figures(tried.trial(), reach)) << "nothing measures it";
}

TEST(Press, CountsTheLastTenthOfASecondOfALockThatBrokeSoon) {
  // 3 N at the end of 0.3 s: no mean over half a second.
  const AlongX tried(
      0.3, [](double) { return 0.0; }, [](double t) { return 10 * t; });
  ReachTrial reach = ahead(ReachGoal::press);
  reach.largest = 8;
  EXPECT_FALSE(press_figures(tried.trial(), reach));
  const auto broken = press_figures(tried.trial(), reach, "the hand broke out of the channel");
  ASSERT_TRUE(broken);
  EXPECT_NEAR(broken->force, 2.5, 0.01);
  EXPECT_TRUE(broken->at_limit);
}

TEST(Press, IsNoLowerBoundForAFewSamplesAtTheLimit) {
  const AlongX tried(
      2, [](double) { return 0.0; }, [](double t) { return t > 1 && t < 1.04 ? 8.0 : 5.0; });
  ReachTrial reach = ahead(ReachGoal::press);
  reach.largest = 8;
  EXPECT_FALSE(press_figures(tried.trial(), reach)->at_limit) << "8 % of the best half second";
}

TEST(Press, IsNoResultInTheOtherDirectionOrForALockedHandleThatMoved) {
  const AlongX pulled(
      2, [](double) { return 0.0; }, [](double) { return -4.0; });
  ReachTrial reach = ahead(ReachGoal::press);
  reach.largest = 8;
  EXPECT_THAT(press_figures(pulled.trial(), reach)->refused, HasSubstr("did not press in this direction"));
  AlongX moved(2, [](double t) { return 0.01 * t; });
  moved.measured.assign(moved.time.size(), Vec3(-5, 0, 0));
  reach.largest = 0;
  EXPECT_THAT(press_figures(moved.trial(), reach)->refused, HasSubstr("the handle moved by 20 mm"));
}

TEST(Tracking, FindsTheGainAndTheDelayOfAHandThatCopiesTheTarget) {
  const ReachTrial reach = ahead(ReachGoal::track);
  for (const double gain : {0.3, 0.9, 1.2})
    for (const double delay : {0.0, 0.08, 0.35, 0.9}) {
      const AlongX tried(45, [&](double t) { return 0.002 + 0.1 * gain * reach.track.at(t - delay); });
      const auto figures = track_figures(tried.trial(), reach);
      ASSERT_TRUE(figures && figures->gain && figures->delay);
      EXPECT_NEAR(*figures->gain, gain, 0.01 * gain);
      EXPECT_NEAR(*figures->delay, delay, 1.5e-3) << gain;
    }
}

TEST(Tracking, HasTheErrorOfAHandAtRestAndNoDelay) {
  const ReachTrial reach = ahead(ReachGoal::track);
  const auto figures = track_figures(AlongX(105, [](double) { return 0.0; }).trial(), reach);
  ASSERT_TRUE(figures);
  // The mean square of five sines, each 20 mm large.
  EXPECT_NEAR(figures->rms, 0.02 * std::sqrt(5 / 2.0), 3e-4);
  EXPECT_NEAR(figures->gain.value_or(1), 0, 0.01);
  EXPECT_FALSE(figures->delay);
}

TEST(Tracking, CountsNothingBeforeItsDiscard) {
  const ReachTrial reach = ahead(ReachGoal::track);
  const AlongX tried(45, [&](double t) { return t < 5 ? 0.5 : 0.1 * reach.track.at(t); });
  EXPECT_NEAR(track_figures(tried.trial(), reach)->rms, 0, 1e-9);
  EXPECT_FALSE(track_figures(AlongX(4, [](double) { return 0.0; }).trial(), reach));
}

TEST(Tracking, MovesItsTargetWithinItsBoundsFromRest) {
  const TrackSignal signal = ahead(ReachGoal::track).track;
  EXPECT_EQ(signal.at(0), 0);
  EXPECT_NEAR(signal.at(1e-3), 0, 1e-5) << "without a jump of its speed";
  double largest = 0;
  for (double t = 0; t < 100; t += 0.01) largest = std::max(largest, std::abs(signal.at(t)));
  EXPECT_LE(largest, 1);
  EXPECT_GT(largest, 0.5);
}

/// Answers of an observer with a threshold and a bias [m] to each of these differences, `tries` times.
std::vector<SenseAnswer> answers_of(double threshold, double bias, int tries, std::mt19937_64& random) {
  std::vector<SenseAnswer> answers;
  std::uniform_real_distribution<double> even(0, 1);
  for (const double size : {0.002, 0.004, 0.006, 0.01, 0.016})
    for (const double d : {-size, size})
      for (int i = 0; i < tries / 2; ++i) {
        const double p = 0.01 + 0.98 / (1 + std::exp(-1.1257 * (d - bias) / threshold));
        answers.push_back({.difference = d, .second = even(random) < p});
      }
  return answers;
}

TEST(PositionSense, TheMeanThresholdOf200SessionsIsWithinFivePerCentOfTheTruth) {
  std::mt19937_64 random(11);
  for (const double threshold : {0.003, 0.006}) {
    double sum = 0, bias = 0;
    int within = 0;
    for (int session = 0; session < 200; ++session) {
      const auto fit = fit_sense(answers_of(threshold, 0.001, 24, random));
      ASSERT_TRUE(fit);
      sum += fit->threshold;
      bias += fit->bias;
      within += fit->low <= threshold && threshold <= fit->high ? 1 : 0;
    }
    EXPECT_NEAR(sum / 200, threshold, 0.05 * threshold);
    EXPECT_NEAR(bias / 200, 0.001, 0.2e-3);
    EXPECT_GE(within, 180) << "of 200 intervals of 95 %";
  }
}

TEST(PositionSense, IsExactForProbabilitiesThatFollowTheModel) {
  // 10 000 answers to each difference, in exact shares.
  std::vector<SenseAnswer> answers;
  for (const double d : {-0.008, -0.004, -0.002, 0.002, 0.004, 0.008}) {
    const double p = 0.01 + 0.98 / (1 + std::exp(-1.1257 * (d + 0.0005) / 0.004));
    for (int i = 0; i < 2000; ++i) answers.push_back({.difference = d, .second = i < p * 2000});
  }
  const auto fit = fit_sense(answers);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->threshold, 0.004, 2e-5);
  EXPECT_NEAR(fit->bias, -0.0005, 2e-5);
  EXPECT_NEAR(fit->high - fit->low, 0.0004, 0.0004) << "12 000 answers leave little doubt";
  EXPECT_LT(fit->low, fit->threshold);
  EXPECT_GT(fit->high, fit->threshold);
  EXPECT_NEAR(fit->slope, 0.98 * 1.1257 / (4 * 0.004), 0.5);
}

TEST(PositionSense, HasNoThresholdForAnswersThatAreAllRightOrByChanceOrFew) {
  std::vector<SenseAnswer> right, chance;
  for (int i = 0; i < 100; ++i) {
    const double d = (i % 2 == 0 ? 1 : -1) * 0.002 * (1 + i % 5);
    right.push_back({.difference = d, .second = d > 0});
    chance.push_back({.difference = d, .second = (i / 2) % 2 == 0});
  }
  EXPECT_FALSE(fit_sense(right));
  EXPECT_FALSE(fit_sense(chance));
  EXPECT_FALSE(fit_sense({}));
  std::mt19937_64 random(1);
  std::vector<SenseAnswer> few = answers_of(0.004, 0, 24, random);
  few.resize(SenseFit::kLeastAnswers - 1);
  EXPECT_FALSE(fit_sense(few));
}

TEST(PositionSense, CountsAnswersAndThoseThatNeverCame) {
  const Programme programme = programme_from_json(
      nlohmann::json::parse(R"({"haptrace_programme": 1, "exercises": [{"mode": "sense", "sense": {}}]})"), "p.json");
  SessionLog log;
  const auto add = [&](double difference, int answer) {
    log.trials.push_back({.exercise = 0,
                          .stopped_by = answer == 0 ? "time_over" : "finished",
                          .figures = {{"sense_difference_m", difference}},
                          .sense = SenseTrial{.pair = 0, .answer = answer}});
  };
  add(0.004, 2);
  add(-0.004, 2);
  add(-0.004, 1);
  add(0.004, 0);
  const auto summary = summarise_sense(programme, 0, log);
  ASSERT_TRUE(summary);
  EXPECT_EQ(describe(*summary), "3 answers, 1 without an answer: no threshold from fewer than 20 answers");
  log.trials.back().figures["refused"] = "the hand did not let the device lead it";
  EXPECT_EQ(summarise_sense(programme, 0, log)->refused, 1U);
  EXPECT_EQ(to_json(*summary)["right"], 2);
}

/// A log of trials of one exercise.
SessionLog log_of(const std::vector<std::pair<int, nlohmann::json>>& figures_by_target) {
  SessionLog log;
  for (const auto& [target, figures] : figures_by_target)
    log.trials.push_back(
        {.exercise = 0, .stopped_by = "finished", .figures = figures, .reach = PlannedReach{.target = target}});
  return log;
}

Programme assessment(const char* exercise) {
  return programme_from_json(
      nlohmann::json::parse(fmt::format(R"({{"haptrace_programme": 1, "exercises": [{}]}})", exercise)), "p.json");
}

TEST(AssessmentSummaries, GiveTheBestOfTheTriesAndTheAreaWithinThem) {
  const Programme programme = assessment(
      R"({"mode": "range", "range": {"targets": {"kind": "centre-out", "count": 4, "distance": 0.05}, "tries": 2}})");
  SessionLog log = log_of({{0, {{"range_m", 0.08}}},
                           {0, {{"range_m", 0.1}, {"at_limit", "the end"}}},
                           {1, {{"range_m", 0.1}}},
                           {2, {{"range_m", 0.1}}},
                           {3, {{"range_m", nullptr}}},
                           {3, {{"range_m", 0.1}}}});
  const auto summary = summarise_assessment(programme, 0, log);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->trials, 5U);
  EXPECT_EQ(summary->directions[0].tries, 2U);
  EXPECT_EQ(summary->directions[0].best, 0.1);
  EXPECT_TRUE(summary->directions[0].at_limit);
  EXPECT_FALSE(summary->directions[1].at_limit);
  EXPECT_NEAR(summary->area.value_or(0), 0.02, 1e-12) << "a square whose diagonals are 0.2 m";
  const std::vector<std::string> lines = describe(*summary);
  EXPECT_EQ(lines[0], "direction 1 (0 degrees): >= 100.0 mm, best of 2");
  EXPECT_EQ(lines[4], "area within these places: >= 200.0 cm2");
  EXPECT_EQ(to_json(*summary)["directions"][0]["at_limit"], true);
  // A hand that was steered by mouse shows nothing about a person.
  for (LoggedTrial& trial : log.trials) trial.input = "view";
  EXPECT_EQ(summarise_assessment(programme, 0, log)->trials, 0U);
}

TEST(AssessmentSummaries, AreMeansOfTracking) {
  const Programme programme = assessment(R"({"mode": "track", "repetitions": 2, "track": {}})");
  const auto summary = summarise_assessment(
      programme, 0,
      log_of({{0, {{"tracking_rms_m", 0.01}, {"tracking_gain", 0.8}, {"tracking_delay_s", 0.2}}},
              {0, {{"tracking_rms_m", 0.02}, {"tracking_gain", 0.9}, {"tracking_delay_s", nullptr}}}}));
  ASSERT_TRUE(summary);
  EXPECT_THAT(describe(*summary).front(), HasSubstr("2 trials: rms error 15.0 mm, gain 0.85, delay 200 ms"));
  EXPECT_FALSE(
      summarise_assessment(assessment(R"({"mode": "reach", "reach": {"targets": [[0.1, 0, 0]]}})"), 0, SessionLog{}));
}

}  // namespace
}  // namespace haptrace
