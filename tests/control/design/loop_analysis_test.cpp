#include "control/design/loop_analysis.h"

#include "base/eigenvalues.h"
#include "control/velocity_estimator.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

/// Random numbers that are the same on every platform.
class Dice {
 public:
  explicit Dice(unsigned seed) : engine_(seed) {}
  double even(double low, double high) { return low + (high - low) * static_cast<double>(engine_()) / 4294967296.0; }
  double ratio(double low, double high) { return low * std::pow(high / low, even(0, 1)); }
  int whole(int low, int high) { return static_cast<int>(std::floor(even(low, high + 1))); }

 private:
  std::mt19937 engine_;
};

/// Returns a device of the supported kind: 0.05 to 1 kg, with a delay of up to 3 ms.
LoopModel random_model(Dice& dice, const std::string& velocity) {
  LoopModel model;
  model.mass = dice.ratio(0.05, 1);
  model.viscous = dice.ratio(0.1, 3);
  model.delay = dice.even(0, 3e-3);
  model.lag = dice.whole(0, 1) * dice.even(0, 1e-3);
  model.rate_hz = dice.ratio(500, 4000);
  model.velocity = velocity;
  model.resolution = 5e-5;
  return model;
}

/// Returns a kd well within the stable range.
double random_kd(Dice& dice, const LoopAnalysis& analysis) {
  const LoopModel& m = analysis.model();
  return analysis.most_damped(1e-6 * m.mass * m.rate_hz * m.rate_hz) * dice.ratio(0.005, 0.8);
}

/// Returns the spectral radius of the loop with the first difference and no lag. One matrix advances the state by a
/// tick: x, v, the previous x and the commands under way. Time is in periods, and the hold is integrated analytically.
double growth_of(const LoopModel& model, double kp, double kd) {
  const double period = 1 / model.rate_hz, beta = model.viscous * period / model.mass, d = model.delay / period;
  const int n = static_cast<int>(std::floor(d + 1e-9));
  const double part = std::max(d - n, 0.0);
  const auto speed = [beta](double h) {
    return beta * h < 1e-6 ? h - beta * h * h / 2 : -std::expm1(-beta * h) / beta;
  };
  const auto place = [&](double h) {
    return beta * h < 1e-3 ? h * h / 2 - beta * h * h * h / 6 + beta * beta * h * h * h * h / 24
                           : (h - speed(h)) / beta;
  };
  const double unit = period * period / model.mass;
  Eigen::MatrixXd tick = Eigen::MatrixXd::Zero(4 + n, 4 + n);
  Eigen::RowVectorXd u = Eigen::RowVectorXd::Zero(4 + n);  // the command of this tick
  u[0] = -unit * (kp + kd / period);
  u[2] = unit * kd / period;
  const auto command = [&](int ago) -> Eigen::RowVectorXd {
    return ago == 0 ? u : Eigen::RowVectorXd(Eigen::RowVectorXd::Unit(4 + n, 2 + ago));
  };
  tick(0, 0) = 1;
  tick(0, 1) = speed(1);
  tick(1, 1) = std::exp(-beta);
  tick.row(0) += place(1 - part) * command(n) + (place(1) - place(1 - part)) * command(n + 1);
  tick.row(1) += speed(1 - part) * command(n) + (speed(1) - speed(1 - part)) * command(n + 1);
  tick(2, 0) = 1;
  for (int ago = 1; ago <= n + 1; ++ago) tick.row(2 + ago) = command(ago - 1);
  return spectral_radius(tick);
}

class LoopLaws : public testing::TestWithParam<std::string> {
 protected:
  static constexpr int kDraws = 12;
};

