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

State at(double height, double speed = 0) {
  return {.dt = kDt, .position = height * kUp + Vec3(0.01, 0, 0), .velocity = speed * kUp};
}

/// Returns a support that has risen.
ArmSupport risen(const ArmSupport::Options& options) {
  ArmSupport support(options);
  for (int i = 0; i < 2100; ++i) (void)support.update(at(0), true);
  return support;
}

TEST(ArmSupport, RisesOverTwoSecondsAndFallsOverHalfASecondWithoutAStep) {
  ArmSupport support({.force = 3, .up = kUp, .top = 0.1, .fade = 0.02});
  Vec3 last = Vec3::Zero();
  for (int i = 1; i <= 4000; ++i) {
    const std::size_t before = test::allocations();
    const Vec3 force = support.update(at(0), i <= 3000);
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
  ArmSupport support = risen({.force = 3, .up = kUp, .top = 0.1, .fade = 0.02});
  for (const double speed : {-2.0, -0.2, 0.0, 0.24}) EXPECT_NEAR(support.update(at(0, speed), true).norm(), 3, 1e-9);
  State sideways = at(0);
  sideways.velocity = Vec3(2, 0, 0);
  EXPECT_NEAR(support.update(sideways, true).norm(), 3, 1e-9);
  EXPECT_NEAR(support.update(at(0, 0.5), true).norm(), 1.5, 1e-9);
  EXPECT_EQ(support.update(at(0, 0.76), true).norm(), 0);
  EXPECT_NEAR(support.update(at(0.09), true).norm(), 1.5, 1e-9) << "half of the way on which it ends";
  EXPECT_EQ(support.update(at(0.11), true).norm(), 0);
  EXPECT_NEAR(support.update(at(0.11, 0.1), true).dot(kUp), -0.5, 1e-9) << "a rise is damped there";
  EXPECT_EQ(support.update(at(0.11, -0.1), true).norm(), 0);
}

TEST(ArmSupport, SendsNothingForAStaleState) {
  ArmSupport support = risen({.force = 3, .up = kUp, .top = 0.1, .fade = 0.02});
  State stale = at(0);
  stale.dt = 0;
  EXPECT_EQ(support.update(stale, true).norm(), 0);
  stale = at(0);
  stale.position.x() = kNaN;
  EXPECT_EQ(support.update(stale, true).norm(), 0);
  stale = at(0);
  stale.velocity.z() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(support.update(stale, true).norm(), 0);
  support.begin();
  EXPECT_LT(support.update(at(0), true).norm(), 0.01) << "it rises anew";
}

TEST(ArmSupport, GivesAtMostItsForceTimesTheWayToTheTop) {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < 50; ++trial) {
    ArmSupport support = risen({.force = 4, .up = kUp, .top = 0.08, .fade = 0.03});
    // A hand that moves up and down, fast and slowly, 80 mm to both sides.
    const double f = std::uniform_real_distribution(0.2, 6.0)(random),
                 g = std::uniform_real_distribution(0.2, 6.0)(random);
    double given = 0, most = 0, height = 0;
    Vec3 force = support.update(at(0), true);
    for (int i = 1; i < 20'000; ++i) {
      const double next = 0.05 * std::sin(f * i * kDt * 6) + 0.03 * std::sin(g * i * kDt * 6);
      given += force.dot((next - height) * kUp);
      most = std::max(most, given);
      force = support.update(at(next, (next - height) / kDt), true);
      height = next;
    }
    EXPECT_LE(most, 4 * 0.16 + 1e-3);
    EXPECT_LE(given, 4 * (0.08 - 0 + 0.08)) << "no energy without end";
  }
}

TEST(ArmSupport, GivesALightHandleThatNobodyHoldsNoSpeedAndNoPushAgainstTheTop) {
  for (const double mass : {0.05, 0.1, 0.2})
    for (const double late : {1.0, 5.0}) {
      ArmSupport support({.force = 3, .up = kUp, .top = 0.05, .fade = 0.02});
      // The velocity is that of `late` ticks ago, as a delayed device states it.
      std::vector<double> speeds{0};
      double height = -0.05, speed = 0, fastest = 0;
      for (int i = 0; i < 8000; ++i) {
        const auto seen = static_cast<std::size_t>(std::max(0.0, static_cast<double>(speeds.size()) - 1 - late));
        const double force = support.update(at(height, speeds[seen]), true).dot(kUp);
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
  EXPECT_THAT(error_of([] { ArmSupport({.force = 1, .fade = 0}); }), HasSubstr("the way over which"));
}

}  // namespace
}  // namespace haptrace
