#include "control/passivity_layer.h"

#include "control/design/loop_analysis.h"
#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"
#include "tests/support/errors.h"

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <vector>

namespace haptrace {
namespace {

using std::numbers::pi;
using testing::HasSubstr;

/// A sampled spring below z = 0.
struct SampledWall {
  double stiffness;

  [[nodiscard]] double force(double z) const { return z < 0 ? -stiffness * z : 0; }
  [[nodiscard]] double stored(double z) const { return z < 0 ? 0.5 * stiffness * z * z : 0; }
};

/// A damped mass that a constant force presses down from 5 mm above a wall. The force of a tick acts for one period,
/// starting `delay` after the tick; the delay may be a fraction of a tick.
class PressedMass {
 public:
  struct Setup {
    double mass, viscous, push, rate_hz, delay, wall;
    bool layer;
    double max_damping;
    double resolution = 0, told_resolution = 0;  ///< Encoder resolution: the true one and the layer's setting [m].
  };

  explicit PressedMass(const Setup& setup)
      : setup_(setup),
        wall_{setup.wall},
        layer_({.delay = setup.delay,
                .rate_hz = setup.rate_hz,
                .max_damping = setup.max_damping,
                .resolution = setup.told_resolution}),
        sent_(static_cast<std::size_t>(setup.delay * setup.rate_hz) + 2, 0.0) {}

  void run(double duration) {
    const double period = 1 / setup_.rate_hz;
    State state;
    for (int tick = 0; tick * period < duration; ++tick) {
      state.position = test::quantised(Vec3(0, 0, z_), setup_.resolution);
      state.force_applied = Vec3(0, 0, sent_.front());
      const double seen = state.position.z();
      double force = wall_.force(seen);
      const Vec3 added = layer_.update(state, wall_.stored(seen));
      if (setup_.layer) force += added.z();
      state.dt = period;
      std::rotate(sent_.begin(), sent_.end() - 1, sent_.end());
      sent_.front() = force;
      const double part = setup_.delay * setup_.rate_hz - std::floor(setup_.delay * setup_.rate_hz);
      move(sent_.back(), part * period);
      move(sent_[sent_.size() - 2], (1 - part) * period);
      created_ = std::max(created_, work_ + wall_.stored(z_));
      fastest_ = std::max(fastest_, std::abs(v_));
      if (tick * period < duration - 0.2) continue;
      low_ = std::min(low_, z_);
      high_ = std::max(high_, z_);
    }
  }

  /// Returns the energy that the motor delivered beyond the wall's stored energy, at the worst tick [J].
  [[nodiscard]] double created() const { return created_; }
  [[nodiscard]] double fastest() const { return fastest_; }
  [[nodiscard]] double swing() const { return high_ - low_; }  ///< Peak to peak, in the last 0.2 s [m].

 private:
  void move(double force, double h) {
    // Exact solution of m v' = force - push - b v.
    const double b = setup_.viscous, tau = setup_.mass / b, last = (force - setup_.push) / b;
    const double gone = -std::expm1(-h / tau), dz = last * h + (v_ - last) * tau * gone;
    v_ += (last - v_) * gone;
    z_ += dz;
    work_ += force * dz;
  }

