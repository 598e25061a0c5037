#include "control/limits.h"

#include "control/budgets.h"
#include "control/resistance_timer.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

/// Limits `force` and lets the result act for `dt` [s]. Returns the result.
ForceLimiter::Result sent(ForceLimiter& limiter, const Vec3& force, double dt = 1e-3) {
  const ForceLimiter::Result result = limiter.limit(force);
  limiter.acted(result.force, dt);
  return result;
}

TEST(ForceLimiter, NeverExceedsThePeakAndKeepsTheDirection) {
  ForceLimiter limiter({.max_force = 5});
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> exponent(-300, 300), sign(-1, 1);
  for (int i = 0; i < 10000; ++i) {
    const Vec3 asked = std::pow(10, exponent(random)) * Vec3(sign(random), sign(random), sign(random));
    const auto result = limiter.limit(asked);
    EXPECT_LE(result.force.norm(), 5 * (1 + 1e-12));
    EXPECT_GE(result.force.stableNormalized().dot(asked.stableNormalized()), 1 - 1e-9);
  }
}

TEST(ForceLimiter, LeavesSmallForcesAlone) {
  ForceLimiter limiter({.max_force = 5, .max_continuous_force = 2});
  const auto result = limiter.limit(Vec3(1, -1, 0.5));
  EXPECT_EQ(result.force, Vec3(1, -1, 0.5));
  EXPECT_EQ(result.verdict, ForceLimiter::Verdict::free);
}

TEST(ForceLimiter, SettlesAtTheContinuousForceUnderAConstantDemand) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  EXPECT_NEAR(sent(limiter, Vec3(8, 0, 0)).force.norm(), 8, 1e-12);
  ForceLimiter::Result result{};
  for (int i = 0; i < 100000; ++i) result = sent(limiter, Vec3(8, 0, 0));
  EXPECT_LE(result.force.norm(), 3.05);
  EXPECT_GE(result.force.norm(), 2.4);
  EXPECT_EQ(result.verdict, ForceLimiter::Verdict::continuous);
}

TEST(ForceLimiter, AllowsShortPeaksFarAboveTheContinuousForce) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  for (int i = 0; i < 500; ++i) EXPECT_NEAR(sent(limiter, Vec3(0, 8, 0)).force.norm(), 8, 1e-12);
}

TEST(ForceLimiter, RecoversAtRest) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 1});
  for (int i = 0; i < 20000; ++i) (void)sent(limiter, Vec3(8, 0, 0));
  for (int i = 0; i < 10000; ++i) (void)sent(limiter, Vec3::Zero());
  EXPECT_EQ(limiter.allowed(), 8);
}

TEST(ForceLimiter, ContinuesWithTheHeatThatEarlierForcesLeft) {
  const SafetyLimits limits{.max_force = 8, .max_continuous_force = 3, .continuous_time = 10};
  ForceLimiter first(limits), next(limits), cold(limits);
  for (int i = 0; i < 5000; ++i) (void)sent(first, Vec3(8, 0, 0));
  EXPECT_LT(first.allowed(), 5);
  next.warm(first.mean_square(), 2);
  first.acted(Vec3::Zero(), 2);
  EXPECT_NEAR(next.allowed(), first.allowed(), 1e-9);
  EXPECT_LT(next.allowed(), cold.allowed());
  next.warm(first.mean_square(), 1e3);
  EXPECT_EQ(next.allowed(), cold.allowed()) << "after a long rest";
}

TEST(ForceLimiter, CountsTheTimeForWhichAForceActsAndNotTheNumberOfCalls) {
  for (const double dt : {1e-4, 1e-3, 3e-3, 0.05}) {
    ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
    double full = 0;
    while (sent(limiter, Vec3(8, 0, 0), dt).force.norm() > 7.99) full += dt;
    EXPECT_NEAR(full, 10 * std::log(1 / (1 - 0.64 * 9 / 64)), dt + 0.02) << dt;
  }
}

TEST(ForceLimiter, LetsThePeakLastForASecondUnderTheCautiousLimitAndIsNearItAfterFive) {
  ForceLimiter limiter(
      {.max_force = 10, .max_continuous_force = 10 * kCautiousShare, .continuous_time = kCautiousTime});
  double t = 0;
  const auto force_at = [&](double until) {
    double force = 0;
    for (; t < until; t += 1e-3) force = sent(limiter, Vec3(10, 0, 0)).force.norm();
    return force;
  };
  EXPECT_NEAR(force_at(1.1), 10, 1e-9);
  EXPECT_LT(force_at(2.6), 1.5 * 3.05);
  EXPECT_LT(force_at(4.7), 1.1 * 3.05);
}

