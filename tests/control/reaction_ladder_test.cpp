#include "control/reaction_ladder.h"

#include "control/force_guard.h"
#include "tests/support/allocations.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <vector>

namespace haptrace {
namespace {

constexpr double kTick = 1e-3;  // [s]
const VibrationAlarm kFast{.rule = VibrationRule::energy, .frequency_hz = 60, .ripple = 3};
const VibrationAlarm kBounce{.rule = VibrationRule::contacts, .frequency_hz = 9, .ripple = 2};
const VibrationAlarm kHint{.rule = VibrationRule::slow, .frequency_hz = 5, .ripple = 2};

/// Returns the events of `seconds` [s] with the same alarm at every tick.
std::vector<Event> run(ReactionLadder& ladder, const std::optional<VibrationAlarm>& alarm, double seconds) {
  std::vector<Event> events;
  for (int k = 0; k < std::lround(seconds / kTick); ++k)
    if (const auto event = ladder.update(alarm, kTick)) events.push_back(*event);
  return events;
}

TEST(ReactionLadder, LeavesAQuietLoopAlone) {
  ReactionLadder ladder;
  EXPECT_TRUE(run(ladder, std::nullopt, 10).empty());
  EXPECT_EQ(ladder.share(), 1);
}

TEST(ReactionLadder, SoftensToThreeTenthsWithinTwentyMillisecondsAndForGood) {
  ReactionLadder ladder;
  const auto event = ladder.update(kFast, kTick);
  ASSERT_TRUE(event);
  EXPECT_EQ(event->code, EventCode::vibrates);
  EXPECT_EQ(event->values, (std::array{3.0, 60.0, 0.3}));
  EXPECT_EQ(describe(*event), "the force vibrates at 60 Hz, 3 N rms: feedback softened to 30 %");
  double last = ladder.share();
  for (int k = 0; k < 20; ++k) {
    EXPECT_FALSE(ladder.update(std::nullopt, kTick));
    EXPECT_LE(last - ladder.share(), 0.0351) << "without a jump";
    last = ladder.share();
  }
  EXPECT_NEAR(ladder.share(), 0.3, 1e-9);
  EXPECT_TRUE(run(ladder, std::nullopt, 60).empty());
  EXPECT_NEAR(ladder.share(), 0.3, 1e-9);
}

TEST(ReactionLadder, EndsAVibrationThatThreeStepsDoNotCalmWithinASecond) {
  ReactionLadder ladder;
  const auto events = run(ladder, kFast, 1);
  ASSERT_EQ(events.size(), 4U);
  EXPECT_DOUBLE_EQ(events[1].values[2], 0.09);
  EXPECT_DOUBLE_EQ(events[2].values[2], 0.05);
  EXPECT_EQ(events[3].code, EventCode::vibration_stays);
  EXPECT_TRUE(ladder.beyond_help());
  EXPECT_EQ(ladder.steps()[static_cast<std::size_t>(VibrationRule::energy)], 3);
}

TEST(ReactionLadder, GivesTheFeedbackBackOnlyToOtherGainsAndWithoutAJump) {
  ReactionLadder ladder;
  ladder.renew();
  EXPECT_EQ(ladder.target(), 1) << "nothing was taken";
  (void)run(ladder, kFast, 0.05);
  ASSERT_NEAR(ladder.share(), 0.3, 1e-9);
  ladder.renew();
  EXPECT_FALSE(ladder.softened());
  double last = ladder.share();
  for (int k = 0; k < 500; ++k) {
    (void)ladder.update(std::nullopt, kTick);
    EXPECT_LE(std::abs(ladder.share() - last), 0.0015);
    last = ladder.share();
  }
  EXPECT_NEAR(ladder.share(), 1, 1e-9);
  EXPECT_EQ(run(ladder, kFast, 0.05).size(), 1U) << "the other gains may vibrate as well";
  EXPECT_NEAR(ladder.share(), 0.3, 1e-9);
}

TEST(ReactionLadder, GivesNothingBackOnceSofteningCouldNotHelp) {
  ReactionLadder ladder;
  (void)run(ladder, kFast, 1);
  ASSERT_TRUE(ladder.beyond_help());
  ladder.renew();
  (void)run(ladder, std::nullopt, 1);
  EXPECT_NEAR(ladder.share(), 0.05, 1e-9);
}

TEST(ReactionLadder, ReducesAResidualVibrationMoreSlowlyAndNeverEndsForIt) {
  VibrationAlarm rest = kFast;
  rest.remains = true;
  ReactionLadder ladder;
  EXPECT_TRUE(ladder.update(kFast, kTick));
  EXPECT_TRUE(run(ladder, rest, 0.24).empty()) << "the filters still contain the time before the step";
  const auto events = run(ladder, rest, 30);
  EXPECT_FALSE(ladder.beyond_help());
  ASSERT_EQ(events.size(), 2U);
  EXPECT_DOUBLE_EQ(events[1].values[2], 0.05);
}

TEST(ReactionLadder, NeverEndsASessionForBouncesOrHints) {
  for (const VibrationAlarm& alarm : {kBounce, kHint}) {
    ReactionLadder ladder;
    const auto events = run(ladder, alarm, 30);
    EXPECT_FALSE(ladder.beyond_help());
    EXPECT_NEAR(ladder.share(), alarm.rule == VibrationRule::slow ? 0.2 : 0.05, 1e-9);
    EXPECT_EQ(events.size(), 3U);
  }
}

TEST(ReactionLadder, RestoresTheFeedbackAfterAHintUntilItHasReturnedThreeTimes) {
  ReactionLadder ladder;
  for (int episode = 0; episode < 3; ++episode) {
    EXPECT_EQ(run(ladder, kHint, 0.3).size(), 1U);
    EXPECT_TRUE(run(ladder, std::nullopt, 1.9).empty());
    EXPECT_NEAR(ladder.share(), 0.5, 1e-9) << "it waits for 2 s of quiet";
    const auto events = run(ladder, std::nullopt, 5.2);
    EXPECT_EQ(ladder.share(), 1);
    ASSERT_EQ(events.size(), 1U) << "of its end";
    EXPECT_EQ(events[0].code, EventCode::sway_over);
    EXPECT_EQ(describe(events[0]), "the loop and the hand are calm again: feedback back at 100 %");
  }
  run(ladder, kHint, 0.3);
  run(ladder, std::nullopt, 60);
  EXPECT_NEAR(ladder.share(), 0.5, 1e-9) << "the reduction stays after the third return";
}

TEST(ReactionLadder, WaitsTwoPeriodsForTheNextStepOfAHint) {
  ReactionLadder ladder;
  EXPECT_EQ(run(ladder, kHint, 0.39).size(), 1U) << "0.4 s at 5 Hz";
  EXPECT_EQ(run(ladder, kHint, 0.02).size(), 1U);
}

TEST(ForceGuard, SoftensTheFeedbackAndLeavesTheFeedforward) {
  ForceGuard guard({.monitor = {.max_force = 8}, .max_torque = 0.1});
  const Vec3 known(0, 0, 2);
  Wrench asked{.force = Vec3(4, 0, 2), .torque = Vec3(0.05, 0, 0)};
  EXPECT_EQ(guard.soften(asked, known).force, asked.force);
  const std::size_t before = test::allocations();
  int events = 0;
  for (int k = 0; k < 320; ++k) {
    const Vec3 shaking(6 * std::sin(2 * std::numbers::pi * 60 * k * kTick), 0, 0);
    events += guard.watch({.force = shaking, .torque = Vec3::Zero()}, Vec3::Zero(), 0, kTick).has_value();
  }
  EXPECT_EQ(test::allocations(), before);
  ASSERT_GE(events, 1);
  const double share = guard.summary().share;
  EXPECT_LT(share, 0.31);
  EXPECT_GT(guard.summary().worst_ripple, 3);
  EXPECT_NEAR(guard.summary().frequency_hz, 60, 2);
  for (int k = 0; k < 20; ++k) (void)guard.watch({}, Vec3::Zero(), 0, kTick);
  EXPECT_TRUE(guard.soften(asked, known).force.isApprox(Vec3(4 * guard.summary().share, 0, 2), 1e-9));
  EXPECT_NEAR(guard.soften(asked, known).torque.x(), 0.05 * guard.summary().share, 1e-9);
}

TEST(ForceGuard, SoftensAResidualVibrationThatRaisesNoAlarmByItself) {
  for (const bool before : {false, true}) {
    ForceGuard guard({.monitor = {.max_force = 8}});
    double share = 1;
    for (int k = 0; k < 3000; ++k) {
      const double amplitude = before && k < 100 ? 6 : 0.15 * 8 * std::numbers::sqrt2;
      const Vec3 shaking(amplitude * std::sin(2 * std::numbers::pi * 160 * k * kTick), 0, 0);
      (void)guard.watch({.force = shaking, .torque = Vec3::Zero()}, Vec3::Zero(), 0, kTick);
      share = guard.summary().share;
    }
    EXPECT_DOUBLE_EQ(share, before ? 0.05 : 1.0);
    EXPECT_FALSE(guard.beyond_help());
  }
}

TEST(ForceGuard, WatchesTheTorqueAsWell) {
  ForceGuard guard({.monitor = {.max_force = 8}, .max_torque = 0.1});
  std::optional<Event> event;
  for (int k = 0; k < 500 && !event; ++k) {
    const Vec3 shaking(0, 0, 0.05 * std::sin(2 * std::numbers::pi * 40 * k * kTick));
    event = guard.watch({.force = Vec3::Zero(), .torque = shaking}, Vec3::Zero(), 0, kTick);
  }
  ASSERT_TRUE(event);
  EXPECT_EQ(event->code, EventCode::torque_vibrates);
  EXPECT_NEAR(event->values[1], 40, 2);
}

}  // namespace
}  // namespace haptrace
