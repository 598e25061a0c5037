#include "control/state_observer.h"

#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"

#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using test::DelayedMass;
using test::kNone;
using test::kPeriod;

const Vec3 kMass(0.4, 0.2, 0.3);

struct Forces {
  std::mt19937 engine{1};

  /// Returns a random force of a few newtons, a new one at every call.
  Vec3 next() {
    const auto even = [&] { return static_cast<double>(engine()) / 2147483648.0 - 1; };
    const double x = even(), y = even();
    return 5 * Vec3(x, y, even());
  }
};

StateObserver observer_of(double delay_ticks, double bandwidth_hz = 20) {
  return StateObserver({.mass = kMass, .delay = delay_ticks * kPeriod, .bandwidth_hz = bandwidth_hz});
}

/// A plant and its observer, which receive the same forces.
struct Pair {
  explicit Pair(double delay_ticks, double bandwidth_hz = 20)
      : plant(kMass, delay_ticks), observer(observer_of(delay_ticks, bandwidth_hz)) {}

  /// Runs one tick under `force`; its part `known` cancels a part of `load`.
  void tick(const Vec3& force, const Vec3& load = kNone, const Vec3& known = kNone) {
    plant.advance(force, load);
    observer.update(plant.x, kPeriod, force, known);
  }

  DelayedMass plant;
  StateObserver observer;
};

class StateObserverAt : public testing::TestWithParam<double> {
 protected:
  /// Returns the largest prediction error of a tick [m] for forces up to 5 N. If the force changes within the tick, the
  /// observer knows its mean but not the order of its parts.
  [[nodiscard]] double position_bound() const {
    const double part = GetParam() - std::floor(GetParam());
    return 1e-12 + part * (1 - part) * 0.5 * 17.4 / kMass.minCoeff() * kPeriod * kPeriod;
  }
};

TEST_P(StateObserverAt, ConvergesToPositionVelocityAndLoadUnderAConstantForce) {
  Pair pair(GetParam());
  const Vec3 load(2, -1, 0.5), force(-1.5, 1.2, 0);
  pair.plant.v = Vec3(0.02, 0, -0.1);
  for (int i = 0; i < 2000; ++i) pair.tick(force, load);
  const StateObserver::Estimate now = pair.observer.now();
  EXPECT_LT((now.position - pair.plant.x).norm(), 1e-9);
  EXPECT_LT((now.velocity - pair.plant.v).norm(), 1e-8);
  EXPECT_LT((now.load + load).norm(), 1e-7) << "the force that cancels the load";
}

TEST_P(StateObserverAt, FollowsKnownForcesWithoutLagAtAnyBandwidth) {
  for (const double bandwidth : {0.1, 1.0, 20.0, 200.0, 1e4}) {
    Pair pair(GetParam(), bandwidth);
    Forces forces;
    double worst_x = 0, worst_v = 0;
    for (int i = 0; i < 500; ++i) {
      pair.tick(forces.next());
      worst_x = std::max(worst_x, (pair.observer.now().position - pair.plant.x).norm());
      worst_v = std::max(worst_v, (pair.observer.now().velocity - pair.plant.v).norm());
    }
    EXPECT_LT(worst_x, 10 * position_bound()) << bandwidth;
    EXPECT_LT(worst_v, GetParam() == std::floor(GetParam()) ? 1e-9 : 0.02) << bandwidth;
  }
}

TEST_P(StateObserverAt, PredictsTheTrueStateAtTheTimeWhenAForceActs) {
  Pair pair(GetParam());
  EXPECT_NEAR(pair.observer.lead(), kPeriod * std::round(GetParam()), 1e-12);
  Forces forces;
  const Vec3 load(1, 0, -1);
  for (int i = 0; i < 1500; ++i) pair.tick(kNone, load);
  const auto lead = static_cast<int>(std::lround(GetParam()));
  // A force sent after the prediction acts from the end of the lead, or up to half a tick earlier.
  for (int i = 0; i < 40; ++i) {
    for (int k = 0; k < 20; ++k) pair.tick(forces.next(), load);
    const StateObserver::Estimate ahead = pair.observer.ahead();
    DelayedMass later = pair.plant;
    for (int k = 0; k < lead; ++k) later.advance(kNone, load);
    const double early = std::max(0.0, lead - GetParam()) * kPeriod;  // part of a tick in which a later force acts
    EXPECT_LT((ahead.position - later.x).norm(), 1e-8 + 50 * position_bound() + early * early * 8.7 / kMass.minCoeff());
    EXPECT_LT((ahead.velocity - later.v).norm(),
              1e-7 + 1e3 * position_bound() / kPeriod * 0.05 + early * 8.7 / kMass.minCoeff());
  }
}

