#include "control/lqg_law.h"

#include "control/design/lqg_search.h"
#include "control/ripple.h"
#include "devices/sim/noise.h"
#include "devices/sim/sim_device.h"
#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"

#include <Eigen/Cholesky>

#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::DelayedMass;
using test::kNone;
using test::kPeriod;
using test::resting_at;

constexpr double kEncoder = 5e-5;

AxisModel axis_of(double mass, double delay_ticks = 2) {
  return {.mass = mass, .delay_ticks = delay_ticks, .hand = kHardlyAHand, .position_noise = kEncoder / std::sqrt(12.0)};
}

LqgLaw::Options law_of(const Vec3& mass, double delay_ticks = 2, double resolution = 0) {
  LqgLaw::Options options{.position_resolution = resolution, .authority = 5.6};
  for (int axis = 0; axis < 3; ++axis)
    if (mass[axis] > 0)
      options.axes[static_cast<std::size_t>(axis)] = {
          *design_lqg(axis_of(mass[axis], delay_ticks), {.ripple_weight = 3e-8, .mass_factor = 1, .hand_share = 1}),
          *design_lqg_for_rest(axis_of(mass[axis], delay_ticks), 0.115)};
  return options;
}

/// The law in closed loop with a free mass behind a delay of two ticks.
class LqgDevice {
 public:
  explicit LqgDevice(double resolution = 0, double max_force = 8)
      : LqgDevice(law_of(kMass, 2, resolution), resolution, max_force) {}

  LqgDevice(const LqgLaw::Options& options, double resolution, double max_force)
      : law(options),
        plant(kMass, 2),
        stiffness(gains_of(options.axes).kp),
        max_force_(max_force),
        resolution_(resolution) {
    tuning.gains = gains_of(options.axes);
    State first;
    first.position = plant.x;
    law.start(first);
  }

  /// Runs one tick. `load(x, v)` acts in addition to the sent force; `known` is the force of the other terms.
  template <class Load>
  void tick(const Reference& reference, const Load& load, const Vec3& known = kNone) {
    State state;
    state.dt = first_ ? 0 : kPeriod;
    state.position = test::quantised(plant.x, resolution_);
    state.force_applied = sent;
    first_ = false;
    force = law.force({state, reference, tuning, known});
    sent = known + force;
    if (sent.norm() > max_force_) sent *= max_force_ / sent.norm();
    if (!held) plant.advance(sent, load);
  }
  void tick(const Reference& reference, const Vec3& load = kNone, const Vec3& known = kNone) {
    tick(
        reference, [&](const Vec3&, const Vec3&) { return load; }, known);
  }
  void run(double seconds, const Reference& reference, const Vec3& load = kNone) {
    for (int i = 0; i < static_cast<int>(seconds / kPeriod); ++i) tick(reference, load);
  }

  static inline const Vec3 kMass{0.4, 0.4, 0.3};

  LqgLaw law;
  DelayedMass plant;
  Vec3 stiffness;
  Tuning tuning;
  Vec3 force = kNone;  ///< Force of the law [N].
  Vec3 sent = kNone;
  bool held = false;  ///< A motionless hand holds the device.

 private:
  double max_force_, resolution_;
  bool first_ = true;
};

