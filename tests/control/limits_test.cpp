#include "control/limits.h"

#include "control/budgets.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

TEST(ForceLimiter, NeverExceedsThePeakAndKeepsTheDirection) {
  ForceLimiter limiter({.max_force = 5});
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> exponent(-300, 300), sign(-1, 1);
  for (int i = 0; i < 10000; ++i) {
    const Vec3 asked = std::pow(10, exponent(random)) * Vec3(sign(random), sign(random), sign(random));
    const auto result = limiter.limit(asked, 1e-3);
    EXPECT_LE(result.force.norm(), 5 * (1 + 1e-12));
    EXPECT_GE(result.force.stableNormalized().dot(asked.stableNormalized()), 1 - 1e-9);
  }
}

TEST(ForceLimiter, LeavesSmallForcesAlone) {
  ForceLimiter limiter({.max_force = 5, .max_continuous_force = 2});
  const auto result = limiter.limit(Vec3(1, -1, 0.5), 1e-3);
  EXPECT_EQ(result.force, Vec3(1, -1, 0.5));
  EXPECT_EQ(result.verdict, ForceLimiter::Verdict::free);
}

TEST(ForceLimiter, SettlesAtTheContinuousForceUnderADemandThatStays) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  EXPECT_NEAR(limiter.limit(Vec3(8, 0, 0), 1e-3).force.norm(), 8, 1e-12);
  ForceLimiter::Result result{};
  for (int i = 0; i < 100000; ++i) result = limiter.limit(Vec3(8, 0, 0), 1e-3);
  EXPECT_LE(result.force.norm(), 3.05);
  EXPECT_GE(result.force.norm(), 2.4);
  EXPECT_EQ(result.verdict, ForceLimiter::Verdict::continuous);
}

TEST(ForceLimiter, BearsShortPeaksFarAboveTheContinuousForce) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  for (int i = 0; i < 500; ++i) EXPECT_NEAR(limiter.limit(Vec3(0, 8, 0), 1e-3).force.norm(), 8, 1e-12);
}

TEST(ForceLimiter, RecoversAtRest) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 1});
  for (int i = 0; i < 20000; ++i) (void)limiter.limit(Vec3(8, 0, 0), 1e-3);
  for (int i = 0; i < 10000; ++i) (void)limiter.limit(Vec3::Zero(), 1e-3);
  EXPECT_EQ(limiter.allowed(), 8);
}

TEST(MotorBudget, WarnsOnceBeforeForceIsTakenAndAgainAfterCooling) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  MotorBudget budget;
  double told = kNaN, told_left = 0, limited = kNaN;
  const auto run = [&](double force, double duration) {
    int events = 0;
    for (int k = 0; k < std::lround(1000 * duration); ++k) {
      const auto result = limiter.limit(Vec3(force, 0, 0), 1e-3);
      if (result.verdict == ForceLimiter::Verdict::continuous && std::isnan(limited)) limited = 1e-3 * k;
      const auto event = budget.update(limiter, result.force.norm());
      if (!event) continue;
      ++events;
      EXPECT_EQ(event->code, EventCode::warming);
      EXPECT_NEAR(event->values[0], MotorBudget::kWarnAt, 0.01);
      told = 1e-3 * k;
      told_left = event->values[1];
    }
    return events;
  };
  EXPECT_EQ(run(2.1, 60), 0) << "what can last for ever is not told";
  EXPECT_EQ(run(8, 60), 1);
  EXPECT_LT(told, limited);
  EXPECT_NEAR(told + told_left, limited, 0.01) << "the time left is right";
  EXPECT_TRUE(budget.warm());
  EXPECT_EQ(run(0, 60), 0);
  EXPECT_FALSE(budget.warm());
  EXPECT_EQ(run(8, 10), 1);
}

TEST(MotorBudget, HasNothingToTellWithoutAContinuousLimit) {
  ForceLimiter limiter({.max_force = 8});
  MotorBudget budget;
  for (int k = 0; k < 100000; ++k) {
    (void)limiter.limit(Vec3(8, 0, 0), 1e-3);
    ASSERT_FALSE(budget.update(limiter, 8));
  }
  EXPECT_EQ(limiter.time_left(8), std::numeric_limits<double>::infinity());
}

TEST(Ramp, TakesItsTimeAndStaysInside) {
  Ramp ramp;
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(ramp.advance(1, 0.1, 1), 0.1 * (i + 1), 1e-12);
  EXPECT_EQ(ramp.advance(1, 10, 1), 1);
  EXPECT_EQ(ramp.advance(0, 1, 0), 0) << "no duration is a jump";
  EXPECT_EQ(ramp.advance(0, 1, 1), 0);
}

TEST(SafetyLimits, NameTheOneThatIsWrong) {
  const auto error_of = [](const SafetyLimits& limits) { return test::error_of([&] { validate(limits); }); };
  EXPECT_EQ(error_of({}), "no error");
  EXPECT_THAT(error_of({.max_force = -1}), testing::HasSubstr("the force limit [N] is -1"));
  EXPECT_THAT(error_of({.max_velocity = kNaN}), testing::HasSubstr("the velocity limit [m/s] is nan"));
  EXPECT_THAT(error_of({.continuous_time = 0}), testing::HasSubstr("must be above 0"));
}

}  // namespace
}  // namespace haptrace
