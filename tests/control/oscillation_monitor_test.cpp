#include "control/oscillation_monitor.h"

#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi;

constexpr OscillationMonitorOptions kDevice{.rate_hz = 1000, .max_force = 8.9, .position_resolution = 5e-5};

/// A tool of 0.4 kg that ripples about a resting reference as x = a sin(w t). The force on it is m x'' plus `feed`
/// [N s/m] times the velocity: a positive `feed` drives the ripple, a negative one damps it.
struct Ripple {
  double frequency_hz, amplitude, feed = 2;
  double mass = 0.4;

  [[nodiscard]] double position(double t) const { return amplitude * std::sin(2 * pi * frequency_hz * t); }
  /// Returns the mean force over [t - dt, t].
  [[nodiscard]] double force(double t, double dt) const {
    const double w = 2 * pi * frequency_hz, mid = t - 0.5 * dt;
    return -mass * w * w * amplitude * std::sin(w * mid) + feed * amplitude * w * std::cos(w * mid);
  }
};

/// The first verdict and its time [s]; NaN if there was none.
struct Found {
  OscillationVerdict verdict;
  double time = kNaN;
};

template <class Position, class Force>
Found watch(OscillationMonitor& monitor, double rate_hz, double duration, Position position, Force force) {
  Found found;
  const Reference rest{Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  for (int k = 0; k < std::lround(duration * rate_hz); ++k) {
    State state;
    state.dt = k == 0 ? 0 : 1 / rate_hz;
    const double t = k / rate_hz;
    state.position = Vec3(0.6, 0, 0.8) * position(t);
    state.force_applied = Vec3(0.6, 0, 0.8) * force(t);
    const auto verdict = monitor.update(state, rest);
    if (verdict && std::isnan(found.time)) found = {*verdict, t};
  }
  return found;
}

Found watch(const OscillationMonitorOptions& options, const Ripple& ripple, double duration = 1) {
  OscillationMonitor monitor(options);
  return watch(
      monitor, options.rate_hz, duration, [&](double t) { return ripple.position(t); },
      [&](double t) { return ripple.force(t, 1 / options.rate_hz); });
}

TEST(OscillationMonitor, FindsAndMeasuresAnOscillationThatTheForceDrives) {
  for (const double frequency_hz : {10., 16., 20., 30., 40., 70.})
    for (const double amplitude : {0.3e-3, 1e-3}) {
      const Found found = watch(kDevice, {frequency_hz, amplitude, 20});
      EXPECT_LE(found.time, 0.3) << frequency_hz << " Hz, " << amplitude;
      EXPECT_NEAR(found.verdict.frequency_hz, frequency_hz, 0.15 * frequency_hz);
      EXPECT_GT(found.verdict.energy, 0);
    }
  const Found found = watch(kDevice, {30, 1e-3, 3});
  EXPECT_EQ(found.verdict.detector, OscillationVerdict::Detector::energy);
  EXPECT_NEAR(found.verdict.amplitude, 1e-3, 0.1e-3);
  // A force b v delivers b v^2 / 2 on average.
  const double power = 0.5 * 3 * std::pow(2 * pi * 30 * 1e-3, 2);
  EXPECT_NEAR(found.verdict.energy, power * OscillationMonitor::kWindow, 0.15 * power * OscillationMonitor::kWindow);
}

TEST(OscillationMonitor, IgnoresTremor) {
  // The law damps the hand's movement, whatever its amplitude.
  for (const double frequency_hz : {5., 8., 12., 20.})
    for (const double amplitude : {0.2e-3, 1e-3, 5e-3})
      EXPECT_TRUE(std::isnan(watch(kDevice, {frequency_hz, amplitude, -3}, 3).time)) << frequency_hz << " Hz";
}

TEST(OscillationMonitor, IgnoresTremorWithAnInexactDelay) {
  // A sixtieth of the force appears to drive the movement.
  EXPECT_TRUE(std::isnan(watch(kDevice, {12, 5e-3, 0.5}, 3).time));
}

TEST(OscillationMonitor, IgnoresTremorOfAHandThatTheForceIsTooWeakToMove) {
  // At a slow rate, a weak law feeds a tremor a little. The mass shows that the hand moves the device.
  OscillationMonitorOptions options = kDevice;
  const Ripple tremor{11, 2e-3, 3, 0.05};
  EXPECT_FALSE(std::isnan(watch(options, tremor).time));
  options.mass = 0.4;
  EXPECT_TRUE(std::isnan(watch(options, tremor).time));
}

TEST(OscillationMonitor, NeedsTheDelayToFindTheDrivingForce) {
  // A damper that acts 10 ms late drives at 30 Hz: the sent force seems to damp, the acting force does not.
  constexpr double kDelay = 0.0103;
  const Ripple ripple{30, 0.5e-3, 6};
  const auto sent_earlier = [&](double t) { return ripple.force(t + kDelay, 1e-3); };
  const auto position = [&](double t) { return ripple.position(t); };
  OscillationMonitorOptions options = kDevice;
  OscillationMonitor without(options);
  EXPECT_TRUE(std::isnan(watch(without, 1000, 1, position, sent_earlier).time));
  options.delay = kDelay;
  OscillationMonitor with(options);
  const Found found = watch(with, 1000, 1, position, sent_earlier);
  EXPECT_LE(found.time, 0.3);
  const double power = 0.5 * 6 * std::pow(2 * pi * 30 * 0.5e-3, 2);
  EXPECT_NEAR(found.verdict.energy / OscillationMonitor::kWindow, power, 0.2 * power) << "also between two ticks";
}

TEST(OscillationMonitor, IgnoresTheRingingAfterAPush) {
  // A deflection of 3 mm against 3000 N/m is released at 1 s. It rings at 13 Hz with a damping ratio of 0.2 from the
  // device's own friction, whether the law damps or drives.
  const double w = 2 * pi * 13, decay = 0.2 * w;
  const auto position = [&](double t) {
    return t < 1 ? 3e-3 : 3e-3 * std::exp(-decay * (t - 1)) * std::cos(w * (t - 1));
  };
  for (const double drive : {-20., 0., 20.}) {
    OscillationMonitor monitor(kDevice);
    const auto force = [&](double t) {
      return -3000 * position(t - 0.5e-3) + drive * (position(t) - position(t - 1e-3)) / 1e-3;
    };
    EXPECT_TRUE(std::isnan(watch(monitor, 1000, 2, position, force).time)) << drive;
  }
}

TEST(OscillationMonitor, FindsAForceThatSaturatesBothWaysWhereThePositionHardlyMoves) {
  OscillationMonitor monitor(kDevice);
  const Ripple ripple{100, 0.02e-3, 0.5};
  const auto force = [&](double t) { return std::clamp(1e3 * ripple.force(t, 1e-3), -8.9, 8.9); };
  const Found found = watch(
      monitor, 1000, 1, [&](double t) { return ripple.position(t); }, force);
  EXPECT_LE(found.time, 0.3);
  EXPECT_EQ(found.verdict.detector, OscillationVerdict::Detector::force);
}

TEST(OscillationMonitor, GivesTheSameResultAtEveryRate) {
  for (const double rate_hz : {100., 250., 500., 2000., 4000., 20000.}) {
    OscillationMonitorOptions options = kDevice;
    options.rate_hz = rate_hz;
    EXPECT_LE(watch(options, {14, 0.5e-3, 6}).time, 0.3) << rate_hz;
    EXPECT_TRUE(std::isnan(watch(options, {14, 0.5e-3, -6}).time)) << rate_hz;
  }
}

TEST(OscillationMonitor, GivesTheSameResultAfterADay) {
  OscillationMonitor monitor(kDevice);
  const auto rest = [](double) { return 0.0; };
  // Very large sums must leave no residue when they have passed.
  (void)watch(
      monitor, 1000, 1, [](double t) { return 1e6 * std::sin(99 * t); },
      [](double t) { return 1e6 * std::cos(99 * t); });
  (void)watch(monitor, 1000, 2, rest, rest);
  EXPECT_TRUE(std::isnan(watch(monitor, 1000, 2, rest, rest).time));
  const Ripple ripple{30, 0.3e-3, 6};
  const Found found = watch(
      monitor, 1000, 1, [&](double t) { return ripple.position(t); }, [&](double t) { return ripple.force(t, 1e-3); });
  EXPECT_LE(found.time, 0.3);
  EXPECT_NEAR(found.verdict.amplitude, 0.3e-3, 0.05e-3);
}

TEST(OscillationMonitor, RestartsAfterAGapAResetAndWithoutAReference) {
  const Ripple ripple{30, 0.5e-3, 6};
  const Reference rest{Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  for (const int kind : {0, 1, 2, 3}) {
    OscillationMonitor monitor(kDevice);
    for (int k = 0; k < 2000; ++k) {
      const double t = 1e-3 * k;
      State state;
      state.dt = 1e-3;
      state.position.x() = ripple.position(t);
      state.force_applied.x() = ripple.force(t, 1e-3);
      Reference reference = rest;
      if (k % 150 == 149) {
        if (kind == 0) state.dt = 0.02;
        if (kind == 1) monitor.reset();
        if (kind == 2) reference.position = nan3();
        if (kind == 3) state.position.y() = kNaN;
      }
      ASSERT_FALSE(monitor.update(state, reference)) << "kind " << kind << " tick " << k;
    }
  }
}

TEST(OscillationMonitor, AllocatesNothingInTheTick) {
  OscillationMonitor monitor({.rate_hz = 1000, .max_force = 8.9, .delay = 0.0123});
  const std::size_t before = test::allocations();
  const Ripple ripple{30, 0.5e-3, 6};
  (void)watch(
      monitor, 1000, 1, [&](double t) { return ripple.position(t); }, [&](double t) { return ripple.force(t, 1e-3); });
  EXPECT_EQ(test::allocations(), before);
}

TEST(OscillationMonitor, NamesTheOptionThatIsWrong) {
  const auto error_of = [](const OscillationMonitorOptions& options) {
    return test::error_of([&] { OscillationMonitor monitor(options); });
  };
  EXPECT_EQ(error_of(kDevice), "no error");
  EXPECT_THAT(error_of({}), testing::HasSubstr("the largest force [N] is 0; it must be above 0"));
  EXPECT_THAT(error_of({.rate_hz = kNaN, .max_force = 1}), testing::HasSubstr("the rate [Hz] is nan"));
  EXPECT_THAT(error_of({.max_force = 1, .delay = -1}), testing::HasSubstr("the delay [s] is -1"));
  EXPECT_THAT(error_of({.max_force = 1, .mass = -1}), testing::HasSubstr("the mass [kg] is -1"));
}

}  // namespace
}  // namespace haptrace