TEST_P(LoopLaws, TheStiffestKpIsWhereStabilityEnds) {
  Dice dice(1);
  for (int i = 0; i < kDraws; ++i) {
    const LoopAnalysis analysis(random_model(dice, GetParam()));
    const double kd = random_kd(dice, analysis), kp = analysis.stiffest(kd);
    ASSERT_GT(kp, 0) << i;
    EXPECT_TRUE(analysis.stable(0.999 * kp, kd)) << i;
    EXPECT_FALSE(analysis.stable(1.001 * kp, kd)) << i;
    for (const double more : {2, 10, 1000}) EXPECT_FALSE(analysis.stable(more * kp, kd)) << i;
    const double most = analysis.most_damped(0.5 * kp);
    EXPECT_TRUE(analysis.stable(0.5 * kp, 0.999 * most)) << i;
    EXPECT_FALSE(analysis.stable(0.5 * kp, 1.001 * most)) << i;
  }
}

TEST_P(LoopLaws, MoreDelayNeverAllowsMoreStiffness) {
  Dice dice(2);
  for (int i = 0; i < kDraws; ++i) {
    LoopModel model = random_model(dice, GetParam());
    model.delay = 0;
    const double kd = random_kd(dice, LoopAnalysis(model));
    double before = std::numeric_limits<double>::infinity();
    for (int step = 0; step < 8; ++step, model.delay += 0.4 / model.rate_hz) {
      const double kp = LoopAnalysis(model).stiffest(kd);
      EXPECT_LE(kp, before * (1 + 1e-9)) << i << ", step " << step;
      before = kp;
    }
  }
}

TEST_P(LoopLaws, ALoopThatIsPassiveIsStable) {
  Dice dice(3);
  int passive = 0;
  for (int i = 0; i < 4 * kDraws; ++i) {
    LoopModel model = random_model(dice, GetParam());
    model.viscous *= 3;
    const LoopAnalysis analysis(model);
    const double kp = dice.ratio(1, 1e4), kd = dice.ratio(1e-2, 10);
    if (!analysis.passive(kp, kd)) continue;
    ++passive;
    EXPECT_TRUE(analysis.stable(kp, kd)) << i;
  }
  EXPECT_GT(passive, 5);
}

TEST_P(LoopLaws, MassDampingAndGainsScaleTogether) {
  Dice dice(4);
  for (int i = 0; i < kDraws; ++i) {
    LoopModel model = random_model(dice, GetParam());
    const LoopAnalysis analysis(model);
    const double kd = random_kd(dice, analysis), factor = dice.ratio(0.01, 100);
    model.mass *= factor;
    model.viscous *= factor;
    EXPECT_NEAR(LoopAnalysis(model).stiffest(factor * kd) / (factor * analysis.stiffest(kd)), 1, 1e-9) << i;
  }
}

TEST_P(LoopLaws, MarginsAreWhereStabilityEnds) {
  Dice dice(5);
  for (int i = 0; i < kDraws; ++i) {
    LoopModel model = random_model(dice, GetParam());
    if (i % 2 == 1) model.observer = {dice.ratio(3, 10), model.mass * dice.ratio(0.5, 1.5)};
    const LoopAnalysis analysis(model);
    const double kd = random_kd(dice, analysis), kp = 0.3 * analysis.stiffest(kd);
    const Margins m = analysis.margins(kp, kd);
    if (m.modulus == 0) continue;  // with an observer, even 0.3 of the stiffest kp may be unstable
    // The modulus margin bounds the other margins from below (Astrom and Murray, Feedback Systems, 10.3).
    EXPECT_GE(m.gain_up, 1 / (1 - std::min(m.modulus, 0.999999))) << i;
    EXPECT_LE(m.gain_down, 1 / (1 + m.modulus)) << i;
    EXPECT_GE(m.phase, 2 * std::asin(m.modulus / 2) - 1e-9) << i;
    if (model.observer) continue;  // kp and kd do not scale the observer's gain, and the observer knows the delay
    EXPECT_TRUE(analysis.stable(0.999 * m.gain_up * kp, 0.999 * m.gain_up * kd)) << i;
    EXPECT_FALSE(analysis.stable(1.001 * m.gain_up * kp, 1.001 * m.gain_up * kd)) << i;
    if (m.delay > 8e-3) continue;
    // A held force that is delayed by a fraction of a period is only approximately exp(-j w delay).
    model.delay += 0.98 * m.delay;
    EXPECT_TRUE(LoopAnalysis(model).stable(kp, kd)) << i;
    model.delay += 0.04 * m.delay;
    EXPECT_FALSE(LoopAnalysis(model).stable(kp, kd)) << i;
  }
}

