// Tests of velocity estimators, filters and observers at every rate, beyond Nyquist and at rest.
#include "control/observer_pd.h"
#include "control/oscillation_monitor.h"
#include "control/ripple.h"
#include "control/state_observer.h"
#include "tests/extremes/support.h"

#include <bit>
#include <fmt/format.h>
#include <memory>
#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace haptrace {
namespace {

using test::Log, test::Watched;

/// Checks the bits, since comparisons treat a denormal as zero where denormals are flushed.
bool is_subnormal(double x) {
  const std::uint64_t magnitude = std::bit_cast<std::uint64_t>(x) & ~(std::uint64_t{1} << 63);
  return magnitude != 0 && magnitude < std::bit_cast<std::uint64_t>(std::numeric_limits<double>::min());
}
bool is_subnormal(const Vec3& v) {
  return is_subnormal(v.x()) || is_subnormal(v.y()) || is_subnormal(v.z());
}

/// Returns whether the processor met a denormal operand or result since the last call. Each costs a hundred times an
/// ordinary operation. The test reads flags and measures no time.
bool met_denormals() {
#if defined(__SSE2__)
  constexpr unsigned kDenormal = 0x0002, kUnderflow = 0x0010;
  const unsigned flags = _mm_getcsr();
  _mm_setcsr(flags & ~(kDenormal | kUnderflow));
  return (flags & (kDenormal | kUnderflow)) != 0;
#else
  return false;
#endif
}

TEST(Estimators, AnswerARampAtEveryRateFrom1HzTo1MHz) {
  const Vec3 slope(0.1, -0.23, 0.017);
  for (const std::string& name : velocity_estimator_names())
    for (const double rate : {1., 10., 100., 1e3, 2e4, 1e6}) {
      const auto estimator = make_velocity_estimator(name, rate, 5e-5);
      Vec3 v = Vec3::Zero();
      const int ticks = 1000 + static_cast<int>(0.2 * rate);
      for (int i = 0; i < ticks; ++i) v = estimator->update(i / rate * slope, 1 / rate);
      EXPECT_LE((v - slope).norm(), 1e-9 * rate) << name << " at " << rate << " Hz";
    }
}

TEST(Filters, PassTheirInputAboveTheNyquistFrequency) {
  Gaussian random(3, 3);
  for (const char* name : {"lowpass:1e5", "alpha-beta-gamma:1e5"})
    for (const double rate : {1., 10., 1e3}) {
      const auto estimator = make_velocity_estimator(name, rate, 5e-5),
                 exact = make_velocity_estimator("difference", rate, 0);
      for (int i = 0; i < 200; ++i) {
        const Vec3 at = 0.1 * random.vector();
        const Vec3 v = exact->update(at, 1 / rate);
        EXPECT_LE((estimator->update(at, 1 / rate) - v).norm(), 1e-6 * rate) << name;
      }
    }
  for (const auto kind : {Butterworth2::Kind::low_pass, Butterworth2::Kind::high_pass})
    for (const double cutoff : {0., 1e-300, 1e-12, 1e-6, 0.1, 0.49, 0.5, 1., 1e9}) {
      SCOPED_TRACE(fmt::format("{} of the rate", cutoff));
      Butterworth2 filter(kind, 1000 * cutoff, 1000);
      double largest = 0;
      for (int i = 0; i < 5000; ++i) largest = std::max(largest, std::abs(filter.update(random())));
      EXPECT_LT(largest, 20);
      // After reset(), a constant input is in steady state: a low pass returns it, a high pass returns zero.
      filter.reset(0.3);
      const double expected = kind == Butterworth2::Kind::low_pass ? 0.3 : 0;
      for (int i = 0; i < 100; ++i) EXPECT_NEAR(filter.update(0.3), expected, 1e-12);
    }
  Ripple ripple(1e9, 10);
  for (int i = 0; i < 1000; ++i) EXPECT_LT(ripple.update(random.vector()), 1e3);
}

TEST(Observers, FollowTheMeasurementAtTheSamplingRateAndAbove) {
  Gaussian random(4, 4);
  for (const double rate : {10., 1e3, 2e4})
    for (const double of_rate : {0., 1e-6, 0.1, 0.5, 1., 10., 1e6})
      for (const double mass : {0., 1e-9, 1e-3, 1., 1e3})
        for (const double delay : {0., 1.5, 16., 1e6}) {
          SCOPED_TRACE(fmt::format("{} Hz, bandwidth {} of it, {} kg, {} ticks late", rate, of_rate, mass, delay));
          StateObserver observer(
              {.mass = Vec3::Constant(mass), .delay = delay / rate, .bandwidth_hz = of_rate * rate, .rate_hz = rate});
          const double force = std::min(mass * 10, 10.0);  // 10 m/s^2 at most
          Vec3 at = Vec3::Zero();
          for (int i = 0; i < 60; ++i) {
            at = Vec3(0.1, 0.1, 0.1) + 1e-3 * random.vector();
            observer.update(at, 1 / rate, force * random.vector(), Vec3::Zero());
            const auto ahead = observer.ahead();
            ASSERT_TRUE(is_finite(ahead.position) && is_finite(ahead.velocity) && is_finite(ahead.load));
          }
          // With a bandwidth from the sampling rate on, only the last measurement counts.
          if (of_rate >= 1) {
            EXPECT_LE((observer.now().position - at).norm(), 0.01 * (0.1 + 10 / rate / rate));
          }
        }
}

TEST(Denormals, DoNotOccurInEstimatorsAtRest) {
  if (is_subnormal(1e-310 * 1.5)) {
    (void)met_denormals();
    volatile double tiny = 1e-310;
    tiny = tiny * 1.5;
    ASSERT_TRUE(met_denormals()) << "this test could not fail";
  }
  for (const std::string& name : velocity_estimator_names()) {
    const auto estimator = make_velocity_estimator(name, 1000, 5e-5);
    Gaussian random(1, 1);
    for (int i = 0; i < 1000; ++i) estimator->update(0.1 * random.vector(), 1e-3);
    (void)met_denormals();
    for (int i = 0; i < 60'000; ++i) estimator->update(Vec3(0.1, 0.2, 0.3), 1e-3);
    EXPECT_FALSE(met_denormals()) << name;
  }
}

TEST(Denormals, AreFlushedInTheServoThreadAtRest) {
  // Every filter, on a device at rest: their decaying outputs pass through the range of denormals.
  SimSpec spec = test::sim_spec(R"({"mass": 0.4, "viscous": 5, "max_force": 20, "hand": "relaxed"})");
  spec.hand->tremor = spec.hand->drift = 0;
  SimDevice sim(spec);
  Watched device(sim);
  const TrackingDesign design = design_tracking({.mass = spec.mass, .delay = 1e-3}, {.max_force = 20});
  ObserverPd law({.design = design});
  OscillationMonitor monitor({.max_force = 20});
  Butterworth2 slow(Butterworth2::Kind::low_pass, 20, 1000);
  Ripple ripple(25, 1000);
  Vec3 fading(1, 1, 1);
  bool denormal = false, flushes = true;
  const Reference reference{Vec3(0.01, 0, 0), Vec3::Zero(), Vec3::Zero(), 0};
  test::Scripted controller([&](const State& state) {
    Command command;
    if (state.tick == 0) law.start(state);
    command.wrench.force = law.force({state, reference, {.gains = design.gains, .observer_hz = design.load_hz}});
    (void)monitor.update(state, reference);
    const double y = slow.update(state.tick < 100 ? 1 : 0), high = ripple.update(fading *= 0.9);
    denormal = denormal || is_subnormal(y) || is_subnormal(high) || is_subnormal(fading) ||
               is_subnormal(state.velocity) || is_subnormal(command.wrench.force);
#if defined(__SSE2__)
    constexpr unsigned kFlush = 0x8040;
    flushes = flushes && (_mm_getcsr() & kFlush) == kFlush;
#endif
    if (state.tick == 30'000) command.status = Command::Status::finished;
    return command;
  });
  Log log;
  EXPECT_EQ(test::run(device, controller, log).cause, StopCause::finished);
  EXPECT_TRUE(flushes);
  EXPECT_FALSE(denormal);
  EXPECT_EQ(fading, Vec3::Zero());
#if defined(__SSE2__)
  EXPECT_EQ(_mm_getcsr() & 0x8040U, 0U) << "the mode of the caller's thread is not restored";
#endif
}

}  // namespace
}  // namespace haptrace
