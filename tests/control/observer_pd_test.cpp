#include "control/observer_pd.h"

#include "devices/sim/sim_device.h"
#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::DelayedMass;
using test::kNone;
using test::kPeriod;
using test::late_plant;
using test::resting_at;

/// The law in closed loop with the plant that it is designed for.
class ObservedLoop {
 public:
  explicit ObservedLoop(const PlantModel& model = late_plant(), double max_force = 8)
      : design(design_tracking(model, {.max_force = max_force})),
        law({.design = design, .position_resolution = model.position_resolution}),
        plant(model.mass, model.delay / kPeriod),
        max_force_(max_force),
        resolution_(model.position_resolution) {
    tuning.gains = design.gains;
    tuning.observer_hz = design.load_hz;
    State first;
    first.position = plant.x;
    law.start(first);
  }

  /// Runs one tick. `load(x, v)` acts in addition to the sent force; `known` is the force of the preceding terms.
  template <class Load>
  void tick(const Reference& reference, const Load& load, const Vec3& known = kNone) {
    State state;
    state.dt = first_ ? 0 : kPeriod;
    state.position = test::quantised(plant.x, resolution_);
    state.force_applied = sent;
    first_ = false;
    force = law.force({state, reference, tuning, known});
    sent = known + force + after;
    if (sent.norm() > max_force_) sent *= max_force_ / sent.norm();
    if (held) return;
    plant.advance(sent, load);
  }
  void tick(const Reference& reference, const Vec3& load = kNone, const Vec3& known = kNone) {
    tick(
        reference, [&](const Vec3&, const Vec3&) { return load; }, known);
  }
  void run(double seconds, const Reference& reference, const Vec3& load = kNone) {
    for (int i = 0; i < static_cast<int>(seconds / kPeriod); ++i) tick(reference, load);
  }

  TrackingDesign design;
  ObserverPd law;
  DelayedMass plant;
  Tuning tuning;
  Vec3 force = kNone;  ///< Force of the law [N].
  Vec3 sent = kNone;
  Vec3 after = kNone;  ///< Force of the terms after the law [N].
  bool held = false;   ///< A motionless hand holds the device.

 private:
  double max_force_, resolution_;
  bool first_ = true;
};

TEST(ObserverPd, CancelsAConstantLoadCompletely) {
  ObservedLoop loop;
  loop.run(3, resting_at(kNone), Vec3(2, -1, -3));
  EXPECT_LT(loop.plant.x.norm(), 1e-8);
  EXPECT_TRUE(loop.force.isApprox(-Vec3(2, -1, -3), 1e-6));
}

TEST(ObserverPd, CancelsOnlyTheLoadThatEarlierTermsMiss) {
  ObservedLoop loop;
  const Vec3 load(2, 0, -3), known(-1.5, 0, 3);
  for (int i = 0; i < 3000; ++i) loop.tick(resting_at(kNone), load, known);
  EXPECT_LT(loop.plant.x.norm(), 1e-8);
  EXPECT_LT((loop.force - (-load - known)).norm(), 1e-6);
}

TEST(ObserverPd, FollowsAMovementWithInertiaFeedforwardUpToTheErrorOfTheDelay) {
  ObservedLoop loop;
  double worst = 0;
  const double w = 6, radius = 0.03;
  for (int i = 0; i < 4000; ++i) {
    const double a = w * i * kPeriod;
    const Vec3 x(radius * std::sin(a), radius * (1 - std::cos(a)), 0);
    const Vec3 v(radius * w * std::cos(a), radius * w * std::sin(a), 0);
    const Vec3 acceleration(-radius * w * w * std::sin(a), radius * w * w * std::cos(a), 0);
    loop.after = late_plant().mass.cwiseProduct(acceleration);
    if (i > 2000) worst = std::max(worst, (x - loop.plant.x).norm());
    loop.tick({x, v, acceleration, 0});
  }
  // The feedforward acts late by the delay and half a tick, an error of m w^3 r 2.5 ms. The observer takes a tenth of
  // the mass for a load. The loop's stiffness resists both.
  const double inertia = 0.4 * w * w * radius;
  EXPECT_LT(worst, inertia * (w * 2.5e-3 + 0.11) / loop.design.gains.kp.x());
}

TEST(ObserverPd, SendsNoMoreThanItsAuthorityAgainstALoad) {
  ObservedLoop loop(late_plant(), 8);
  loop.held = true;
  loop.run(1, resting_at(Vec3(0.03, 0, 0)));  // a hand holds it against the device's full force
  loop.tuning.gains = {};
  loop.tick(resting_at(Vec3(0.03, 0, 0)));
  EXPECT_NEAR(loop.force.norm(), 0.7 * 8, 1e-9);
}