std::vector<std::string> estimators() {
  std::vector<std::string> specs = velocity_estimator_names();
  specs.insert(specs.end(), {"lowpass:20", "least-squares:30", "foaw:3"});
  return specs;
}
INSTANTIATE_TEST_SUITE_P(All, LoopLaws, testing::ValuesIn(estimators()));

TEST(LoopAnalysis, AgreesWithEigenvaluesAtEveryExtreme) {
  Dice dice(6);
  int stable = 0, unstable = 0;
  for (int i = 0; i < 600; ++i) {
    LoopModel model;
    model.velocity = "difference";
    model.mass = dice.ratio(1e-3, 10);
    model.rate_hz = dice.ratio(100, 20000);
    const double inertia = model.mass * model.rate_hz;
    model.viscous = i % 4 == 0 ? 0 : inertia * dice.ratio(1e-6, 10);
    model.delay = (i % 3 == 0 ? dice.whole(0, 16) : dice.even(0, 16)) / model.rate_hz;
    const double kp = inertia * model.rate_hz * dice.ratio(1e-8, 10), kd = inertia * dice.ratio(1e-5, 3);
    const double radius = growth_of(model, kp, kd);
    if (std::abs(radius - 1) < 1e-9) continue;
    EXPECT_EQ(LoopAnalysis(model).stable(kp, kd), radius < 1)
        << i << ": radius 1 " << (radius < 1 ? "- " : "+ ") << std::abs(radius - 1);
    ++(radius < 1 ? stable : unstable);
  }
  EXPECT_GT(stable, 100);
  EXPECT_GT(unstable, 100);
}

TEST(LoopAnalysis, DependsOnHulinsNormalisedVariablesOnly) {
  // Hulin, Preusche and Hirzinger, IROS 2006: alpha = K T^2 / m, beta = B T / m, delta = b T / m, d = t_d / T.
  Dice dice(7);
  for (int i = 0; i < 20; ++i) {
    const double delta = dice.ratio(1e-4, 0.1), d = dice.even(0, 3), beta = dice.ratio(1e-3, 0.2);
    const auto alpha = [&](double mass, double rate_hz) {
      LoopModel model{.mass = mass, .rate_hz = rate_hz, .velocity = "difference"};
      model.viscous = delta * mass * rate_hz;
      model.delay = d / rate_hz;
      return LoopAnalysis(model).stiffest(beta * mass * rate_hz) / mass / rate_hz / rate_hz;
    };
    const double of_one = alpha(0.4, 1000);
    EXPECT_NEAR(alpha(dice.ratio(1e-3, 10), dice.ratio(100, 20000)) / of_one, 1, 1e-6) << i;
  }
}

TEST(LoopAnalysis, FindsGilsLimitForSmallDamping) {
  // Gil, Sanchez, Hulin, Preusche and Hirzinger 2009: K < (b + B) / (T / 2 + t_d).
  for (const double delay : {0.0, 0.3e-3, 1e-3, 3e-3})
    for (const double lag : {0.0, 0.5e-3})
      for (const double kd : {0.0, 0.2, 1.0}) {
        const LoopAnalysis analysis(
            {.mass = 1, .viscous = 1, .delay = delay, .lag = lag, .rate_hz = 1000, .velocity = "difference"});
        EXPECT_NEAR(analysis.stiffest(kd) * (0.5e-3 + delay + lag) / (1 + kd), 1, 0.03)
            << delay << " " << lag << " " << kd;
      }
}