TEST(LqgLaw, BehavesOnItsModelAsItsDesignPredicts) {
  for (const double delay : {0.0, 1.0, 2.4}) {
    AxisModel model = axis_of(0.4, delay);
    model.lag = 0.5e-3;
    model.hand = kRelaxedHand;
    model.noise = kHealthyHand;
    model.force_noise = 0.005;
    const auto law = design_lqg(model, 2e-8);
    ASSERT_TRUE(law);
    const DiscreteAxis& plant = law->model;
    const auto predicted = LqgLoop(*law, plant).figures();
    ASSERT_TRUE(predicted);

    LqgFeedback feedback(*law);
    feedback.start(0);
    const Eigen::MatrixXd root = plant.noise.ldlt().matrixL();
    const Eigen::LDLT<Eigen::MatrixXd> factors(plant.noise);
    const Eigen::MatrixXd noise_from = factors.transpositionsP().transpose() *
                                       Eigen::MatrixXd(root * factors.vectorD().cwiseMax(0).cwiseSqrt().asDiagonal());
    Gaussian gaussian(3, 1);
    Eigen::VectorXd x = Eigen::VectorXd::Zero(plant.states());
    std::vector<double> sent(static_cast<std::size_t>(plant.delay) + 2, 0.0);  // newest first
    Ripple ripple(kRippleCutoff, 1000);
    double error2 = 0, ripple2 = 0, u = 0;
    constexpr int kTicks = 400'000;
    for (int tick = 0; tick < kTicks; ++tick) {
      feedback.update(x[0] + model.position_noise * gaussian(), kPeriod, u);
      const auto forces = feedback.forces();
      u = forces.spring + forces.other + forces.load;
      std::rotate(sent.rbegin(), sent.rbegin() + 1, sent.rend());
      sent[0] = u;
      error2 += x[0] * x[0];
      ripple2 += ripple.update(Vec3(u, 0, 0));
      Eigen::VectorXd white(plant.states());
      for (double& w : white) w = gaussian();
      x = plant.transition * x + plant.newer * sent[static_cast<std::size_t>(plant.delay)] +
          plant.older * sent[static_cast<std::size_t>(plant.delay) + 1] + noise_from * white;
    }
    EXPECT_NEAR(std::sqrt(error2 / kTicks), predicted->error, 0.03 * predicted->error) << delay;
    EXPECT_NEAR(std::sqrt(ripple2 / kTicks), predicted->ripple, 0.02 * predicted->ripple) << delay;
  }
}

TEST(LqgLaw, CancelsAConstantLoad) {
  LqgDevice loop;
  const Vec3 load(2, -1, -3);
  loop.run(3, resting_at(kNone), load);
  // The model expects a drift to fade, which leaves a small part of it to the stiffness.
  EXPECT_LT(loop.plant.x.norm(), 5e-5 * load.norm());
  EXPECT_TRUE(loop.force.isApprox(-load, 1e-6));
}

TEST(LqgLaw, FollowsAMovementWhoseForcesAreKnownExactly) {
  LqgDevice loop;
  double worst = 0;
  const double w = 6, radius = 0.03, late = 2.5 * kPeriod;
  for (int i = 0; i < 4000; ++i) {
    const double a = w * i * kPeriod, b = a + w * late;
    const Vec3 x(radius * std::sin(a), radius * (1 - std::cos(a)), 0);
    const Vec3 v(radius * w * std::cos(a), radius * w * std::sin(a), 0);
    const Vec3 later(-radius * w * w * std::sin(b), radius * w * w * std::cos(b), 0);
    if (i > 2000) worst = std::max(worst, (x - loop.plant.x).norm());
    loop.tick({x, v, later, 0}, kNone, LqgDevice::kMass.cwiseProduct(later));
  }
  EXPECT_LT(worst, 1e-6) << "the feedforward of a held force leaves only what it lacks between two ticks";
}

TEST(LqgLaw, SendsNoMoreThanItsAuthorityAgainstALoad) {
  LqgDevice loop;
  loop.held = true;
  loop.run(1, resting_at(Vec3(0.03, 0, 0)));
  loop.tuning.gains = {};
  loop.tick(resting_at(Vec3(0.03, 0, 0)));
  EXPECT_LE(loop.force.norm(), 5.6 + 1e-9);
}

TEST(LqgLaw, IsStiffAgainstALoadThatItDoesNotKnowYet) {
  LqgDevice loop;
  double farthest = 0;
  for (int i = 0; i < 500; ++i) {
    loop.tick(resting_at(kNone), Vec3(1, 0, 0));
    farthest = std::max(farthest, loop.plant.x.x());
  }
  EXPECT_LT(farthest, 3 / loop.stiffness.x());
}

/// Returns the overshoot of the loop after a hand has held the device for `held` [s]; in metres.
double lqg_overshoot(double max_force, double held) {
  LqgDevice loop(0, max_force);
  return test::overshoot_after(loop, held);
}

