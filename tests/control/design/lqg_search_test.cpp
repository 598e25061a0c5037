#include "control/design/lqg_search.h"

#include "control/design/tracking_design.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <utility>

namespace haptrace {
namespace {

AxisModel identified_axis(double mass = 0.4, double delay_ticks = 1.3) {
  return {.mass = mass,
          .delay_ticks = delay_ticks,
          .lag = 0.5e-3,
          .hand = kRelaxedHand,
          .position_noise = 5e-5 / std::sqrt(12.0)};
}

LqgResult searched(const AxisModel& axis, const LqgSearchOptions& options = {}) {
  const auto found = search_lqg({axis, std::nullopt, std::nullopt}, options, StopRequest{});
  return found->front().value();
}

TEST(LqgSearch, MeetsItsTargetsOnADeviceInARelaxedHand) {
  double error = 1;
  for (const auto& [firmness, target] :
       {std::pair{Firmness::quiet, 0.43}, {Firmness::normal, 0.9}, {Firmness::exact, 1.35}}) {
    const LqgResult result = searched(identified_axis(), {.firmness = firmness});
    const std::string name = to_string(firmness);
    EXPECT_THAT(result.unmet, testing::IsEmpty()) << name;
    EXPECT_NEAR(result.ripple_target, target * identified_axis().position_noise * plain_ripple(1000), 1e-12) << name;
    EXPECT_LT(result.figures.ripple, 1.02 * result.ripple_target) << name;
    EXPECT_LT(result.near_sensitivity, 1.02 * kNearSensitivity) << name;
    EXPECT_LT(result.far_sensitivity, 1.02 * kFarSensitivity) << name;
    EXPECT_LT(result.figures.error, 0.8 * error) << name << " is firmer than the one before";
    error = result.figures.error;
  }
}

TEST(LqgSearch, ComesWithinHalfOfTheOptimumThatHasNoMargins) {
  AxisModel known = identified_axis();
  known.noise = kHealthyHand;
  known.force_noise = 1e-6;
  const LqgResult result = searched(identified_axis());
  double optimum = 0;
  for (double weight = 1e-10; weight < 1e-5; weight *= 1.2) {
    const auto law = design_lqg(known, weight);
    const auto figures = LqgLoop(*law, law->model).figures();
    if (figures->ripple > result.figures.ripple) optimum = figures->error;
  }
  EXPECT_LT(result.figures.error, 1.5 * optimum);
  EXPECT_GT(result.figures.error, optimum);
}

TEST(LqgSearch, ExpectsAnIdentifiedTremorFromAFifthOfANewton) {
  AxisModel trembling = identified_axis();
  trembling.noise = {.drift = 0, .drift_hz = 0, .tremor = 0.6, .tremor_hz = 9};
  AxisModel weakly = trembling;
  weakly.noise.tremor = 0.1;
  const LqgSearchOptions options{.plain_ripple = 0.2};
  const LqgResult expects = searched(trembling, options), hardly = searched(weakly, options),
                  calm = searched(identified_axis(), options);
  EXPECT_EQ(expects.laws.moving.model.states(), calm.laws.moving.model.states() + 2);
  EXPECT_EQ(hardly.laws.moving.model.states(), calm.laws.moving.model.states());
  EXPECT_EQ(expects.laws.resting.model.states(), calm.laws.resting.model.states());
  EXPECT_LT(expects.near_sensitivity, 1.02 * kNearSensitivity);
  EXPECT_LT(expects.far_sensitivity, 1.02 * kFarSensitivity);

  AxisModel truth = trembling;
  truth.noise.drift = kHealthyHand.drift;
  truth.noise.drift_hz = kHealthyHand.drift_hz;
  const auto error = [&](const LqgResult& law) {
    return LqgLoop(law.laws.moving, discretised(truth)).figures().value().error;
  };
  EXPECT_NEAR(error(expects), expects.figures.error, 1e-3 * expects.figures.error) << "as it predicts";
  EXPECT_LT(error(expects), 0.95 * error(calm));
}

TEST(LqgSearch, RestsOnTheBristlesOfFrictionAndInAHand) {
  for (const auto& [mass, delay] :
       {std::pair{0.1, 0.0}, {0.1, 1.3}, {0.1, 2.5}, {0.4, 0.0}, {0.4, 1.3}, {0.4, 2.5}, {1.0, 0.0}, {1.0, 1.3}}) {
    const AxisModel axis = identified_axis(mass, delay);
    const auto law = design_lqg_for_rest(axis, 0.115);
    ASSERT_TRUE(law);
    LqgAxis kept = *law;  // at rest the load is kept
    kept.state[kept.model.drift] -= kept.load;
    const auto radius = [&, &plant_axis = axis](const HandModel& hand) {
      AxisModel plant = plant_axis;
      plant.hand = hand;
      return LqgLoop(kept, discretised(plant)).radius();
    };
    EXPECT_LT(radius(kRelaxedHand), 1) << mass << " kg, " << delay << " ticks";
    // Friction that has not broken loose ties the device to the ground, here a hand that nothing moves.
    for (const double frequency : {10, 15, 20, 25, 30, 35})
      EXPECT_LT(
          radius({.mass = 1e9, .grip_stiffness = mass * std::pow(2 * M_PI * frequency, 2), .grip_damping = 5 * mass}),
          1 + 1e-6)
          << mass << " kg, " << delay << " ticks, " << frequency << " Hz";
  }
}

TEST(LqgSearch, TakesAShareOfTheRippleThatIsAllowed) {
  const LqgResult result = searched(identified_axis(), {.plain_ripple = 0.2});
  EXPECT_NEAR(result.ripple_target, 0.18, 1e-12);
  EXPECT_NEAR(result.figures.ripple, 0.18, 0.01);
}

TEST(LqgSearch, DoesNotDependOnTheNumberOfThreads) {
  const auto found = [&](std::size_t threads) {
    return search_lqg({identified_axis(), std::nullopt, identified_axis(0.5)}, {.threads = threads}, StopRequest{});
  };
  const auto one = found(1), three = found(3);
  EXPECT_FALSE((*one)[1]);
  for (const std::size_t axis : {0U, 2U}) {
    EXPECT_EQ((*one)[axis]->laws.moving.state, (*three)[axis]->laws.moving.state);
    EXPECT_EQ((*one)[axis]->figures.error, (*three)[axis]->figures.error);
  }
}

TEST(LqgSearch, StatesWhatItCannotMeet) {
  AxisModel late = identified_axis(0.05, 25);
  const LqgResult result = searched(late, {.firmness = Firmness::exact, .lighter = 0.3, .heavier = 3});
  EXPECT_FALSE(result.unmet.empty());
}

TEST(LqgSearch, ReportsItsProgressAndStopsWhenAsked) {
  double last = 0;
  (void)search_lqg({identified_axis(), std::nullopt, std::nullopt}, {}, StopRequest{}, [&](double share) {
    EXPECT_GE(share, last);
    EXPECT_LE(share, 1);
    last = share;
  });
  EXPECT_EQ(last, 1);
  StopRequest stop;
  stop.raise();
  EXPECT_FALSE(search_lqg({identified_axis(), std::nullopt, std::nullopt}, {}, stop));
}

TEST(LqgSearch, LearnsUpToALowerFrequencyWhereTheNoiseOfAHeavyDeviceWouldBecomeForce) {
  const auto bandwidth = [](double mass) {
    AxisModel axis = identified_axis(mass);
    axis.hand = {};
    return searched(axis).laws.learning_hz;
  };
  EXPECT_GT(bandwidth(0.2), kMostLearning - 1);
  const double heavy = bandwidth(1.5);
  EXPECT_GT(heavy, kLeastLearning);
  EXPECT_LT(heavy, kMostLearning - 5);
  EXPECT_EQ(bandwidth(5), kLeastLearning);
}

}  // namespace
}  // namespace haptrace