TEST(LoopAnalysis, AgreesWithLimitsThatWereSimulatedElsewhere) {
  // 0.4 kg, a delay of 1 ms and a lag of 0.5 ms. The simulations took a perceptible ripple as the limit.
  LoopModel model{.mass = 0.4, .viscous = 1.8, .delay = 1e-3, .lag = 0.5e-3, .velocity = "difference"};
  EXPECT_NEAR(LoopAnalysis(model).stiffest(25), 12700, 0.05 * 12700);
  EXPECT_NEAR(LoopAnalysis(model).stiffest(50), 22100, 0.05 * 22100);
  model.velocity = "lowpass:100";
  EXPECT_NEAR(LoopAnalysis(model).stiffest(25), 9400, 0.1 * 9400);
}

TEST(Passivity, AgreesWithTheClosedFormOfColgateAndSchenkel) {
  for (const double rate : {300.0, 1000.0, 4000.0})
    for (const double kp : {0.0, 100.0, 3000.0})
      for (const double kd : {0.0, 0.5, 20.0}) {
        const LoopAnalysis analysis({.mass = 0.4, .viscous = 2, .rate_hz = rate, .velocity = "difference"});
        const double needed = kp / rate / 2 + kd;
        EXPECT_NEAR(analysis.passive_damping(kp, kd), needed, 1e-6 * needed);
        EXPECT_EQ(analysis.passive(kp, kd), 2 > needed);
      }
}

TEST(Passivity, OfASpringNeedsDampingInProportionToItsDelay) {
  for (const int whole : {0, 1, 3}) {
    const LoopAnalysis analysis({.mass = 0.4, .viscous = 2, .delay = whole * 1e-3, .velocity = "difference"});
    EXPECT_NEAR(analysis.passive_damping(1000, 0), 1000 * (0.5e-3 + whole * 1e-3), 1e-5);
  }
}

TEST(Passivity, IsContinuousBetweenDelayAndLag) {
  for (const double delay : {0.0, 0.25e-3, 1e-3}) {
    LoopModel model{.mass = 0.4, .viscous = 2, .delay = delay, .velocity = "lowpass:200"};
    const double without = LoopAnalysis(model).passive_damping(1000, 3);
    model.lag = 2e-9;
    const double with = LoopAnalysis(model).passive_damping(1000, 3);  // the analysis bounds far aliases from above
    EXPECT_NEAR(with, without, 2e-3 * without);
    EXPECT_GE(with, without * (1 - 1e-9));
    model.lag = 0.3e-3;
    EXPECT_GT(LoopAnalysis(model).passive_damping(1000, 0), 1000 * (0.5e-3 + delay + 0.3e-3) * (1 - 1e-4));
  }
}

TEST(Passivity, KeepsTheLoopStableWithAnyPassiveHand) {
  // A hand of mass, damping and spring can only make the device heavier, more damped and stiffer. A passive law is
  // stable with every such hand.
  Dice dice(8);
  for (int i = 0; i < 100; ++i) {
    LoopModel model = random_model(dice, "difference");
    const LoopAnalysis free(model);
    const double kd = 0.3 * dice.even(0, model.viscous);
    double kp = 1;
    while (free.passive(1.05 * kp, kd)) kp *= 1.05;
    if (!free.passive(kp, kd)) continue;
    model.mass += dice.ratio(1e-3, 10);
    model.viscous += dice.ratio(1e-3, 10);
    EXPECT_TRUE(LoopAnalysis(model).stable(kp, kd)) << i;
  }
}