  Setup setup_;
  SampledWall wall_;
  PassivityLayer layer_;
  std::vector<double> sent_;  ///< newest first
  double z_ = 5e-3, v_ = 0, work_ = 0, created_ = 0, fastest_ = 0, low_ = 1, high_ = -1;
};

/// The result of moving a tool along given positions against a wall, by a hand that no force stops: the layer's
/// observations and forces.
struct Pressed {
  double created = 0;  ///< Energy created at the worst tick, calculated independently [J].
  double left = 0;     ///< Created energy that is left at the end [J].
  double seen = 0;     ///< The layer's own energy estimate at the end [J].
  double added = 0;    ///< Largest force of the layer [N].
};

template <class Motion>
Pressed pressed(const SampledWall& wall, const PassivityLayer::Options& options, double duration, const Motion& z_at) {
  PassivityLayer layer(options);
  const double period = 1 / options.rate_hz;
  const auto late = static_cast<std::size_t>(std::lround(options.delay * options.rate_hz));
  std::vector<double> sent(late + 1, 0.0);
  Pressed result;
  State state;
  double before = z_at(0.0), work = 0;
  const double held = wall.stored(before);
  for (int tick = 0; tick * period <= duration; ++tick) {
    const double z = tick == 0 ? before : z_at(tick * period);
    work += sent.back() * (z - before);  // the delay is a whole number of ticks
    result.left = work + wall.stored(z) - held;
    result.created = std::max(result.created, result.left);
    state.position = Vec3(0, 0, z);
    state.force_applied = Vec3(0, 0, sent.front());
    const Vec3 added = layer.update(state, wall.stored(z));
    result.added = std::max(result.added, added.norm());
    std::rotate(sent.begin(), sent.end() - 1, sent.end());
    sent.front() = wall.force(z) + added.z();
    state.dt = period;
    before = z;
  }
  result.seen = layer.energy();
  return result;
}

TEST(PassivityLayer, MeasuresTheEnergyThatASampledLateSpringCreates) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (const double rate : {100.0, 1000.0, 20000.0})
    for (const int late : {0, 1, 3}) {
      double z = -5e-3;
      const auto wander = [&](double) { return z += 1e-4 * normal(random) - 0.01 * (z + 5e-3); };
      const Pressed result =
          pressed({.stiffness = 3000}, {.delay = late / rate, .rate_hz = rate, .max_damping = 0}, 2000 / rate, wander);
      EXPECT_GT(result.left, 0) << "the spring created no energy";
      EXPECT_NEAR(result.seen, result.left, 1e-9 * result.left) << rate << " Hz, " << late << " ticks late";
    }
}

TEST(PassivityLayer, DoesNothingWhileTheWallIsPassive) {
  // The wall is passive like one in continuous time: in each tick the mean force of spring and damper acts. A sampled
  // wall cannot know this force in advance.
  for (const double rate : {250.0, 1000.0, 10000.0}) {
    const double stiffness = 2000, period = 1 / rate;
    PassivityLayer layer({.delay = 0, .rate_hz = rate, .max_damping = 50});
    State state;
    double before = 0;
    for (int tick = 0; tick < 4000; ++tick) {
      const double z = -2e-3 * std::pow(std::sin(2 * pi * 3 * tick * period), 2);
      state.position = Vec3(0, 0, z);
      state.force_applied = Vec3(0, 0, -stiffness * (z + before) / 2 - 0.1 * (z - before) / period);
      ASSERT_EQ(layer.update(state, 0.5 * stiffness * z * z), Vec3::Zero()) << rate << " Hz, tick " << tick;
      state.dt = period;
      before = z;
    }
    EXPECT_LT(layer.energy(), 0);
  }
}

TEST(PassivityLayer, GivesAPressedHandAtMostTheWorkOfOneTick) {
  // Whatever the hand does, the layer gives it no more energy than arises before a damping force can act: one tick's
  // work, and that of the ticks of delay.
  for (const double rate : {100.0, 300.0, 1000.0, 4000.0, 20000.0})
    for (const int late : {0, 1, 2})
      for (const double share : {0.1, 0.5}) {
        const double period = 1 / rate, most = 40, stiffness = share * most / ((0.5 + late) * period);
        const double depth = 4e-3, hz = 2, fastest = depth * pi * hz;
        const auto press = [&](double t) { return depth * (0.2 - std::pow(std::sin(pi * hz * t), 2)); };
        const PassivityLayer::Options options{.delay = late * period, .rate_hz = rate, .max_damping = most};
        const Pressed bare =
                          pressed({stiffness}, {.delay = options.delay, .rate_hz = rate, .max_damping = 0}, 2, press),
                      kept = pressed({stiffness}, options, 2, press);
        SCOPED_TRACE(fmt::format("{} Hz, {} ticks late, {:.0f} N/m", rate, late, stiffness));
        const double tick = stiffness * std::pow((0.5 + late) * fastest * period, 2);
        EXPECT_LT(kept.created, 4 * (1 + late) * tick);
        EXPECT_GT(bare.left, 4 * kept.created) << "without the layer, more energy is created";
        EXPECT_GT(kept.added, 0);
      }
}

TEST(PassivityLayer, BringsAMassToRestThatWouldBounceOffAWallForEver) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(0, 1);
  const auto between = [&](double low, double high) { return low * std::pow(high / low, number(random)); };
  for (int i = 0; i < 60; ++i) {
    PressedMass::Setup setup{.mass = between(0.05, 1),
                             .viscous = 0,
                             .push = between(0.3, 3),
                             .rate_hz = between(100, 20000),
                             .delay = 0,
                             .wall = 0,
                             .layer = false,
                             .max_damping = 0};
    setup.delay = std::array{0.0, 0.3, 1.0, 2.6}[static_cast<std::size_t>(i) % 4] / setup.rate_hz;
    setup.max_damping = bearable_damping({.mass = setup.mass, .delay = setup.delay, .rate_hz = setup.rate_hz});
    ASSERT_GT(setup.max_damping, 0);
    // The wall requires this damping of a device; the device has a fifth of it.
    const double lag = 0.5 / setup.rate_hz + setup.delay,
                 asked = std::min(between(0.01, 0.2) * setup.max_damping, 20.0);
    setup.wall = asked / lag;
    setup.viscous = 0.2 * asked;
    PressedMass bare(setup);
    setup.layer = true;
    PressedMass kept(setup);
    const double duration = 0.5 + 40 * setup.mass / setup.viscous;
    bare.run(duration);
    kept.run(duration);
    SCOPED_TRACE(fmt::format("{}: {:.3f} kg, {:.1f} N, {:.0f} Hz, {:.2f} ticks late, {:.0f} N/m, {:.1f} N s/m", i,
                             setup.mass, setup.push, setup.rate_hz, setup.delay * setup.rate_hz, setup.wall,
                             setup.max_damping));
    const double tick = setup.wall * std::pow(lag * kept.fastest(), 2);
    EXPECT_LT(kept.created(), 6 * tick) << "J";
    EXPECT_LT(kept.swing(), 1e-8) << "it rests";
    EXPECT_GT(bare.swing(), 1e-5) << "without the layer it does not";
  }
}

