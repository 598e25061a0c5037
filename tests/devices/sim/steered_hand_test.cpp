// Tests of the simulated hand that a person steers.
#include "devices/sim/hand_steering.h"
#include "devices/sim/presets.h"
#include "devices/sim/sim_device.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;  // [ns]
constexpr double kTick = 1e-3;           // [s]

std::int64_t clock_now = kMs;  // of the tests

/// Moves a steered hand that nothing holds for `seconds`, and visits it after every millisecond.
template <class Visit>
void pass(SteeredHand& hand, const HandIntention& newest, double seconds, const Visit& visit) {
  for (int i = 0; i < std::lround(seconds / kTick); ++i) {
    clock_now += kMs;
    hand.update(newest, clock_now, Vec3::Zero(), kTick);
    visit(hand);
  }
}

HandIntention at(const Vec3& place, double grip = 1) {
  return {.position = place, .grip = grip, .time_ns = clock_now};
}

TEST(SteeredHand, TakesHoldWhereItIsAndFollowsAStepLikeALowPassOfFiveHertz) {
  SteeredHand hand;
  double after = 0, before = 0, largest_step = 0;
  for (int i = 0; i < 300; ++i)
    pass(hand, at(Vec3(0.1, 0, 0)), kTick, [&](const SteeredHand& now) {
      EXPECT_GE(now.position().x(), before) << "no overshoot";
      EXPECT_LE(now.position().x(), 0.1);
      largest_step = std::max(largest_step, now.position().x() - before);
      before = now.position().x();
      if (i == 79) after = before;
    });
  EXPECT_NEAR(after, 0.09, 0.002) << "90 % after 80 ms";
  EXPECT_LT(largest_step, 0.1 * 48.8 * kTick / std::numbers::e * 1.01) << "its peak speed is w / e per metre";
  EXPECT_NEAR(before, 0.1, 1e-4);
  EXPECT_EQ(hand.grip(), 1);
}

TEST(SteeredHand, PassesHalfThePowerOfAMovementOfFiveHertz) {
  SteeredHand hand;
  double most = 0;
  for (int i = 0; i < 3000; ++i) {
    const double angle = 2 * std::numbers::pi * SteeredHand::kBandwidth * kTick * i;
    pass(hand, at(Vec3(std::sin(angle), 0, 0)), kTick, [&](const SteeredHand& now) {
      if (i > 1000) most = std::max(most, now.position().x());
    });
  }
  EXPECT_NEAR(most, std::sqrt(0.5), 0.02);
}

TEST(SteeredHand, LetsGoWithinThreeTenthsOfASecondOfSilence) {
  SteeredHand hand;
  const HandIntention last = at(Vec3(0.05, 0, 0), 0.8);
  pass(hand, last, 0.2, [](const SteeredHand&) {});
  EXPECT_NEAR(hand.grip(), 0.8, 1e-9) << "nothing is wrong yet";
  pass(hand, last, 0.1, [](const SteeredHand&) {});
  EXPECT_EQ(hand.grip(), 0);
  pass(hand, at(Vec3(0.05, 0, 0), 0.8), 0.1, [](const SteeredHand&) {});
  EXPECT_NEAR(hand.grip(), 0.8, 1e-9) << "it takes hold again";
}

TEST(SteeredHand, HoldsNothingBeforeTheFirstIntention) {
  SteeredHand hand;
  pass(hand, {}, 0.5, [](const SteeredHand& now) { EXPECT_EQ(now.grip(), 0); });
}

TEST(SteeredHand, IgnoresAnIntentionThatIsNotFinite) {
  SteeredHand hand;
  pass(hand, at(Vec3(0.05, 0, 0)), 0.15, [](const SteeredHand&) {});
  for (const HandIntention& bad : {at(Vec3(kNaN, 0, 0)), at(Vec3(0, INFINITY, 0)), at(Vec3::Zero(), kNaN)})
    pass(hand, bad, 0.03, [](const SteeredHand& now) {
      EXPECT_TRUE(is_finite(now.position()));
      EXPECT_EQ(now.grip(), 1) << "the last valid one counts until it is stale";
    });
  pass(hand, at(Vec3(kNaN, 0, 0)), 0.3, [](const SteeredHand&) {});
  EXPECT_EQ(hand.grip(), 0) << "an invalid intention keeps nothing alive";
}