TEST(LoopAnalysis, FoawIsJudgedByItsLongestWindow) {
  LoopModel model{.mass = 0.4, .viscous = 1.8, .delay = 1e-3, .velocity = "foaw:8", .resolution = 5e-5};
  const double windowed = LoopAnalysis(model).stiffest(25);
  model.resolution = 0;  // without a resolution, foaw is the first difference
  const double difference = LoopAnalysis(model).stiffest(25);
  model.velocity = "difference";
  EXPECT_EQ(LoopAnalysis(model).stiffest(25), difference);
  EXPECT_LT(windowed, 0.8 * difference);
  model.velocity = "foaw:1";
  model.resolution = 5e-5;
  EXPECT_NEAR(LoopAnalysis(model).stiffest(25), difference, 1e-6 * difference);
}

TEST(LoopAnalysis, AnObserverCostsMargin) {
  LoopModel model{.mass = 0.4, .viscous = 1.8, .delay = 1e-3, .lag = 0.5e-3};
  double before = LoopAnalysis(model).margins(3000, 25).modulus;
  for (const double bandwidth : {1.0, 5.0, 10.0, 20.0, 40.0}) {
    model.observer = {bandwidth, 0.4};
    const double modulus = LoopAnalysis(model).margins(3000, 25).modulus;
    EXPECT_LT(modulus, before) << bandwidth;
    before = modulus;
  }
}

TEST(LoopAnalysis, TheStiffestPairKeepsItsFloorAndNoneOfAGridIsStiffer) {
  const LoopAnalysis analysis({.mass = 0.4, .viscous = 1.8, .delay = 1e-3, .lag = 0.5e-3});
  const MarginFloor floor{.modulus = 0.5, .gain = 2};
  const AxisGains pair = analysis.stiffest_pair(floor);
  const Margins m = analysis.margins(pair.kp, pair.kd);
  EXPECT_GE(m.modulus, floor.modulus);
  EXPECT_GE(m.gain_up, floor.gain);
  EXPECT_LT(std::min(m.modulus / floor.modulus, m.gain_up / floor.gain), 1.01);
  for (double kd = 1; kd < 200; kd *= 1.1) {
    const Margins stiffer = analysis.margins(1.01 * pair.kp, kd);
    EXPECT_TRUE(stiffer.modulus < floor.modulus || stiffer.gain_up < floor.gain) << kd;
  }
  EXPECT_EQ(analysis.stiffest_pair({.modulus = 0.99, .gain = 1e6}).kp, 0);
}

TEST(LoopAnalysis, NothingIsStableWithoutStiffness) {
  const LoopAnalysis analysis({.mass = 0.4, .viscous = 2});
  EXPECT_FALSE(analysis.stable(0, 5));
  EXPECT_FALSE(analysis.stable(kNaN, 5));
  EXPECT_TRUE(analysis.stable(1e-6, 5));
  const Margins none = analysis.margins(0, 5);
  EXPECT_EQ(none.modulus, 0);
  EXPECT_EQ(none.gain_up, 0);
}

TEST(LoopAnalysis, NamesAParameterThatIsOutOfItsRange) {
  const auto error_of = [](const LoopModel& model) { return test::error_of([&] { const LoopAnalysis a(model); }); };
  EXPECT_EQ(error_of({.mass = 1}), "no error");
  EXPECT_THAT(error_of({.mass = 0}), testing::HasSubstr("mass is 0 kg"));
  EXPECT_THAT(error_of({.mass = 1, .viscous = -1}), testing::HasSubstr("viscous friction is -1"));
  EXPECT_THAT(error_of({.mass = 1, .delay = 1}), testing::HasSubstr("delay is 1 s"));
  EXPECT_THAT(error_of({.mass = 1, .velocity = "guess"}), testing::HasSubstr("'guess' is not known"));
  EXPECT_THAT(error_of({.mass = 1, .rate_hz = 20000, .velocity = "lowpass:0.1"}),
              testing::HasSubstr("impulse response of the velocity estimator"));
  PlantModel plant;
  plant.delay = 1e-3;
  EXPECT_THAT(test::error_of([&] { (void)loop_of(plant, 0, 1000, "difference", 2e-3); }),
              testing::HasSubstr("from 0 to the plant's delay"));
}

}  // namespace
}  // namespace haptrace