/// Returns the overshoot of the loop after a hand has held the device for `held` [s]; in metres.
double overshoot(double max_force, double held, double observer = 1) {
  ObservedLoop loop(late_plant(), max_force);
  loop.tuning.observer = observer;
  return test::overshoot_after(loop, held);
}

TEST(ObserverPd, DoesNotWindUpWhileTheUserHoldsTheDeviceStill) {
  for (const double force : {8.0, 20.0}) {
    const double never = overshoot(force, 0);
    for (const double seconds : {0.5, 5.0, 30.0})
      EXPECT_LT(overshoot(force, seconds), never + 4e-3) << "held for " << seconds << " s with " << force << " N";
    EXPECT_NEAR(overshoot(force, 30), overshoot(force, 1), 1e-6) << "however long";
  }
}

TEST(ObserverPd, DoesNotWindUpWhileTheDeviceSaturates) {
  for (const double force : {4.0, 8.0, 20.0})
    EXPECT_LT(overshoot(force, 0), overshoot(force, 0, 0) + 3e-3) << force << " N, beyond the ripple of a PD law";
}

TEST(ObserverPd, HasSofterGainsAtRestAndKeepsTheLoad) {
  constexpr double kQuantum = 5e-5;
  ObservedLoop loop(late_plant(kQuantum));
  const Vec3 load(1, 0, -2);
  loop.run(0.02, resting_at(kNone), load);
  EXPECT_EQ(loop.law.gains(loop.tuning).kp, loop.design.gains.kp);
  loop.run(1.98, resting_at(kNone), load);
  loop.held = true;
  loop.plant.x = kNone;
  loop.run(0.5, resting_at(kNone));
  EXPECT_LT((loop.law.gains(loop.tuning).kd - ObserverPd::kRestGains * loop.design.gains.kd).norm(), 1e-3);
  const Vec3 kept = loop.force;
  EXPECT_LT((kept + load).norm(), 0.3);
  // One count away, the law responds with a share of its gains and does not estimate the load again.
  loop.plant.x = Vec3(kQuantum, 0, 0);
  loop.run(0.5, resting_at(kNone));
  const Vec3 settled = loop.force;
  EXPECT_NEAR((settled - kept).x(), -ObserverPd::kRestGains * loop.design.gains.kp.x() * kQuantum, 0.02);
  loop.run(2, resting_at(kNone));
  EXPECT_LT((loop.force - settled).norm(), 1e-3) << "an observer would integrate";
}

TEST(ObserverPd, RestoresItsGainsWhenTheReferenceMovesOrTheDeviceIsFarther) {
  constexpr double kQuantum = 5e-5;
  ObservedLoop loop(late_plant(kQuantum));
  loop.run(1, resting_at(kNone));
  loop.held = true;
  loop.plant.x = Vec3(20 * kQuantum, 0, 0);
  loop.run(1, resting_at(kNone));
  EXPECT_LT(loop.force.x(), -0.9 * loop.design.gains.kp.x() * 20 * kQuantum);
}

TEST(ObserverPd, BeginsAndEndsRestWithoutAStepInTheForce) {
  constexpr double kQuantum = 5e-5;
  ObservedLoop loop(late_plant(kQuantum));
  // One encoder count causes a force step of this size in any tick, at rest or not.
  const double count =
      3 * kQuantum * (loop.design.gains.kp.norm() + loop.design.gains.kd.norm() * 2 * M_PI * loop.design.observer_hz);
  double largest = 0;
  Vec3 before = kNone;
  for (int i = 0; i < 8000; ++i) {
    // Rests for a second, creeps for a second.
    const double creep = (i / 1000) % 2 == 1 ? 2e-3 : 0;
    const double at = 2e-3 * (i / 2000 + std::max(0.0, (i % 2000 - 1000) * 1e-3));
    loop.tick({Vec3(at, 0, 0), Vec3(creep, 0, 0), kNone, 0},
              [](const Vec3&, const Vec3& v) -> Vec3 { return Vec3(1, 0, -2) + test::friction(v, 0.7, 2); });
    if (i > 500)
      largest = std::max(largest, (loop.force - before).norm() - 2e-3 * loop.design.gains.kd.x() * (i % 1000 == 0));
    before = loop.force;
  }
  EXPECT_LT(largest, count);
}