/// Returns the stiffness [N/m] up to which every wall lets a device come to rest. The device has a delay [s] and an
/// encoder resolution [m]; the layer is configured with the resolution `told` [m].
double stiffest_kept(double rate_hz, double delay, double resolution, double told) {
  const LoopModel device{.mass = 0.4, .viscous = 1.8, .delay = delay, .rate_hz = rate_hz, .resolution = told};
  double stiffest = 0;
  for (double wall = 500; wall < 1e5; wall *= std::pow(10, 0.1)) {
    PressedMass mass({.mass = 0.4,
                      .viscous = 1.8,
                      .push = 2.6,
                      .rate_hz = rate_hz,
                      .delay = delay,
                      .wall = wall,
                      .layer = true,
                      .max_damping = bearable_damping(device),
                      .resolution = resolution,
                      .told_resolution = told});
    mass.run(3);
    if (!(mass.swing() < 3 * std::max(resolution, 1e-5))) break;
    stiffest = wall;
  }
  return stiffest;
}

TEST(PassivityLayer, AccountsForForcesThatALateDeviceHasNotAppliedYet) {
  // With a delay of 30 ticks, a layer that ignores pending forces would damp in 30 ticks for energy that one tick takes
  // back. Friction alone withstands 1.8 N s/m / 1.5 ms = 1200 N/m.
  for (const double rate : {1000.0, 2000.0, 5000.0, 10000.0, 20000.0})
    EXPECT_GT(stiffest_kept(rate, 1.5e-3, 0, 0), 2e4) << rate << " Hz";
}

TEST(PassivityLayer, DampsLongerThanATickIfTheResolutionIsCoarserThanItsTravel) {
  // At 0.05 m/s an encoder count of 60 um lasts 24 ticks at 20 kHz. A layer that takes the step in one tick for the
  // speed of the hand damps in one tick of 24, and requests ever more damping.
  constexpr double kQuantum = 6e-5;
  for (const double rate : {2000.0, 5000.0, 10000.0, 20000.0})
    EXPECT_GT(stiffest_kept(rate, 5e-4, kQuantum, kQuantum), 1.1 * stiffest_kept(rate, 5e-4, kQuantum, 0))
        << rate << " Hz";
  EXPECT_EQ(PassivityLayer::held_ticks(1000, 0), 1);
  EXPECT_EQ(PassivityLayer::held_ticks(1000, 1e-4), 1);
  EXPECT_EQ(PassivityLayer::held_ticks(20000, kQuantum), 12);
}

TEST(PassivityLayer, DampsAlongTheForceAndNotSliding) {
  PassivityLayer layer({.delay = 0, .rate_hz = 1000, .max_damping = 20});
  const double stiffness = 5000;
  State state;
  Vec3 sent = Vec3::Zero();
  double most = 0;
  for (int tick = 0; tick < 1000; ++tick) {
    const double z = -1e-3 - 5e-4 * std::sin(0.05 * tick);
    state.position = Vec3(3e-4 * tick, 0, z);
    state.force_applied = sent;
    const Vec3 added = layer.update(state, 0.5 * stiffness * z * z);
    EXPECT_EQ(added.x(), 0) << tick;
    most = std::max(most, std::abs(added.z()));
    sent = Vec3(0, 0, -stiffness * z) + added;
    state.dt = 1e-3;
  }
  EXPECT_GT(most, 0) << "it worked";
}

