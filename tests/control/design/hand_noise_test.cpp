#include "control/design/hand_noise.h"

#include "control/design/lqg_search.h"
#include "tests/control/design/held_bench.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

/// Returns the tremor that is found on `bench` with the excitation of a calibration, in 2 windows at the centre and 8
/// at places.
HandNoiseIdentification found_on(HeldBench& bench) {
  bench.dither = Multisine(15, 120, 1.5, {true, true, true});
  (void)bench.identified(10);
  const HeldIdentification held = bench.held();
  const HeldModel model = held.held.held() ? held.held : held_model(identify(bench.experiment()).plant, kRelaxedHand);
  PlantModel plant{.coulomb = Vec3::Constant(bench.coulomb), .position_resolution = bench.quantum};
  return identify_hand_noise(bench.experiment(), model, plant);
}

TEST(HandNoise, FindsTheTremorOfTheHand) {
  for (const double tremor : {0.3, 1.0})
    for (const double hz : {5.0, 8.5, 11.0}) {
      HeldBench bench;
      bench.tremor = tremor;
      bench.tremor_hz = hz;
      const HandNoiseIdentification found = found_on(bench);
      EXPECT_GT(found.evidence, 10);
      EXPECT_NEAR(found.noise.tremor / tremor, 1, 0.4) << tremor << " N at " << hz << " Hz";
      EXPECT_NEAR(found.noise.tremor_hz, hz, 2.5) << tremor << " N";
      EXPECT_GT(found.half_width.tremor, 0);
      EXPECT_LT(found.half_width.tremor, 0.5 * found.noise.tremor);
    }
}

TEST(HandNoise, FindsNoTremorWhereThereIsNone) {
  for (const unsigned seed : {1U, 2U, 3U, 4U}) {
    HeldBench bench;
    bench.seed = seed;
    bench.tremor = seed % 2 == 0 ? 0 : 0.04;
    bench.holds = seed < 4;
    bench.coulomb = 0.3 * seed;
    const HandNoiseIdentification found = found_on(bench);
    EXPECT_EQ(found.noise.tremor, 0) << seed;
  }
}

TEST(HandNoise, FindsATremorAtHarmonicsOfTheMovementAndAlongOneAxis) {
  for (const double hz : {8.0, 28 / 3.0, 12.0, 14.0, 15.5}) {
    HeldBench bench;
    bench.tremor = 0.7;
    bench.tremor_hz = hz;
    bench.tremor_damping = 0.003;
    bench.coulomb = 0.3;
    const HandNoiseIdentification found = found_on(bench);
    EXPECT_NEAR(found.noise.tremor, 0.7, 0.4) << hz;
    EXPECT_NEAR(found.noise.tremor_hz, hz, 3) << hz;
  }
}

TEST(HandNoise, FindsANarrowTremorWhereverItLiesBetweenTheLines) {
  for (const double hz : {7.8, 8.0, 8.2, 12.0}) {
    HeldBench bench;
    bench.tremor = 0.6;
    bench.tremor_hz = hz;
    bench.tremor_damping = 0;
    bench.coulomb = 0.5;
    const HandNoiseIdentification found = found_on(bench);
    EXPECT_NEAR(found.noise.tremor, 0.6, 0.08) << hz;
    EXPECT_NEAR(found.noise.tremor_hz, hz, 0.3) << hz;
  }
}

TEST(HandNoise, FindsATremorOfAnotherKind) {
  // Narrower than the model's, which a band of 1.5 s can hardly show.
  HeldBench bench;
  bench.tremor = 0.6;
  bench.tremor_hz = 5.5;
  bench.tremor_damping = 0.03;
  const HandNoiseIdentification found = found_on(bench);
  EXPECT_NEAR(found.noise.tremor, 0.6, 0.35);
  EXPECT_NEAR(found.noise.tremor_hz, 5.5, 1.5);
}

