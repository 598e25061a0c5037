// The support of an arm: how it comes and goes, and that an empty handle gets neither speed nor energy without end.
#include "control/arm_support.h"

#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>
#include <vector>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

constexpr double kDt = 1e-3;  // [s]
const Vec3 kUp = Vec3(0, 0.6, 0.8);
constexpr double kForce = 3;  // [N]

State at(double height, double speed = 0) {
  return {.dt = kDt, .position = height * kUp + Vec3(0.01, 0, 0), .velocity = speed * kUp};
}

/// Returns a support that has risen.
ArmSupport risen(const ArmSupport::Options& options) {
  ArmSupport support(options);
  for (int i = 0; i < 2100; ++i) (void)support.update(at(0), true, options.force);
  return support;
}

TEST(ArmSupport, RisesOverTwoSecondsAndFallsOverHalfASecondWithoutAStep) {
  ArmSupport support({.force = kForce, .up = kUp, .top = 0.1, .stiffness = 150});
  Vec3 last = Vec3::Zero();
  for (int i = 1; i <= 4000; ++i) {
    const std::size_t before = test::allocations();
    const Vec3 force = support.update(at(0), i <= 3000, kForce);
    ASSERT_EQ(test::allocations(), before);
    ASSERT_LE((force - last).norm(), 0.0061) << i;
    if (i == 1000 || i == 3250) {
      EXPECT_NEAR(force.dot(kUp), 1.5, 0.01);
    }
    if (i == 2500) {
      EXPECT_TRUE(force.isApprox(3 * kUp, 1e-9)) << "along the direction upwards";
    }
    last = force;
  }
  EXPECT_EQ(last.norm(), 0);
}

TEST(ArmSupport, CarriesAHandThatMovesDownOrSidewaysOrSlowlyUp) {
  ArmSupport support = risen({.force = kForce, .up = kUp, .top = 0.1, .stiffness = 150});
  for (const double speed : {-2.0, -0.2, 0.0, 0.24})
    EXPECT_NEAR(support.update(at(0, speed), true, kForce).norm(), 3, 1e-9);
  State sideways = at(0);
  sideways.velocity = Vec3(2, 0, 0);
  EXPECT_NEAR(support.update(sideways, true, kForce).norm(), 3, 1e-9);
  EXPECT_NEAR(support.update(at(0, 0.5), true, kForce).norm(), 1.5, 1e-9);
  EXPECT_EQ(support.update(at(0, 0.76), true, kForce).norm(), 0);
  EXPECT_NEAR(support.update(at(0.09), true, kForce).norm(), 1.5, 1e-9) << "half of the way on which it ends";
  EXPECT_EQ(support.update(at(0.11), true, kForce).norm(), 0);
  EXPECT_NEAR(support.update(at(0.11, 0.1), true, kForce).dot(kUp), -0.5, 1e-9) << "a rise is damped there";
  EXPECT_EQ(support.update(at(0.11, -0.1), true, kForce).norm(), 0);
}

TEST(ArmSupport, FollowsAnotherWishSlowlyAndEndsAsSoftlyAtTheTop) {
  ArmSupport support = risen({.force = kForce, .up = kUp, .top = 0.1, .stiffness = 150});
  double last = kForce;
  for (int i = 1; i <= 2000; ++i) {
    const double force = support.update(at(0), true, 1).dot(kUp);
    ASSERT_NEAR(force, std::max(1.0, kForce - ArmSupport::kSlew * kDt * i), 1e-9) << i;
    ASSERT_LE(std::abs(force - last), ArmSupport::kSlew * kDt + 1e-12);
    last = force;
  }
  EXPECT_EQ(support.force(), 1);
  EXPECT_NEAR(support.update(at(0.1 - 1e-3), true, 1).norm(), 0.15, 1e-9) << "150 N/m";
  EXPECT_EQ(support.update(at(0), true, kNaN).norm(), 1) << "no wish";
  EXPECT_EQ(support.update(at(0), true, -1).norm(), 1);
  for (int i = 0; i < 1000; ++i) (void)support.update(at(0), true, 0);
  EXPECT_EQ(support.update(at(0), true, 0).norm(), 0);
  for (int i = 0; i < 2000; ++i) (void)support.update(at(0), true, kForce);
  EXPECT_NEAR(support.update(at(0), true, kForce).norm(), kForce, 1e-9) << "and back from nothing";
}