INSTANTIATE_TEST_SUITE_P(All, StateObserverAt, testing::Values(0, 0.3, 0.5, 1, 1.5, 2, 3.75, 8, 15.9, 16),
                         [](const auto& delay) {
                           return std::to_string(std::lround(1000 * delay.param)) + "ThousandthsOfATick";
                         });

TEST(StateObserver, ExcludesKnownForcesFromTheLoad) {
  Pair pair(2);
  const Vec3 load(2, -1, 0.5), known(-1.9, 1, 0);
  for (int i = 0; i < 2000; ++i) pair.tick(known, load, known);
  EXPECT_LT((pair.observer.now().load + load + known).norm(), 1e-7);
}

TEST(StateObserver, HasALongestDelay) {
  EXPECT_NEAR(observer_of(1000).lead(), StateObserver::kLongestDelay * kPeriod, 1e-12);
  EXPECT_EQ(observer_of(-1).lead(), 0);
}

TEST(StateObserver, ScalesWithMassAndLength) {
  StateObserver one = observer_of(1.5);
  StateObserver heavy({.mass = 3 * kMass, .delay = 1.5 * kPeriod});
  StateObserver large = observer_of(1.5);
  Forces forces;
  for (int i = 0; i < 300; ++i) {
    const Vec3 position = 1e-3 * forces.next(), force = forces.next();
    one.update(position, kPeriod, force, kNone);
    heavy.update(position, kPeriod, 3 * force, kNone);
    large.update(7 * position, kPeriod, 7 * force, kNone);
  }
  const auto a = one.ahead(), b = heavy.ahead(), c = large.ahead();
  EXPECT_TRUE(b.position.isApprox(a.position, 1e-9));
  EXPECT_TRUE(b.velocity.isApprox(a.velocity, 1e-9));
  EXPECT_TRUE(b.load.isApprox(3 * a.load, 1e-9));
  EXPECT_TRUE(c.position.isApprox(7 * a.position, 1e-9));
  EXPECT_TRUE(c.velocity.isApprox(7 * a.velocity, 1e-9));
  EXPECT_TRUE(c.load.isApprox(7 * a.load, 1e-9));
}

TEST(StateObserver, LeavesAnAxisWithoutMassWhereItIsMeasured) {
  StateObserver observer({.mass = Vec3(0.4, 0, 0.3), .delay = 2e-3});
  StateObserver full({.mass = Vec3(0.4, 0.4, 0.3), .delay = 2e-3});
  Forces forces;
  for (int i = 0; i < 100; ++i) {
    const Vec3 position = 1e-3 * forces.next(), force = forces.next();
    observer.update(position, kPeriod, force, kNone);
    full.update(position, kPeriod, force, kNone);
    for (const auto& estimate : {observer.now(), observer.ahead()}) {
      ASSERT_EQ(estimate.position.y(), position.y());
      ASSERT_EQ(estimate.velocity.y(), 0);
      ASSERT_EQ(estimate.load.y(), 0);
    }
  }
  EXPECT_EQ(observer.ahead().position.x(), full.ahead().position.x()) << "the other axes do not change";
}

TEST(StateObserver, ForgetsAnErrorWithAllThreePolesAtTheBandwidth) {
  for (const double bandwidth : {5.0, 20.0, 80.0}) {
    StateObserver observer = observer_of(0, 33);
    const double p = std::exp(-2 * M_PI * bandwidth * kPeriod);
    std::array<double, 4> last{};
    observer.start(Vec3(1, 0, 0));
    observer.set_bandwidth(bandwidth);
    for (int i = 0; i < 60; ++i) {
      observer.update(kNone, kPeriod, kNone, kNone);
      std::rotate(last.rbegin(), last.rbegin() + 1, last.rend());
      last[0] = observer.now().velocity.x();
      // characteristic equation: (z - p)^3 = 0
      if (i < 3) continue;
      const double rest = last[0] - 3 * p * last[1] + 3 * p * p * last[2] - p * p * p * last[3];
      EXPECT_NEAR(rest / std::abs(last[1]), 0, 1e-6) << bandwidth << " Hz, tick " << i;
    }
  }
}

