#include "control/design/lqg_design.h"

#include "control/design/lqg_search.h"
#include "control/design/riccati.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Returns an axis of 0.4 kg in a relaxed hand, with an encoder resolution of 0.05 mm.
AxisModel held_axis(double delay_ticks) {
  AxisModel model{.mass = 0.4,
                  .delay_ticks = delay_ticks,
                  .lag = 0.5e-3,
                  .hand = kRelaxedHand,
                  .noise = kHealthyHand,
                  .force_noise = 1e-6,
                  .position_noise = 5e-5 / std::sqrt(12.0)};
  model.hand.arm_damping = 2;
  model.hand.arm_relaxation_s = 0.5;
  return model;
}

LoopFigures figures_of(const LqgAxis& law, const DiscreteAxis& plant) {
  const auto figures = LqgLoop(law, plant).figures();
  EXPECT_TRUE(figures);
  return figures.value_or(LoopFigures{});
}

/// Returns the smallest error of a linear law at this ripple of three axes together [m].
double bound(const AxisModel& model, double ripple) {
  double low = -30, high = -5;  // logarithm of the weight
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    const auto law = design_lqg(model, std::exp(middle));
    (std::sqrt(3) * figures_of(*law, law->model).ripple > ripple ? low : high) = middle;
  }
  const auto law = design_lqg(model, std::exp(high));
  return std::sqrt(3) * figures_of(*law, law->model).error;
}

TEST(LqgDesign, ReachesTheKnownBoundsOfAHeldDevice) {
  // From an independent implementation, with the force 1 to 3 periods after the sample. Its drift and tremor differ a
  // little.
  const double known[3][3] = {{0.051, 0.034, 0.028}, {0.058, 0.039, 0.032}, {0.065, 0.044, 0.037}};
  for (int delay = 0; delay < 3; ++delay)
    for (int ripple = 0; ripple < 3; ++ripple)
      EXPECT_NEAR(1e3 * bound(held_axis(delay), 0.1 * (ripple + 1)), known[delay][ripple], 0.06 * known[delay][ripple])
          << delay << " periods, " << 0.1 * (ripple + 1) << " N";
}

TEST(LqgDesign, TreatsADelayLikeARegulatorThatKnowsTheForcesOnTheirWay) {
  for (const double delay : {0.0, 0.4, 1.0, 2.0, 2.7}) {
    const auto law = design_lqg(held_axis(delay), 2e-8);
    ASSERT_TRUE(law);
    const DiscreteAxis& model = law->model;
    const RippleModel ripple(1000);
    // The whole system: states, forces on their way (newest first), ripple.
    const Index n = model.states(), sent = model.sent(), size = n + sent + 4;
    MatrixXd a = MatrixXd::Zero(size, size);
    VectorXd b = VectorXd::Zero(size);
    a.topLeftCorner(n, n) = model.transition;
    const auto act = [&](const VectorXd& by, Index ticks) {
      if (ticks == 0)
        b.head(n) += by;
      else
        a.col(n + ticks - 1).head(n) += by;
    };
    act(model.newer, model.delay);
    if (model.fractional) act(model.older, model.delay + 1);
    if (sent > 0) b[n] = 1;
    for (Index i = 1; i < sent; ++i) a(n + i, n + i - 1) = 1;
    a.bottomRightCorner<4, 4>() = ripple.a;
    b.tail<4>() = ripple.b;
    MatrixXd q = MatrixXd::Zero(size, size);
    q(0, 0) = 1;
    q.bottomRightCorner<4, 4>() = 2e-8 * ripple.c.transpose() * ripple.c;
    VectorXd s = VectorXd::Zero(size);
    s.tail<4>() = 2e-8 * ripple.d * ripple.c.transpose();
    const double r = 2e-8 * ripple.d * ripple.d;
    const auto x = solve_riccati(a, b, q, r, s);
    ASSERT_TRUE(x) << delay;
    const VectorXd gains = (a.transpose() * *x * b + s) / (r + b.dot(*x * b));
    const auto expect_near = [&](const VectorXd& ours, const VectorXd& whole, const char* what) {
      EXPECT_LT((ours - whole).norm(), 1e-5 * (1 + whole.norm())) << what << " with a delay of " << delay;
    };
    expect_near(law->state.transpose(), gains.head(n), "states");
    expect_near(law->sent.transpose(), gains.segment(n, sent), "forces");
    expect_near(law->ripple.transpose(), gains.tail<4>(), "ripple");
  }
}