TEST(ObserverPd, ReplacesTheStoredLoadByTheMeasuredLoad) {
  constexpr double kQuantum = 5e-5;
  ObservedLoop loop(late_plant(kQuantum));
  loop.held = true;
  loop.run(0.5, resting_at(kNone));
  loop.plant.x = Vec3(kQuantum, 0, 0);
  loop.run(2, resting_at(kNone));
  const Vec3 before = loop.force;
  const Reference leaving{kNone, Vec3(2e-4, 0, 0), kNone, 0};
  loop.tick(leaving);
  EXPECT_LT((loop.force - before).norm(), 0.05);
  loop.held = true;
  for (int i = 0; i < 300; ++i) loop.tick(leaving);
  EXPECT_GT((loop.force - before).norm(), 0.2) << "the new load differs";
}

TEST(ObserverPd, DoesNotHuntAtRestWithStictionAndAFiniteResolution) {
  PlantModel model = late_plant(5e-5);
  model.coulomb = Vec3::Constant(0.7);
  model.viscous = Vec3::Constant(2);
  SimDevice device(sim_spec_of(model, 8));
  const TrackingDesign design = design_tracking(model, {.max_force = 8});
  ObserverPd law({.design = design, .position_resolution = model.position_resolution});
  const Tuning tuning{.gains = design.gains, .observer_hz = design.load_hz};
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
  EXPECT_LT(high - low, model.position_resolution) << "a limit cycle";
  EXPECT_NEAR(0.5 * (high + low), 0.01, 3 * model.position_resolution);
}

TEST(ObserverPd, CalmsADeviceThatRestsOnTheBristlesOfItsFriction) {
  constexpr double kQuantum = 5e-5, kDamping = 2;
  for (const double bristles : {0.0, 4000.0, 8000.0, 12000.0, 16000.0}) {
    ObservedLoop loop(late_plant(kQuantum));
    const auto friction = [&](const Vec3& x, const Vec3& v) { return Vec3(-bristles * x - kDamping * v); };
    for (int i = 0; i < 1500; ++i) loop.tick(resting_at(kNone), friction);
    // The initial velocity stays within the bounds of rest, but moves the device over a few counts.
    loop.plant.v = Vec3(0.012, 0, 0);
    double farthest = 0;
    for (int i = 0; i < 3000; ++i) {
      loop.tick(resting_at(kNone), friction);
      if (i >= 2500) farthest = std::max(farthest, loop.plant.x.norm());
    }
    EXPECT_LT(farthest, kQuantum) << bristles << " N/m";
  }
}

TEST(ObserverPd, DoesNotDriveAnAxisWithoutMassWhateverItsGains) {
  PlantModel model = late_plant(5e-5);
  model.mass.z() = 0;
  const TrackingDesign design = design_tracking(model, {.max_force = 8});
  ObserverPd law({.design = design, .position_resolution = 5e-5});
  const Tuning tuning{.gains = {Vec3::Constant(2000), Vec3::Constant(20)}};
  State state;
  law.start(state);
  Vec3 force = kNone;
  for (int i = 0; i < 1000; ++i) {
    state.dt = kPeriod;
    state.force_applied = force;
    state.position = Vec3(4e-5, 0, 1e-2 * std::sin(0.1 * i));
    // A playback's reference along an axis without a motor: the measured position.
    const Reference reference{Vec3(0, 0, state.position.z()), Vec3(0, 0, std::cos(0.1 * i)), kNone, 0};
    force = law.force({state, reference, tuning});
    ASSERT_EQ(force.z(), 0);
  }
  EXPECT_LT(std::abs(force.x()), 0.2) << "at rest, though a hand moves where there is no motor: nothing integrates";
}

TEST(ObserverPd, ScalesWithItsShares) {
  ObservedLoop all, none;
  none.tuning.observer = 0;
  const Vec3 load(1, 0, 0);
  all.run(3, resting_at(kNone), load);
  none.run(3, resting_at(kNone), load);
  EXPECT_LT(all.plant.x.norm(), 1e-8);
  EXPECT_GT(none.plant.x.x(), 0.5 / none.design.gains.kp.x()) << "a PD law gives way to a load";
}

TEST(ObserverPd, ForgetsEverythingWhenItStarts) {
  ObservedLoop used(late_plant(5e-5)), fresh(late_plant(5e-5));
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

TEST(ObserverPd, AllocatesNothing) {
  ObservedLoop loop(late_plant(5e-5));
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