/// A simulated device whose hand the test steers, on a clock of the test.
class SteeredDevice : public testing::Test {
 protected:
  void exchange(double seconds, const Vec3& force = Vec3::Zero()) {
    for (int i = 0; i < std::lround(seconds / kTick); ++i) {
      clock_now += kMs;
      DeviceState state;
      ASSERT_EQ(device_.exchange({force, Vec3::Zero()}, kTick, state), Device::Status::ok);
      const Vec3 step = device_.true_velocity() - velocity_;
      velocity_ = device_.true_velocity();
      jerkiest_ = std::max(jerkiest_, step.norm());
    }
  }

  HandSteering steering_;
  SimDevice device_{spec(), options()};
  Vec3 velocity_ = Vec3::Zero();
  double jerkiest_ = 0;  ///< largest change of velocity in a tick [m/s]

 private:
  static SimSpec spec() {
    nlohmann::json json = device_preset("omega3", "test");
    json["hand"] = "relaxed";
    return read_sim_spec(json, "test");
  }
  SimOptions options() {
    SimOptions options;
    options.steering = &steering_;
    options.clock = []() noexcept { return clock_now; };
    return options;
  }
};

TEST_F(SteeredDevice, FollowsThePersonAndDoesNotClaimVirtualTime) {
  EXPECT_FALSE(device_.info().virtual_time);
  EXPECT_EQ(device_.zero_force(), ZeroForce::confirmed);
  exchange(0.2);
  EXPECT_LT(device_.true_position().norm(), 1e-3) << "nobody steers yet";
  for (int i = 0; i < 60; ++i) {
    steering_.post(at(Vec3(0.03, -0.02, 0.01)));
    exchange(0.0167);
  }
  EXPECT_LT((device_.true_position() - Vec3(0.03, -0.02, 0.01)).norm(), 3e-3);
}

TEST_F(SteeredDevice, DoesNotJerkWithTheNoiseAndTheStepsOfAMouse) {
  std::mt19937 random(4);
  std::normal_distribution<double> pixel(0, 2 * 2.5e-4);  // 2 px of 0.25 mm
  for (int i = 0; i < 120; ++i) {
    const double t = i / 60.0;
    steering_.post(at(Vec3(0.04 * std::sin(3 * t) + pixel(random), pixel(random), pixel(random))));
    exchange(0.0167);
  }
  EXPECT_GT(velocity_.norm(), 0.01) << "it moves";
  EXPECT_LT(jerkiest_, 0.01) << "no tick changes the velocity by more than 10 m/s^2";
}

TEST_F(SteeredDevice, HoldsAgainstAForceUntilThePersonIsSilent) {
  const Vec3 force(2, 0, 0);
  for (int i = 0; i < 60; ++i) {
    steering_.post(at(Vec3::Zero()));
    exchange(0.0167, force);
  }
  const double held = device_.true_position().x();
  EXPECT_LT(held, 0.01);
  exchange(0.25, force);
  EXPECT_NEAR(device_.true_position().x(), held, 1e-3) << "not yet stale";
  exchange(0.5, force);
  EXPECT_GT(device_.true_position().x(), held + 0.01) << "a hand that rests yields";
}

TEST_F(SteeredDevice, NeverPullsFarBeyondTheWorkspace) {
  for (int i = 0; i < 60; ++i) {
    steering_.post(at(Vec3(1e6, 0, 0)));
    exchange(0.0167);
  }
  EXPECT_LT(device_.true_position().x(), device_.info().workspace_max.x() + 0.03);
}

TEST_F(SteeredDevice, AllocatesNothingInAnExchange) {
  steering_.post(at(Vec3(0.01, 0, 0)));
  exchange(0.01);
  const std::size_t before = test::allocations();
  DeviceState state;
  for (int i = 0; i < 100; ++i) {
    clock_now += kMs;
    (void)device_.exchange({}, kTick, state);
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(SteeringOf, FindsTheLiveViewsHandByTheDevicesDescription) {
  EXPECT_EQ(steering_of(*open_device("sim:preset=omega3,hand=relaxed,intent=view")), &view_steering());
  EXPECT_EQ(steering_of(*open_device("sim:preset=omega3,intent=view")), &view_steering()) << "held by a relaxed hand";
  EXPECT_EQ(steering_of(*open_device("sim:preset=omega3,hand=relaxed")), nullptr);
  EXPECT_EQ(steering_of(*open_device("sim")), nullptr);
}

TEST(SteeringOf, RefusesWhatAppliesToAPathOnly) {
  EXPECT_THAT(test::error_of([] { (void)open_device("sim:hand=relaxed,intent=view,intent_speed=2"); }),
              HasSubstr("intent_speed applies to the path of a hand"));
  EXPECT_THAT(test::error_of([] { (void)open_device("sim:hand=none,intent=view"); }), HasSubstr("no hand holds"));
}

}  // namespace
}  // namespace haptrace