TEST(PassivityLayer, ForgetsTheCreditOfAContactThatIsOver) {
  PassivityLayer layer({.delay = 0, .rate_hz = 1000, .max_damping = 20});
  State state;
  const auto at = [&](double z, double sent, double stored) {
    state.position = Vec3(0, 0, z);
    state.force_applied = Vec3(0, 0, sent);
    (void)layer.update(state, stored);
    state.dt = 1e-3;
  };
  at(0, 0, 0);
  at(-1e-3, 3, 0.001);  // the tool absorbed 3 mJ, and the spring holds 1 mJ
  EXPECT_NEAR(layer.energy(), -2e-3, 1e-15);
  at(-1e-3, 3, 0.001);
  EXPECT_NEAR(layer.energy(), -2e-3, 1e-15) << "the credit stays during the contact";
  at(0, 1, 0);
  EXPECT_NEAR(layer.energy(), -2e-3, 1e-15) << "a force was still acting";
  at(0.001, 0, 0);
  EXPECT_EQ(layer.energy(), 0);
  at(0.002, 1, 0);
  EXPECT_NEAR(layer.energy(), 1e-3, 1e-15);
  at(0.002, 0, 0);
  EXPECT_NEAR(layer.energy(), 1e-3, 1e-15) << "a debt is not forgotten";
  layer.reset();
  at(-5e-3, 1, 1);
  EXPECT_EQ(layer.energy(), 0) << "the history is unknown";
}

TEST(PassivityLayer, ReturnsNoForceForInvalidStatesAndKeepsItsMemory) {
  const auto run = [](bool nonsense) {
    PassivityLayer layer({.delay = 1e-3, .rate_hz = 1000, .max_damping = 20});
    State state;
    for (int tick = 0; tick < 50; ++tick) {
      const double z = -1e-3 - 5e-4 * std::sin(0.3 * tick);
      state.position = Vec3(0, 0, z);
      state.force_applied = Vec3(0, 0, -5000 * z);
      if (nonsense) {
        State bad = state;
        bad.position.y() = kNaN;
        EXPECT_EQ(layer.update(bad, 1), Vec3::Zero());
        bad = state;
        bad.force_applied.x() = std::numeric_limits<double>::infinity();
        EXPECT_EQ(layer.update(bad, 1), Vec3::Zero());
        EXPECT_EQ(layer.update(state, kNaN), Vec3::Zero());
      }
      EXPECT_TRUE(is_finite(layer.update(state, 0.5 * 5000 * z * z)));
      state.dt = 1e-3;
    }
    return layer.energy();
  };
  EXPECT_NE(run(false), 0);
  EXPECT_EQ(run(true), run(false));
}

TEST(PassivityLayer, AllocatesNothing) {
  PassivityLayer layer({.delay = 2.5e-3, .rate_hz = 1000, .max_damping = 20});
  State state;
  state.dt = 1e-3;
  const std::size_t before = test::allocations();
  layer.reset();
  for (int tick = 0; tick < 100; ++tick) {
    state.position.z() = -1e-3 * std::sin(0.3 * tick);
    state.force_applied.z() = -5000 * state.position.z();
    (void)layer.update(state, 2500 * state.position.squaredNorm());
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(PassivityLayer, NamesAParameterThatIsOutOfItsRange) {
  EXPECT_THAT(test::error_of([] { PassivityLayer({.delay = 1}); }), HasSubstr("the delay is 1 s"));
  EXPECT_THAT(test::error_of([] { PassivityLayer({.rate_hz = 1}); }), HasSubstr("the rate is 1 Hz"));
  EXPECT_THAT(test::error_of([] { PassivityLayer({.max_damping = kNaN}); }), HasSubstr("the damping"));
}

TEST(DampingLimit, IsHalfOfTheDampingThatDestabilisesTheFreeDevice) {
  // Without a delay, the mean speeds w of the ticks obey w' = w - c T / m (w + w_before) / 2, which is stable up to
  // c = 2 m / T.
  EXPECT_NEAR(bearable_damping({.mass = 0.2, .rate_hz = 1000}), 0.2 * 1000, 0.5);
  const LoopModel late{.mass = 0.2, .viscous = 1, .delay = 1.5e-3, .rate_hz = 1000};
  LoopModel lighter = late, quicker = late, later = late;
  lighter.mass = 0.1;
  quicker.rate_hz = 10000;
  later.delay = 3e-3;
  EXPECT_LT(bearable_damping(lighter), bearable_damping(late));
  EXPECT_LT(bearable_damping(later), bearable_damping(late));
  EXPECT_GT(bearable_damping(quicker), bearable_damping(late));
}

}  // namespace
}  // namespace haptrace