TEST(StateObserver, RestartsAfterALongGapAndKeepsTheLoad) {
  Pair pair(2);
  const Vec3 load(2, 0, 0);
  for (int i = 0; i < 1000; ++i) pair.tick(kNone, load);
  const Vec3 before = pair.observer.now().load;
  pair.observer.update(Vec3(0.5, 0, 0), 6e-3, kNone, kNone);
  EXPECT_EQ(pair.observer.now().position, Vec3(0.5, 0, 0));
  EXPECT_EQ(pair.observer.now().velocity, kNone);
  EXPECT_EQ(pair.observer.now().load, before);
}

TEST(StateObserver, FollowsThroughAFewMissedTicks) {
  for (const double delay : {0.0, 1.0, 4.0}) {
    Pair pair(delay);
    Forces forces;
    for (int i = 0; i < 400; ++i) {
      const Vec3 force = forces.next();
      const int ticks = 1 + i % 5;  // the force is held while ticks are missed
      for (int k = 0; k < ticks; ++k) pair.plant.advance(force);
      pair.observer.update(pair.plant.x, ticks * kPeriod, force, kNone);
      ASSERT_LT((pair.observer.now().position - pair.plant.x).norm(), 1e-9) << "delay " << delay << ", update " << i;
      ASSERT_LT((pair.observer.now().velocity - pair.plant.v).norm(), 1e-9);
    }
  }
}

TEST(StateObserver, StandsStillWhileTimeDoes) {
  Pair pair(0);
  for (int i = 0; i < 100; ++i) pair.tick(Vec3(1, 0, 0));
  const auto before = pair.observer.now();
  for (const double dt : {0.0, -1.0, kNaN}) pair.observer.update(Vec3(9, 9, 9), dt, Vec3(1, 0, 0), kNone);
  EXPECT_EQ(pair.observer.now().position, before.position);
  EXPECT_EQ(pair.observer.now().velocity, before.velocity);
  EXPECT_EQ(pair.observer.now().load, before.load);
}

TEST(StateObserver, StartsAtRestAndForgetsItsHistory) {
  Pair pair(3);
  Forces forces;
  for (int i = 0; i < 50; ++i) pair.tick(forces.next(), Vec3(1, 1, 1));
  pair.observer.start(Vec3(0.1, 0.2, 0.3));
  for (const auto& estimate : {pair.observer.now(), pair.observer.ahead()}) {
    EXPECT_EQ(estimate.position, Vec3(0.1, 0.2, 0.3));
    EXPECT_EQ(estimate.velocity, kNone);
    EXPECT_EQ(estimate.load, kNone);
  }
}

TEST(StateObserver, IsStableAndFiniteAtAnyBandwidthRateAndStep) {
  std::mt19937 engine(3);
  for (const double rate : {10.0, 1000.0, 20000.0})
    for (const double bandwidth : {0.1, 3.0, 60.0, 499.0, 2e3, 1e6, 1e12}) {
      StateObserver observer({.mass = kMass, .delay = 2 / rate, .bandwidth_hz = bandwidth, .rate_hz = rate});
      for (int i = 0; i < 20000; ++i) {
        const Vec3 position = 1e-3 * Vec3::Constant(static_cast<double>(engine() % 3));
        observer.update(position, 1 / rate, kNone, kNone);
        const auto ahead = observer.ahead();
        ASSERT_TRUE(is_finite(ahead.position) && is_finite(ahead.velocity) && is_finite(ahead.load));
        ASSERT_LT((observer.now().position - position).norm(), 0.02) << rate << " Hz, " << bandwidth << " Hz";
      }
    }
}

TEST(StateObserver, AllocatesNothing) {
  StateObserver observer = observer_of(2.5);
  const std::size_t before = test::allocations();
  observer.start(Vec3(1, 2, 3));
  for (int i = 0; i < 100; ++i) {
    observer.update(Vec3(1, 2, 3), i % 7 * kPeriod, Vec3(1, 0, 0), kNone);
    (void)observer.now();
    (void)observer.ahead();
  }
  EXPECT_EQ(test::allocations(), before);
}

}  // namespace
}  // namespace haptrace
