// Metrics of reaches with known answers: minimum-jerk movements that start, bend and push as stated.
#include "metrics/reaching.h"

#include "control/path/min_jerk.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <vector>

namespace haptrace {
namespace {

using testing::HasSubstr;

/// A reach of 100 mm ahead that bends to the left, with a force on the hand.
struct SyntheticReach {
  double reaction = 0.25, time = 0.5;  ///< [s]
  double bend = 0;                     ///< lateral deviation in the middle [m]
  double adaptation = 0;               ///< share of the field for which the hand pushes against the channel
  double rate_hz = 1000;
};

ReachTrial in_curl_field(ReachKind kind) {
  return {.geometry = {.target = Vec3(0.1, 0, 0), .lateral = Vec3::UnitY()},
          .kind = kind,
          .field = curl_field(13, Vec3::UnitZ()),
          .field_block = true};
}

ReachFigures figures_of_reach(const SyntheticReach& reach, ReachKind kind = ReachKind::plain,
                              const std::string& spoiled = "") {
  std::vector<double> time;
  std::vector<Vec3> position, force;
  for (double t = 0; t < 1.5; t += 1 / reach.rate_hz) {
    const MinJerk blend = MinJerk::at(std::clamp((t - reach.reaction) / reach.time, 0.0, 1.0));
    time.push_back(t);
    position.emplace_back(0.1 * blend.s, reach.bend * std::pow(std::sin(std::numbers::pi * blend.s), 2), 0);
    const bool moves = t > reach.reaction && t < reach.reaction + reach.time;
    force.emplace_back(0, moves ? -13 * reach.adaptation * 0.1 * blend.ds / reach.time : 0, 0);
  }
  const auto figures =
      reach_figures({.time = time, .position = position, .force = force}, in_curl_field(kind), spoiled);
  EXPECT_TRUE(figures);
  return figures.value_or(ReachFigures{});
}

TEST(ReachMetrics, FindTheReactionTimeOfAMinimumJerkMovement) {
  for (const double reaction : {0.15, 0.25, 0.6})
    for (const double time : {0.3, 0.5, 0.9})
      EXPECT_NEAR(figures_of_reach({.reaction = reaction, .time = time}).reaction_time.value_or(0), reaction,
                  0.01 * time + 0.002)
          << reaction << " " << time;
}

TEST(ReachMetrics, LeaveOutReactionsThatAreTooFastOrTooSlow) {
  EXPECT_FALSE(figures_of_reach({.reaction = 0.05}).reaction_time);
  EXPECT_FALSE(figures_of_reach({.reaction = 1.05, .time = 0.3}).reaction_time);
}

TEST(ReachMetrics, MeasureTheSignedDeviationTheDirectionAndTheWay) {
  const ReachFigures left = figures_of_reach({.bend = 0.01}), right = figures_of_reach({.bend = -0.01});
  EXPECT_NEAR(left.lateral_deviation, 0.01, 3e-4);
  EXPECT_NEAR(right.lateral_deviation, -0.01, 3e-4);
  EXPECT_NEAR(left.initial_direction_error.value_or(0), std::atan2(0.01, 0.05), 0.02);
  EXPECT_NEAR(right.initial_direction_error.value_or(0), -std::atan2(0.01, 0.05), 0.02);
  EXPECT_GT(left.path_ratio, 1.01);
  const ReachFigures straight = figures_of_reach({});
  EXPECT_NEAR(straight.path_ratio, 1, 0.02);
  EXPECT_LT(straight.end_error, 1e-3);
  EXPECT_NEAR(straight.initial_direction_error.value_or(1), 0, 1e-6);
}

TEST(ReachMetrics, ReadTheAdaptationOfAClampWithinTwoPerCent) {
  for (const double adaptation : {0.0, 0.3, 0.8, 1.0, 1.2}) {
    const ReachFigures figures = figures_of_reach({.adaptation = adaptation}, ReachKind::clamp);
    EXPECT_NEAR(figures.adaptation_index.value_or(-1), adaptation, 0.02 * adaptation + 1e-9);
    if (adaptation > 0) {
      EXPECT_GT(figures.adaptation_r.value_or(0), 0.99);
    }
    EXPECT_EQ(figures.refused, "");
  }
  EXPECT_FALSE(figures_of_reach({.adaptation = 1}).adaptation_index) << "only a clamp has an index";
}

TEST(ReachMetrics, RefuseTheIndexOfAClampWithMoreThanThreeMillimetresOfPlay) {
  const ReachFigures loose = figures_of_reach({.bend = 0.0035, .adaptation = 1}, ReachKind::clamp);
  EXPECT_FALSE(loose.adaptation_index);
  EXPECT_THAT(loose.refused, HasSubstr("its lateral play was 3.5 mm, and at most 3 mm are allowed"));
  EXPECT_TRUE(figures_of_reach({.bend = 0.0025, .adaptation = 1}, ReachKind::clamp).adaptation_index);
}

TEST(ReachMetrics, RefuseTheIndexOfAClampThatDidNotActAsPlanned) {
  const ReachFigures broken =
      figures_of_reach({.adaptation = 1}, ReachKind::clamp, "the hand broke out of the channel");
  EXPECT_FALSE(broken.adaptation_index || broken.adaptation_r);
  EXPECT_EQ(broken.refused, "the clamp has no adaptation index: the hand broke out of the channel");
}

TEST(ReachMetrics, StateTheShareOfTheFieldThatActed) {
  for (const double share : {0.0, 0.3, 1.0})
    EXPECT_NEAR(figures_of_reach({.adaptation = share}).field_share.value_or(-1), share, 0.01 * share + 1e-9);
  EXPECT_FALSE(figures_of_reach({.adaptation = 1}, ReachKind::clamp).field_share);
  EXPECT_FALSE(figures_of_reach({.adaptation = 1}, ReachKind::catch_trial).field_share);
}

TEST(ReachMetrics, HardlyDependOnTheSampling) {
  const SyntheticReach usual{.bend = 0.002, .adaptation = 0.7};
  SyntheticReach slow = usual, fast = usual;
  slow.rate_hz = 250;
  fast.rate_hz = 4000;
  const ReachFigures a = figures_of_reach(slow, ReachKind::clamp), b = figures_of_reach(fast, ReachKind::clamp);
  EXPECT_NEAR(a.adaptation_index.value_or(0), b.adaptation_index.value_or(1), 0.01);
  EXPECT_NEAR(a.reaction_time.value_or(0), b.reaction_time.value_or(1), 0.003);
  EXPECT_NEAR(a.lateral_deviation, b.lateral_deviation, 2e-5);
}

}  // namespace
}  // namespace haptrace
