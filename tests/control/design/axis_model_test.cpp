#include "control/design/held_model.h"
#include "control/design/riccati.h"
#include "tests/support/errors.h"

#include <cmath>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns an axis with every part.
AxisModel full_axis() {
  return {.mass = 0.2,
          .viscous = 1,
          .delay_ticks = 2.4,
          .lag = 0.5e-3,
          .link = {.mass = 0.1, .stiffness = 4000, .damping = 0.5},
          .hand = {.mass = 0.15, .grip_stiffness = 800, .grip_damping = 4},
          .noise = {.drift = 0.15, .drift_hz = 1, .tremor = 0.04, .tremor_hz = 9},
          .force_noise = 0.01,
          .position_noise = 1e-5,
          .rate_hz = 1000};
}

TEST(AxisModel, MovesAFreeMassAsANewtonianForceDoes) {
  const DiscreteAxis axis = discretised({.mass = 0.5, .delay_ticks = 1.25});
  ASSERT_EQ(axis.states(), 2);
  EXPECT_EQ(axis.delay, 1);
  ASSERT_TRUE(axis.fractional);
  // The older force acts for a quarter of the period, the newer for the remainder.
  const double period = 1e-3, older = 0.25 * period, newer = 0.75 * period;
  EXPECT_NEAR(axis.transition(0, 1), period, 1e-15);
  EXPECT_NEAR(axis.newer[0], newer * newer / 2 / 0.5, 1e-15);
  EXPECT_NEAR(axis.newer[1], newer / 0.5, 1e-15);
  EXPECT_NEAR(axis.older[0], (older * older / 2 + older * newer) / 0.5, 1e-15);
  EXPECT_NEAR(axis.older[1], older / 0.5, 1e-15);
}

TEST(AxisModel, IsTheSameOverTwoHalfPeriodsAsOverOne) {
  AxisModel model = full_axis();
  model.delay_ticks = 0;
  const DiscreteAxis whole = discretised(model);
  model.rate_hz = 2000;
  const DiscreteAxis half = discretised(model);
  ASSERT_EQ(whole.states(), AxisModel::kMostStates);
  const MatrixXd twice = half.transition * half.transition;
  EXPECT_LT((twice - whole.transition).norm(), 1e-10 * whole.transition.norm());
  EXPECT_LT((half.transition * half.newer + half.newer - whole.newer).norm(), 1e-10 * whole.newer.norm());
  const MatrixXd noise = half.transition * half.noise * half.transition.transpose() + half.noise;
  EXPECT_LT((noise - whole.noise).cwiseAbs().maxCoeff(), 1e-10 * whole.noise.cwiseAbs().maxCoeff());
  for (Eigen::Index i = 0; i < whole.states(); ++i)
    EXPECT_NEAR(noise(i, i), whole.noise(i, i), 1e-8 * whole.noise(i, i)) << i;
}

TEST(AxisModel, HasDriftAndTremorOfTheStatedSize) {
  const DiscreteAxis axis = discretised(full_axis());
  const Eigen::Index drift = axis.drift, noises = axis.states() - drift;
  const auto stationary =
      solve_lyapunov(axis.transition.bottomRightCorner(noises, noises), axis.noise.bottomRightCorner(noises, noises));
  ASSERT_TRUE(stationary);
  EXPECT_NEAR(std::sqrt((*stationary)(0, 0)), 0.15, 1e-9);
  EXPECT_NEAR(std::sqrt((*stationary)(1, 1)), 0.04, 1e-9);
}

TEST(AxisModel, StaysWhereAForceBalancesTheDrift) {
  AxisModel model = full_axis();
  model.noise.drift_hz = 1e-6;
  const DiscreteAxis axis = discretised(model);
  const VectorXd moved = axis.transition * axis.balanced - axis.newer - axis.older;
  EXPECT_LT((moved - axis.balanced).cwiseAbs().maxCoeff(), 1e-8);
}

TEST(AxisModel, MovesTogetherWithoutForcesInIt) {
  AxisModel model = full_axis();
  const DiscreteAxis axis = discretised(model);
  EXPECT_LT((axis.transition * axis.together - axis.together).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(AxisModel, TakesTheAxesOfAPlantThatHaveAMass) {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0, 0.3);
  plant.delay = 2.1e-3;
  plant.position_resolution = 6e-5;
  plant.position_noise = 1e-5;
  const auto axes = axis_models(held_model(plant, {.mass = 0.1, .grip_stiffness = 500}), measured_noise(plant), 1000);
  ASSERT_TRUE(axes[0] && axes[2]);
  EXPECT_FALSE(axes[1]);
  EXPECT_EQ(axes[2]->mass, 0.3);
  EXPECT_NEAR(axes[0]->delay_ticks, 1.6, 1e-12);
  EXPECT_EQ(axes[0]->lag, kTypicalLag);
  EXPECT_EQ(axes[0]->hand.mass, 0.1);
  EXPECT_NEAR(axes[0]->position_noise, std::hypot(6e-5 / std::sqrt(12.0), 1e-5), 1e-15);
  plant.delay = 0.2e-3;
  EXPECT_EQ(axis_models(held_model(plant, {}), 0, 1000)[0]->lag, 0.2e-3) << "a lag is part of the delay";
}

TEST(AxisModel, NamesAParameterThatIsOutOfRange) {
  AxisModel model = full_axis();
  model.mass = 0;
  EXPECT_NE(test::error_of([&] { (void)discretised(model); }).find("the mass"), std::string::npos);
  model = full_axis();
  model.delay_ticks = 31;
  EXPECT_NE(test::error_of([&] { (void)discretised(model); }).find("the delay"), std::string::npos);
}

}  // namespace
}  // namespace haptrace
