#include "control/hand_watch.h"

#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

const Vec3 kAhead(0.6, 0, 0.8);

/// Returns the events over `duration` [s]. The law's force [N] and the error [m] point in one direction.
template <class Force>
std::vector<Event> watch(HandWatch& hand, double duration, Force force, double error = 3e-3) {
  std::vector<Event> events;
  for (int k = 0; k < std::lround(1000 * duration); ++k)
    if (const auto event = hand.update(force(1e-3 * k) * kAhead, error * kAhead, nan3(), 1e-3))
      events.push_back(*event);
  return events;
}

TEST(HandWatch, ReportsAResistingHandOnce) {
  HandWatch hand({.needed = 2, .resisting = 3, .resist_time = 0.5});
  EXPECT_TRUE(watch(hand, 0.45, [](double) { return 7.0; }).empty());
  const auto events = watch(hand, 5, [](double) { return 7.0; });
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].code, EventCode::hand_resists);
  EXPECT_NEAR(events[0].values[0], 5, 0.1);
  EXPECT_TRUE(hand.resists());
}

TEST(HandWatch, CountsWithHysteresis) {
  HandWatch hand({.needed = 2, .resisting = 3, .resist_time = 0.5});
  EXPECT_EQ(watch(hand, 1, [](double) { return 7.0; }).size(), 1U);
  EXPECT_TRUE(watch(hand, 1, [](double) { return 4.0; }).empty()) << "the count continues above half of the force";
  EXPECT_TRUE(hand.resists());
  EXPECT_TRUE(watch(hand, 1, [](double) { return 7.0; }).empty());
  (void)watch(hand, 1, [](double) { return 3.0; });
  EXPECT_FALSE(hand.resists());
  EXPECT_EQ(watch(hand, 1, [](double) { return 7.0; }).size(), 1U);
}

TEST(HandWatch, KeepsCountingWhileTheHandEasesALittle) {
  HandWatch hand({.needed = 2, .resisting = 3, .resist_time = 0.5});
  EXPECT_TRUE(watch(hand, 0.3, [](double) { return 7.0; }).empty());
  EXPECT_EQ(watch(hand, 0.5, [](double) { return 4.0; }).size(), 1U);
}

TEST(HandWatch, IgnoresTheNeededForceTremorAndPushesAhead) {
  HandWatch hand, trembling, ahead;
  EXPECT_TRUE(watch(hand, 5, [](double) { return 4.5; }).empty());
  const auto tremor = [](double t) { return 2 + 4 * std::sin(2 * std::numbers::pi * 8 * t); };
  EXPECT_TRUE(watch(trembling, 5, tremor).empty());
  EXPECT_TRUE(watch(
                  ahead, 5, [](double) { return 8.0; }, -3e-3)
                  .empty())
      << "the force leads away from the reference";
}

TEST(HandWatch, TrustsADisturbanceEstimateMoreThanTheForce) {
  HandWatch hand;
  int events = 0;
  for (int k = 0; k < 2000; ++k)
    if (hand.update(9 * kAhead, 3e-3 * kAhead, -1 * kAhead, 1e-3)) ++events;
  EXPECT_EQ(events, 0);
  for (int k = 0; k < 2000; ++k)
    if (hand.update(Vec3::Zero(), 3e-3 * kAhead, -7 * kAhead, 1e-3)) ++events;
  EXPECT_EQ(events, 1);
}

TEST(HandWatch, ReportsAHandThatLetsGoButNotOneThatYieldsSlowly) {
  HandWatch hand({.resisting = 100});
  (void)watch(hand, 1, [](double) { return 6.0; });
  const auto events = watch(hand, 2, [](double) { return 0.5; });
  ASSERT_EQ(events.size(), 1U);
  EXPECT_EQ(events[0].code, EventCode::hand_let_go);
  EXPECT_NEAR(events[0].values[1], 6, 1);
  EXPECT_GT(events[0].values[0], 3.5);

  HandWatch slow({.resisting = 100});
  (void)watch(slow, 1, [](double) { return 6.0; });
  EXPECT_TRUE(watch(slow, 2, [](double t) { return std::max(0.5, 6 - 6 * t); }).empty());
}

TEST(HandWatch, ReportsNoReleaseWithoutALoad) {
  HandWatch hand({.resisting = 100});
  EXPECT_TRUE(watch(hand, 2, [](double t) { return t < 0.1 ? 8.0 : 0.0; }).empty()) << "a jolt";
  EXPECT_TRUE(watch(hand, 2, [](double t) { return t < 1 ? 2.0 : 0.0; }).empty()) << "a light hand";
}

TEST(HandWatch, IgnoresValuesThatAreNotFinite) {
  HandWatch hand;
  (void)watch(hand, 1, [](double) { return 7.0; });
  EXPECT_FALSE(hand.update(nan3(), Vec3::Zero(), nan3(), 1e-3));
  EXPECT_FALSE(hand.update(Vec3::Zero(), nan3(), nan3(), 1e-3));
  EXPECT_TRUE(hand.resists());
  const auto events = watch(hand, 1, [](double) { return 0.0; });
  ASSERT_EQ(events.size(), 1U) << "the load is still known";
  EXPECT_EQ(events[0].code, EventCode::hand_let_go);
}

TEST(HandWatch, ForgetsTheLoadOnRequest) {
  HandWatch hand({.resisting = 100});
  (void)watch(hand, 1, [](double) { return 6.0; });
  hand.reset();
  EXPECT_TRUE(watch(hand, 2, [](double) { return 0.5; }).empty()) << "the hand did not let go";
}

TEST(HandWatch, NamesTheOptionThatIsWrong) {
  const auto error_of = [](const HandWatchOptions& options) { return test::error_of([&] { validate(options); }); };
  EXPECT_EQ(error_of({}), "no error");
  EXPECT_THAT(error_of({.needed = -1}), testing::HasSubstr("the needed force [N] is -1"));
  EXPECT_THAT(error_of({.held = kNaN}), testing::HasSubstr("the load that the hand can let go [N] is nan"));
}

}  // namespace
}  // namespace haptrace