TEST(LqgLaw, DoesNotWindUpWhileTheUserHoldsTheDeviceStill) {
  for (const double force : {8.0, 20.0}) {
    const double never = lqg_overshoot(force, 0);
    for (const double seconds : {0.5, 5.0, 30.0})
      EXPECT_LT(lqg_overshoot(force, seconds), never + 4e-3) << "held for " << seconds << " s with " << force << " N";
    EXPECT_NEAR(lqg_overshoot(force, 30), lqg_overshoot(force, 5), 1e-6) << "however long";
  }
}

TEST(LqgLaw, KeepsTheLoadAtRestWithSofterGains) {
  LqgDevice loop(kEncoder);
  const Vec3 load(1, 0, -2);
  loop.run(0.05, resting_at(kNone), load);
  EXPECT_TRUE(loop.law.gains(loop.tuning).kp.isApprox(loop.stiffness));
  loop.run(1.95, resting_at(kNone), load);
  loop.held = true;
  loop.plant.x = kNone;
  loop.run(0.5, resting_at(kNone));
  const LqgAxis resting = law_of(LqgDevice::kMass, 2, kEncoder).axes[0]->resting;
  EXPECT_NEAR(loop.law.gains(loop.tuning).kp.x(), resting.stiffness, 1e-3 * loop.stiffness.x());
  EXPECT_NEAR(loop.law.gains(loop.tuning).kd.x(), resting.damping, 1e-2 * resting.damping);
  const Vec3 kept = loop.force;
  EXPECT_LT((kept + load).norm(), 0.4);
  loop.plant.x = Vec3(kEncoder, 0, 0);
  loop.run(1, resting_at(kNone));
  const Vec3 settled = loop.force;
  EXPECT_LT((settled - kept).norm(), 3 * loop.stiffness.x() * kEncoder);
  loop.run(4, resting_at(kNone));
  EXPECT_LT((loop.force - settled).norm(), 0.05) << "an observer would integrate";
}

TEST(LqgLaw, DoesNotHuntAtRestWithStictionAndAFiniteResolution) {
  PlantModel model = test::late_plant(kEncoder);
  model.coulomb = Vec3::Constant(0.7);
  model.viscous = Vec3::Constant(2);
  SimDevice device(sim_spec_of(model, 8));
  const LqgLaw::Options options = law_of(model.mass, 2, kEncoder);
  LqgLaw law(options);
  Tuning tuning;
  tuning.gains = gains_of(options.axes);
  State state;
  DeviceState answer;
  double low = 1, high = -1;
  for (int i = 0; i < 8000; ++i) {
    state.dt = i == 0 ? 0 : kPeriod;
    (void)device.exchange({.force = state.force_applied}, state.dt, answer);
    state.position = answer.position;
    if (i == 0) law.start(state);
    const double way = std::min(0.01, 2e-5 * i);
    state.force_applied = law.force({state, {Vec3(way, 0, 0), Vec3(way < 0.01 ? 0.02 : 0, 0, 0), kNone, 0}, tuning});
    if (i < 3000) continue;
    low = std::min(low, device.true_position().x());
    high = std::max(high, device.true_position().x());
  }
  EXPECT_LT(high - low, kEncoder) << "a limit cycle";
  EXPECT_NEAR(0.5 * (high + low), 0.01, 3 * kEncoder);
}

TEST(LqgLaw, CalmsADeviceThatRestsOnTheBristlesOfItsFriction) {
  for (const double bristles : {0.0, 4000.0, 8000.0, 12000.0, 16000.0}) {
    LqgDevice loop(kEncoder);
    const auto friction = [&](const Vec3& x, const Vec3& v) { return Vec3(-bristles * x - 2 * v); };
    for (int i = 0; i < 1500; ++i) loop.tick(resting_at(kNone), friction);
    loop.plant.v = Vec3(0.012, 0, 0);
    double farthest = 0;
    for (int i = 0; i < 3000; ++i) {
      loop.tick(resting_at(kNone), friction);
      if (i >= 2500) farthest = std::max(farthest, loop.plant.x.norm());
    }
    EXPECT_LT(farthest, kEncoder) << bristles << " N/m";
  }
}

