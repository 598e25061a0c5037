#include "control/pd.h"

#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

State at(const Vec3& position, const Vec3& velocity) {
  State state;
  state.position = position;
  state.velocity = velocity;
  return state;
}

TEST(PdForce, IsTheFormulaPerAxis) {
  const PdGains gains{Vec3(100, 200, 300), Vec3(1, 2, 3)};
  const Reference reference{Vec3(1, 1, 1), Vec3(0.5, 0.5, 0.5), Vec3::Zero(), 0};
  EXPECT_TRUE(pd_force(gains, at(Vec3(0.9, 1.2, 1), Vec3(0, 0, 1)), reference).isApprox(Vec3(10.5, -39, -1.5), 1e-12));
}

TEST(PdForce, PullsTowardsTheReferenceAndDampsTowardsItsVelocity) {
  const PdGains gains{Vec3::Constant(100), Vec3::Constant(1)};
  const Reference rest{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), 0};
  EXPECT_LT(pd_force(gains, at(Vec3(0.01, 0, 0), Vec3::Zero()), rest).x(), 0);
  EXPECT_LT(pd_force(gains, at(Vec3::Zero(), Vec3(0.01, 0, 0)), rest).x(), 0);
  EXPECT_EQ(pd_force(gains, at(Vec3::Zero(), Vec3::Zero()), rest), Vec3::Zero());
}

TEST(PdGains, NameAnInvalidGain) {
  const auto error_of = [](const PdGains& gains) { return test::error_of([&] { validate(gains); }); };
  EXPECT_EQ(error_of({Vec3::Constant(500), Vec3::Constant(6)}), "no error");
  EXPECT_THAT(error_of({Vec3(500, -1, 500), Vec3::Zero()}), testing::HasSubstr("kp of the y axis is -1"));
  EXPECT_THAT(error_of({Vec3::Zero(), Vec3(0, 0, kNaN)}), testing::HasSubstr("kd of the z axis is nan"));
  EXPECT_THAT(error_of({Vec3::Constant(1e9), Vec3::Zero()}), testing::HasSubstr("from 0 to 100000 N/m"));
}

TEST(CautiousGains, AreThoseOfTheReferenceTaskForAFalconAndShrinkAtSlowRates) {
  const PdGains gains = cautious_gains(8, 1000);
  EXPECT_NEAR(gains.kp.x(), 500, 1e-9);
  EXPECT_NEAR(gains.kd.x(), 6, 1e-9);
  EXPECT_NEAR(cautious_gains(8, 100).kp.x(), 250, 1e-9);
  EXPECT_NEAR(cautious_gains(8, 10).kp.x(), 25, 1e-9);
  EXPECT_NO_THROW(validate(cautious_gains(1e9, 20000)));
}

}  // namespace
}  // namespace haptrace