TEST(LqgDesign, StabilisesItsModelAndBalancesItsDrift) {
  for (const double delay : {0.0, 0.5, 3.0, 12.0, 30.0}) {
    const auto law = design_lqg(held_axis(delay), 1e-7);
    ASSERT_TRUE(law) << delay;
    EXPECT_LT(LqgLoop(*law, law->model).radius(), 1) << delay;
    EXPECT_GT(law->stiffness, 0) << delay;
    EXPECT_LT(law->load, 1.05) << delay;
    EXPECT_GT(law->load, 0.95 * std::exp(-2 * M_PI * kHealthyHand.drift_hz * (delay + 10) / 1000))
        << delay << ": what is left of the drift when the force acts";
  }
}

TEST(LqgDesign, StabilisesItsModelAtEveryRateAndMass) {
  for (const double rate_hz : {50.0, 100.0, 333.0, 1000.0, 4000.0, 20000.0})
    for (const double mass : {1e-3, 0.02, 0.4, 5.0})
      for (const double weight : {1e-10, 3e-8, 1e-5}) {
        AxisModel model = held_axis(std::min(1e-3 * rate_hz, AxisModel::kLongestDelay));
        model.mass = mass;
        model.rate_hz = rate_hz;
        const auto law = design_lqg(model, weight);
        ASSERT_TRUE(law) << rate_hz << " Hz, " << mass << " kg, " << weight;
        EXPECT_LT(LqgLoop(*law, law->model).radius(), 1) << rate_hz << " Hz, " << mass << " kg, " << weight;
      }
}

TEST(LqgDesign, IsBetterOnItsModelThanALawWithOtherGains) {
  const double weight = 2e-8;
  const auto law = design_lqg(held_axis(1.3), weight);
  ASSERT_TRUE(law);
  const auto cost = [&](const LqgAxis& of) {
    const LoopFigures figures = figures_of(of, law->model);
    return figures.error * figures.error + weight * figures.ripple * figures.ripple;
  };
  const double least = cost(*law);
  for (const double factor : {0.95, 1.05}) {
    for (Index i = 0; i < law->state.size(); ++i) {
      LqgAxis other = *law;
      other.state[i] *= factor;
      EXPECT_GE(cost(other), least * (1 - 1e-9)) << "feedback of state " << i;
      other = *law;
      other.kalman[i] *= factor;
      EXPECT_GE(cost(other), least * (1 - 1e-9)) << "filter of state " << i;
    }
    LqgAxis other = *law;
    other.ripple *= factor;
    EXPECT_GT(cost(other), least) << "feedback of the ripple";
  }
}

TEST(LqgDesign, AgreesWithNyquistAboutStability) {
  const auto law = design_lqg(held_axis(1.3), 2e-8);
  ASSERT_TRUE(law);
  const FrequencyGrid grid(1000);
  const auto known = grid.plant(law->model), response = grid.law(*law);
  int stable = 0, unstable = 0;
  for (const double mass : {0.1, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0})
    for (const double delay : {0.0, 1.3, 2.5, 4.0, 6.0})
      for (const double hand : {0.1, 0.5, 1.0, 3.0}) {
        AxisModel model = held_axis(delay);
        model.mass = mass;
        model.hand.mass *= hand;
        model.hand.grip_stiffness *= hand;
        const DiscreteAxis plant = discretised(model);
        const double radius = LqgLoop(*law, plant).radius();
        if (std::abs(radius - 1) < 1e-3) continue;
        EXPECT_EQ(FrequencyGrid::stable_like(known, grid.plant(plant), response), radius < 1)
            << mass << " kg, " << delay << " ticks, hand " << hand << ": " << radius;
        ++(radius < 1 ? stable : unstable);
      }
  EXPECT_GE(stable, 20);
  EXPECT_GE(unstable, 20);
}

TEST(LqgDesign, FindsTheSensitivityAtWhichTheLoopLosesItsStability) {
  // A gain of 1 + 1 / Ms more or less in any phase keeps a loop stable; the smallest such change that does not lies on
  // the circle.
  const auto law = design_lqg(held_axis(1.3), 2e-8);
  const FrequencyGrid grid(1000);
  const double ms = FrequencyGrid::largest_sensitivity(grid.plant(law->model), grid.law(*law));
  EXPECT_GT(ms, 3);
  EXPECT_LT(ms, 8) << "an optimum without margins";
  DiscreteAxis plant = law->model;
  for (const double gain : {1 - 0.99 / ms, 1 + 0.99 / ms}) {
    plant.newer = gain * law->model.newer;
    plant.older = gain * law->model.older;
    EXPECT_LT(LqgLoop(*law, plant).radius(), 1) << gain;
  }
}

}  // namespace
}  // namespace haptrace