TEST(LqgLaw, BeginsAndEndsRestWithoutAStepInTheForce) {
  LqgDevice loop(kEncoder);
  double moving = 0, all = 0;
  Vec3 before = kNone;
  for (int i = 0; i < 8000; ++i) {
    // Rests for a second, creeps for a second.
    const bool creeps = (i / 1000) % 2 == 1;
    const double at = 2e-3 * (i / 2000 + std::max(0.0, (i % 2000 - 1000) * 1e-3));
    loop.tick({Vec3(at, 0, 0), Vec3(creeps ? 2e-3 : 0, 0, 0), kNone, 0},
              [](const Vec3&, const Vec3& v) -> Vec3 { return Vec3(1, 0, -2) + test::friction(v, 0.7, 2); });
    const double step = (loop.force - before).norm();
    if (i > 500) all = std::max(all, step);
    if (i > 500 && creeps && i % 1000 > 300) moving = std::max(moving, step);
    before = loop.force;
  }
  EXPECT_LT(all, 2 * moving) << "the largest step is that of an encoder count, or of the reference that sets off";
}

TEST(LqgLaw, HoldsItsForceThroughMissedTicks) {
  // The same movement, once with every tick and once without every fifth: the estimates agree where both have one.
  const auto options = law_of(Vec3(0.4, 0, 0));
  LqgFeedback all(options.axes[0]->moving), some(options.axes[0]->moving);
  all.start(0);
  some.start(0);
  double force = 0, x = 0;
  for (int i = 1; i <= 100; ++i) {
    x = 1e-3 * std::sin(0.05 * i);
    const bool missed = i % 5 == 4;
    all.update(x, kPeriod, force);
    if (!missed) some.update(x, i % 5 == 0 ? 2 * kPeriod : kPeriod, force);
    if (!missed) {
      const auto forces = all.forces();
      // Both get the force of the law that saw everything; it is held while a tick is missed.
      if (i % 5 != 3) force = forces.spring + forces.other + forces.load;
    }
  }
  const auto a = all.forces(), b = some.forces();
  EXPECT_NEAR(b.spring + b.other + b.load, a.spring + a.other + a.load, 0.15 * std::abs(a.spring + a.other + a.load));
}

TEST(LqgLaw, RestartsAtRestAfterALongGapAndKeepsTheLoad) {
  LqgDevice loop;
  const Vec3 load(1, 0, 0);
  loop.run(3, resting_at(kNone), load);
  State state;
  state.dt = 0.1;
  state.position = Vec3(0.01, 0, 0);
  state.force_applied = loop.sent;
  const Vec3 force = loop.law.force({state, resting_at(Vec3(0.01, 0, 0)), loop.tuning});
  EXPECT_LT((force + load).norm(), 0.2);
}

TEST(LqgLaw, DoesNotDriveAnAxisWithoutMassWhateverItsGains) {
  const LqgLaw::Options options = law_of(Vec3(0.4, 0.4, 0), 2, kEncoder);
  LqgLaw law(options);
  Tuning tuning;
  tuning.gains = {Vec3::Constant(2000), Vec3::Constant(20)};
  State state;
  law.start(state);
  for (int i = 0; i < 1000; ++i) {
    state.dt = i == 0 ? 0 : kPeriod;
    state.position = Vec3(4e-5, 0, 1e-2 * std::sin(0.1 * i));
    const Reference reference{Vec3(0, 0, state.position.z()), Vec3(0, 0, std::cos(0.1 * i)), kNone, 0};
    const Vec3 force = law.force({state, reference, tuning});
    ASSERT_EQ(force.z(), 0);
    state.force_applied = force;
  }
}