TEST(ArmSupport, SendsNothingForAStaleState) {
  ArmSupport support = risen({.force = kForce, .up = kUp, .top = 0.1, .stiffness = 150});
  State stale = at(0);
  stale.dt = 0;
  EXPECT_EQ(support.update(stale, true, kForce).norm(), 0);
  stale = at(0);
  stale.position.x() = kNaN;
  EXPECT_EQ(support.update(stale, true, kForce).norm(), 0);
  stale = at(0);
  stale.velocity.z() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(support.update(stale, true, kForce).norm(), 0);
  support.begin();
  EXPECT_LT(support.update(at(0), true, kForce).norm(), 0.01) << "it rises anew";
}

TEST(ArmSupport, GivesAtMostItsForceTimesTheWayToTheTop) {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 50; ++trial) {
    ArmSupport support = risen({.force = kForce, .up = kUp, .top = 0.08, .stiffness = 100});
    // A hand that moves up and down, fast and slowly, 80 mm to both sides.
    const double f = std::uniform_real_distribution(0.2, 6.0)(random),
                 g = std::uniform_real_distribution(0.2, 6.0)(random);
    double given = 0, most = 0, height = 0;
    Vec3 force = support.update(at(0), true, kForce);
    for (int i = 1; i < 20'000; ++i) {
      const double next = 0.05 * std::sin(f * i * kDt * 6) + 0.03 * std::sin(g * i * kDt * 6);
      given += force.dot((next - height) * kUp);
      most = std::max(most, given);
      force = support.update(at(next, (next - height) / kDt), true, kForce);
      height = next;
    }
    EXPECT_LE(most, kForce * 0.16 + 1e-3);
    EXPECT_LE(given, kForce * (0.08 - 0 + 0.08)) << "no energy without end";
  }
}

TEST(ArmSupport, GivesALightHandleThatNobodyHoldsNoSpeedAndNoPushAgainstTheTop) {
  for (const double mass : {0.05, 0.1, 0.2})
    for (const double late : {1.0, 5.0}) {
      ArmSupport support({.force = kForce, .up = kUp, .top = 0.05, .stiffness = 150});
      // The velocity is that of `late` ticks ago, as a delayed device states it.
      std::vector<double> speeds{0};
      double height = -0.05, speed = 0, fastest = 0;
      for (int i = 0; i < 8000; ++i) {
        const auto seen = static_cast<std::size_t>(std::max(0.0, static_cast<double>(speeds.size()) - 1 - late));
        const double force = support.update(at(height, speeds[seen]), true, kForce).dot(kUp);
        speed += kDt * (force - 0.2 * speed) / mass;
        height += kDt * speed;
        speeds.push_back(speed);
        fastest = std::max(fastest, speed);
      }
      EXPECT_NEAR(speed, 0, 1e-2) << "it comes to rest";
      EXPECT_LT(fastest, ArmSupport::kFastest) << mass << " kg, " << late << " ticks";
      EXPECT_LE(height, 0.05 + 0.06) << mass << " kg, " << late << " ticks";
    }
}

TEST(ArmSupport, RejectsValuesOutOfRange) {
  EXPECT_THAT(error_of([] { ArmSupport({.force = -1}); }), HasSubstr("the support of the arm"));
  EXPECT_THAT(error_of([] { ArmSupport({.force = kNaN}); }), HasSubstr("the support of the arm"));
  EXPECT_THAT(error_of([] { ArmSupport({.force = 1, .up = Vec3(0, 2, 0)}); }), HasSubstr("direction upwards"));
  EXPECT_THAT(error_of([] { ArmSupport({.force = 1, .stiffness = 0}); }), HasSubstr("the stiffness of the end"));
}

}  // namespace
}  // namespace haptrace
