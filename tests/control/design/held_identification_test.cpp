#include "control/design/identification.h"
#include "tests/control/design/held_bench.h"

#include <cmath>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

/// Returns the mean of ln(found / truth) over the axes.
double log_error(const std::array<HandModel, 3>& found, double HandModel::*member, const Vec3& truth) {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) sum += std::log(found[static_cast<std::size_t>(axis)].*member / truth[axis]);
  return sum / 3;
}

TEST(HeldIdentification, FindsWholeDelaysAndTheLag) {
  for (int delay = 1; delay <= 8; ++delay) {
    HeldBench bench;
    bench.delay = delay;
    bench.seed = static_cast<unsigned>(delay);
    const HeldIdentification found = bench.identified();
    EXPECT_NEAR(HeldBench::kServoRate * found.held.delay, delay, 1e-6);
    EXPECT_NEAR(found.held.lag, bench.lag, 0.2e-3) << delay;
  }
}

TEST(HeldIdentification, FindsTheLagOfFastAndSlowMotors) {
  for (const double lag : {0.2e-3, 1e-3}) {
    HeldBench bench;
    bench.delay = 2;
    bench.lag = lag;
    const HeldIdentification found = bench.identified();
    EXPECT_NEAR(HeldBench::kServoRate * (found.held.delay + found.held.lag), HeldBench::kServoRate * (2e-3 + lag), 0.2)
        << lag;
  }
}

TEST(HeldIdentification, FindsTheHandAndTheMassOfTheDeviceInIt) {
  struct Case {
    Vec3 hand, grip, damping;
  };
  for (const Case& c :
       {Case{{0.15, 0.18, 0.14}, {800, 700, 900}, {4, 5, 4}}, Case{{0.08, 0.08, 0.1}, {500, 600, 500}, {4, 3, 4}},
        Case{{0.3, 0.35, 0.3}, {2000, 1800, 2200}, {10, 9, 12}}}) {
    HeldBench bench;
    bench.hand = c.hand;
    bench.grip = c.grip;
    bench.grip_damping = c.damping;
    const HeldIdentification found = bench.identified(8);
    SCOPED_TRACE(c.hand.x());
    ASSERT_TRUE(found.held.held());
    EXPECT_FALSE(found.held.flexible());
    EXPECT_GT(found.margin, 10);
    EXPECT_LT(std::abs(log_error(found.held.hand, &HandModel::mass, c.hand)), 0.25);
    EXPECT_LT(std::abs(log_error(found.held.hand, &HandModel::grip_stiffness, c.grip)), 0.25);
    EXPECT_LT(std::abs(log_error(found.held.hand, &HandModel::grip_damping, c.damping)), 0.25);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(found.held.mass[axis], bench.apparent_mass()[axis], 0.06 * bench.apparent_mass()[axis]);
  }
}

TEST(HeldIdentification, FindsALightDeviceInAHandOfTwiceItsMass) {
  HeldBench bench;
  bench.with_mass(0.06 * Eigen::Matrix3d::Identity());
  bench.viscous = 0.15;
  bench.coulomb = 0.05;
  bench.excitation = 0.4;
  const HeldIdentification found = bench.identified(8);
  ASSERT_TRUE(found.held.held());
  EXPECT_LT(std::abs(log_error(found.held.hand, &HandModel::mass, bench.hand)), 0.25);
  EXPECT_LT(std::abs(log_error(found.held.hand, &HandModel::grip_stiffness, bench.grip)), 0.25);
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(found.held.mass[axis], 0.06, 0.1 * 0.06);
}

TEST(HeldIdentification, NoticesThatNobodyHolds) {
  HeldBench bench;
  bench.holds = false;
  const HeldIdentification found = bench.identified();
  EXPECT_FALSE(found.held.held());
  EXPECT_FALSE(found.held.flexible());
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(found.held.mass[axis], bench.apparent_mass()[axis], 0.06 * bench.apparent_mass()[axis]);
}

TEST(HeldIdentification, FindsALinkThatSwings) {
  HeldBench bench;
  bench.with_mass(0.0225 * Eigen::Matrix3d::Identity());
  bench.link = {.mass = 0.0225, .stiffness = 1110, .damping = 0.7};
  bench.viscous = 0.2;
  bench.coulomb = 0.05;
  bench.excitation = 0.4;
  bench.holds = false;
  const HeldIdentification found = bench.identified();
  ASSERT_TRUE(found.held.flexible());
  EXPECT_FALSE(found.held.held());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(found.held.mass[static_cast<int>(axis)], 0.0225, 0.06 * 0.0225);
    const double anti_resonance =
        std::sqrt(found.held.link[axis].stiffness / found.held.link[axis].mass) / HeldBench::kFullTurn;
    EXPECT_NEAR(anti_resonance, std::sqrt(1110 / 0.0225) / HeldBench::kFullTurn, 2);
  }
  EXPECT_NEAR(HeldBench::kServoRate * found.held.delay, 1, 1e-6);
  EXPECT_NEAR(found.held.lag, bench.lag, 0.2e-3);
}

TEST(HeldIdentification, ModelsNothingWhenTheDeviceDoesNotRespond) {
  HeldBench bench;
  (void)bench.identified();
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 1e-3);
  for (TickRow& row : bench.rows) row.position = Vec3(normal(random), normal(random), normal(random));
  const HeldIdentification found = bench.held();
  EXPECT_TRUE(found.held.mass.isZero(0));
  EXPECT_FALSE(found.held.held());
  EXPECT_EQ(found.margin, 0);
}

}  // namespace
}  // namespace haptrace