TEST(LqgLaw, IsExactForAFreeMassOfAnotherSizeWhenItIsScaled) {
  // A device of twice the mass under forces of twice the size moves as the one that the law was designed for.
  LqgDevice one;
  LqgLaw::Options options = law_of(LqgDevice::kMass);
  options.inertia = {.least = Vec3::Constant(2), .most = Vec3::Constant(2)};
  LqgLaw law(options);
  DelayedMass heavy(2 * LqgDevice::kMass, 2);
  State state;
  law.start(state);
  for (int i = 0; i < 500; ++i) {
    const Reference reference = resting_at(Vec3(i < 250 ? 1e-4 : 0, 0, 0));
    one.tick(reference);
    state.dt = i == 0 ? 0 : kPeriod;
    state.position = heavy.x;
    state.force_applied = law.force({state, reference, one.tuning});
    heavy.advance(state.force_applied, kNone);
    ASSERT_LT((heavy.x - one.plant.x).norm(), 1e-12) << i;
  }
}

TEST(LqgLaw, CountsTheMassFromThatForWhichItIsDesigned) {
  LqgLaw::Options options = law_of(LqgDevice::kMass);
  LqgLaw one(options);
  options.inertia = {.least = Vec3::Constant(0.5), .most = Vec3::Constant(0.5)};
  options.designed_for = Vec3::Constant(0.5);
  LqgLaw other(options);
  Tuning tuning;
  tuning.gains = gains_of(options.axes);
  State state;
  one.start(state);
  other.start(state);
  for (int i = 0; i < 100; ++i) {
    state.dt = i == 0 ? 0 : kPeriod;
    state.position.x() = 1e-4 * std::sin(0.1 * i);
    const TermInput input{state, resting_at(kNone), tuning, kNone};
    const Vec3 force = one.force(input);
    ASSERT_LT((other.force(input) - force).norm(), 1e-12) << i;
    state.force_applied = force;
  }
}

TEST(InertiaMap, StatesTheTypicalMassAndItsRangeOverThePlacesThatItKnows) {
  InertiaMap map{.centre = Vec3(0, 0.1, 0), .reach = Vec3(0.06, 0, 0), .least = Vec3::Constant(0.2)};
  EXPECT_EQ(map.typical(), Vec3::Ones());
  map.bend(0, 0) = -0.5 / (0.06 * 0.06);  // half of the mass at the reach, for the axis x alone
  EXPECT_NEAR(map.typical().x(), std::sqrt((1 + 2 * 0.875 * 0.875 + 2 * 0.25) / 5), 1e-12);
  EXPECT_EQ(map.typical().y(), 1);
  EXPECT_NEAR(map.range().first.x(), 0.5, 1e-12);
  EXPECT_EQ(map.range().second, Vec3::Ones());
}

TEST(LqgLaw, ForgetsEverythingWhenItStarts) {
  LqgDevice used(kEncoder), fresh(kEncoder);
  used.run(2, resting_at(Vec3(0.01, 0, 0)), Vec3(2, 1, 0));  // until the law is at rest
  State state;
  state.position = Vec3(0.1, 0, 0);
  used.law.start(state);
  fresh.law.start(state);
  for (int i = 0; i < 100; ++i) {
    state.dt = i == 0 ? 0 : kPeriod;
    state.position.x() += 1e-5 * (i % 3);
    const Reference reference = resting_at(Vec3(0.1, 0, 0));
    const Vec3 force = used.law.force({state, reference, used.tuning});
    ASSERT_EQ(force, fresh.law.force({state, reference, fresh.tuning}));
    state.force_applied = force;
  }
}

TEST(LqgLaw, ForgetsAMovementCompletely) {
  LqgFeedback feedback(law_of(LqgDevice::kMass).axes[0]->moving);
  feedback.start(1e-3);
  for (int i = 0; i < 600'000; ++i) feedback.update(0, kPeriod, 0);
  const auto forces = feedback.forces();
  EXPECT_EQ(forces.spring, 0);
  EXPECT_EQ(forces.other, 0);
  EXPECT_EQ(forces.load, 0);
}

TEST(LqgLaw, AllocatesNothing) {
  LqgDevice loop(kEncoder);
  State state;
  const Reference reference = resting_at(Vec3(1e-5, 0, 0));
  const std::size_t before = test::allocations();
  loop.law.start(state);
  for (int i = 0; i < 200; ++i) {
    state.dt = kPeriod;
    state.force_applied = loop.law.force({state, reference, loop.tuning});
  }
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