TEST(ForceLimiter, ReportsWhenItHoldsBackTheForce) {
  ForceLimiter both({.max_force = 8, .max_continuous_force = 3}), peak({.max_force = 8});
  EXPECT_FALSE(both.holds_back(both.limit(Vec3(9, 0, 0)))) << "the peak is allowed for a moment";
  both.acted(Vec3(8, 0, 0), 100);
  EXPECT_TRUE(both.holds_back(both.limit(Vec3(9, 0, 0))));
  EXPECT_FALSE(both.holds_back(both.limit(Vec3(1, 0, 0))));
  EXPECT_TRUE(peak.holds_back(peak.limit(Vec3(9, 0, 0))));
}

TEST(ResistanceTimer, ExpiresAfterTheLimitsActedForItsDuration) {
  ResistanceTimer timer;
  using Verdict = ResistanceTimer::Verdict;
  int begins = 0;
  double t = 0;
  for (Verdict verdict = Verdict::none; verdict != Verdict::over && t < 60; t += 1e-3) {
    verdict = timer.update(true, 15, 1e-3);
    begins += verdict == Verdict::begins ? 1 : 0;
  }
  EXPECT_NEAR(t, 15, 0.01);
  EXPECT_EQ(begins, 1);
}

TEST(ResistanceTimer, IsNotResetByShaking) {
  ResistanceTimer timer;
  double t = 0;
  // The device is held back half of the time.
  while (t < 200 && timer.update(std::fmod(t, 0.2) < 0.1, 15, 1e-3) != ResistanceTimer::Verdict::over) t += 1e-3;
  EXPECT_NEAR(t, 60, 1);
  ResistanceTimer seldom;
  for (int k = 0; k < 200'000; ++k) ASSERT_NE(seldom.update(k % 100 < 30, 15, 1e-3), ResistanceTimer::Verdict::over);
}

TEST(ResistanceTimer, CountsNothingWithoutALimitAndLittleOfAStall) {
  ResistanceTimer timer;
  for (int k = 0; k < 100'000; ++k) ASSERT_EQ(timer.update(true, 0, 1e-3), ResistanceTimer::Verdict::none);
  (void)timer.update(true, 15, 3600);
  EXPECT_LE(timer.count(), ResistanceTimer::kLongestStep);
}

TEST(MotorBudget, WarnsOnceBeforeForceIsTakenAndAgainAfterCooling) {
  ForceLimiter limiter({.max_force = 8, .max_continuous_force = 3, .continuous_time = 10});
  MotorBudget budget;
  double told = kNaN, told_left = 0, limited = kNaN;
  const auto run = [&](double force, double duration) {
    int events = 0;
    for (int k = 0; k < std::lround(1000 * duration); ++k) {
      const auto result = sent(limiter, Vec3(force, 0, 0));
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
  EXPECT_EQ(run(2.1, 60), 0) << "no warning of a force that can last for ever";
  EXPECT_EQ(run(8, 60), 1);
  EXPECT_LT(told, limited);
  EXPECT_NEAR(told + told_left, limited, 0.01) << "the time left is right";
  EXPECT_EQ(run(0, 60), 0);
  EXPECT_EQ(run(8, 10), 1);
}

TEST(MotorBudget, ReportsNothingWithoutAContinuousLimit) {
  ForceLimiter limiter({.max_force = 8});
  MotorBudget budget;
  for (int k = 0; k < 100000; ++k) {
    (void)sent(limiter, Vec3(8, 0, 0));
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

TEST(SafetyLimits, NameAnInvalidLimit) {
  const auto error_of = [](const SafetyLimits& limits) { return test::error_of([&] { validate(limits); }); };
  EXPECT_EQ(error_of({}), "no error");
  EXPECT_THAT(error_of({.max_force = -1}), testing::HasSubstr("the force limit [N] is -1"));
  EXPECT_THAT(error_of({.max_velocity = kNaN}), testing::HasSubstr("the velocity limit [m/s] is nan"));
  EXPECT_THAT(error_of({.continuous_time = 0}), testing::HasSubstr("must be above 0"));
}

}  // namespace
}  // namespace haptrace