TEST(HandNoise, NeedsAnExcitationAndWindows) {
  HeldBench bench;
  bench.tremor = 1;
  bench.dither = Multisine(4, 120, 1.5, {true, true, true});
  (void)bench.identified(10);
  Experiment experiment = bench.experiment();
  experiment.dither = nullptr;
  HeldModel model;
  model.mass = Vec3::Constant(0.4);
  EXPECT_EQ(identify_hand_noise(experiment, model, {}).noise.tremor, 0);
  experiment = bench.experiment();
  experiment.dithered.clear();
  EXPECT_EQ(identify_hand_noise(experiment, model, {}).noise.tremor, 0);
}

TEST(HandNoise, ATremorReachesStillMotorsThroughTheGrip) {
  HeldModel held;
  held.mass = Vec3(0.4, 0.4, 0);
  held.noise = {.drift = 0, .drift_hz = 0, .tremor = 0.5, .tremor_hz = 8};
  const Vec3 of_the_device = tremor_at_motors(held).whole;
  EXPECT_NEAR(of_the_device.x(), 0.5, 0.01) << "without a hand, all of it";
  EXPECT_EQ(of_the_device.z(), 0) << "nothing is driven there";

  // A grip with its resonance at the tremor's frequency passes more, and one far below it less.
  held.hand.fill({.mass = 0.2, .grip_stiffness = 0.2 * std::pow(kTwoPi * 8, 2), .grip_damping = 4});
  EXPECT_GT(tremor_at_motors(held).whole.x(), 0.5);
  held.hand.fill({.mass = 0.2, .grip_stiffness = 0.2 * std::pow(kTwoPi * 2, 2), .grip_damping = 0.5});
  EXPECT_LT(tremor_at_motors(held).whole.x(), 0.2);

  // A tremor of 6 Hz has little force above 25 Hz. A faster one has more.
  held.hand.fill({});
  held.noise.tremor_hz = 6;
  const double slow = tremor_at_motors(held).ripple.x();
  held.noise.tremor_hz = 12;
  const double fast = tremor_at_motors(held).ripple.x();
  EXPECT_GT(slow, 0);
  EXPECT_LT(slow, 0.05 * 0.5);
  EXPECT_GT(fast, 2 * slow);
  EXPECT_LT(fast, 0.3 * 0.5);

  held.noise.tremor = 0;
  EXPECT_EQ(tremor_at_motors(held).whole.norm(), 0);
}

TEST(HandNoise, TheResponseOfAHandIsThatOfItsBodies) {
  const HandModel hand{.mass = 0.15, .grip_stiffness = 800, .grip_damping = 4};
  const LinkModel link{.mass = 0.02, .stiffness = 1100, .damping = 0.5};
  const std::complex<double> s(0, kTwoPi * 9);
  // Forces on the two bodies while the motors are displaced by 1 m, or rest and the hand pushes with 1 N.
  const std::complex<double> grip = hand.grip_stiffness + hand.grip_damping * s;
  const std::complex<double> arm =
      hand.arm_damping * s + hand.arm_stiffness * s * hand.arm_relaxation_s / (1.0 + s * hand.arm_relaxation_s);
  const std::complex<double> spring = link.stiffness + link.damping * s;
  Eigen::Matrix2cd bodies;
  bodies << link.mass * s * s + spring + grip, -grip, -grip, hand.mass * s * s + arm + grip;
  const Eigen::Vector2cd displaced = bodies.inverse() * Eigen::Vector2cd(spring, 0);
  const Eigen::Vector2cd pushed = bodies.inverse() * Eigen::Vector2cd(0, 1);
  const HeldResponse found = held_response(hand, link, s);
  EXPECT_NEAR(std::abs(found.impedance - spring * (1.0 - displaced[0])), 0, 1e-9 * std::abs(found.impedance));
  EXPECT_NEAR(std::abs(found.share - spring * pushed[0]), 0, 1e-9 * std::abs(found.share));
  EXPECT_EQ(held_response({}, {}, s).impedance, 0.0);
  EXPECT_EQ(held_response({}, {}, s).share, 1.0);
}

}  // namespace
}  // namespace haptrace
