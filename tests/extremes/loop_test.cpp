// Tests of the loop with extreme rates, gains, delays, encoder resolutions, forces and clocks.
#include "control/observer_pd.h"
#include "control/pd.h"
#include "devices/loop/clock.h"
#include "tests/extremes/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <memory>

namespace haptrace {
namespace {

using test::error_at_the_end_of, test::error_of, test::Log, test::Watched;
using testing::HasSubstr;

/// Returns the mechanism for which the laws below are designed, with a passive hand.
SimSpec mechanism(double delay = 0, double resolution = 5e-5, double max_force = 20) {
  SimSpec spec = test::sim_spec(R"({"mass": 0.4, "viscous": 1, "coulomb": 0.3, "max_force": 20, "hand": "relaxed"})");
  spec.hand->tremor = spec.hand->drift = 0;
  spec.delay = delay;
  spec.position_resolution = resolution;
  spec.max_force = max_force;
  return spec;
}

PlantModel model_of(const SimSpec& spec) {
  return {.mass = spec.mass,
          .viscous = spec.viscous,
          .coulomb = spec.coulomb,
          .delay = spec.delay,
          .position_resolution = spec.position_resolution};
}

TrackingGuard::Options guard_of(const SimSpec& spec, double rate_hz) {
  return {.oscillation = OscillationMonitorOptions{.rate_hz = rate_hz,
                                                   .max_force = spec.max_force,
                                                   .delay = std::min(spec.delay, 0.1),
                                                   .position_resolution = spec.position_resolution},
          .hand = {}};
}

PlaybackController follower(const Path& path, ForceTerms terms, const Tuning& tuning, double rate_hz) {
  return {Trajectory(path, Interpolation::cubic),
          std::move(terms),
          tuning,
          {.hold = 0.3, .max_deviation = 1, .on_deviation = DeviationPolicy::soften, .rate_hz = rate_hz}};
}

/// Plays with the law designed for `model` on the device of `spec`.
ServoReport play_designed(const SimSpec& spec, const PlantModel& model, double rate_hz, Log& log) {
  const TrackingDesign design = design_tracking(model, {.rate_hz = rate_hz, .max_force = spec.max_force});
  auto controller =
      follower(test::circle(),
               test::terms_of(std::make_unique<ObserverPd>(ObserverPd::Options{
                   .design = design, .rate_hz = rate_hz, .position_resolution = model.position_resolution})),
               {.gains = design.gains, .observer_hz = design.load_hz}, rate_hz);
  controller.guard(guard_of(spec, rate_hz));
  SimDevice sim(spec);
  Watched device(sim);
  return test::run(device, controller, log, {.rate_hz = rate_hz});
}

ServoReport play_pd(const SimSpec& spec, const PdGains& gains, double rate_hz, Log& log) {
  auto controller = follower(test::circle(), test::terms_of(std::make_unique<PdLaw>()), {.gains = gains}, rate_hz);
  controller.guard(guard_of(spec, rate_hz));
  SimDevice sim(spec);
  Watched device(sim);
  return test::run(device, controller, log, {.rate_hz = rate_hz});
}

TEST(Loop, FollowsAtEveryRate) {
  for (const double rate : {10., 100., 250., 300., 500., 1000., 2000., 4000., 10000., 20000.}) {
    SCOPED_TRACE(fmt::format("{} Hz", rate));
    const SimSpec spec = mechanism();
    Log cautious;
    EXPECT_EQ(play_pd(spec, cautious_gains(spec.max_force, rate), rate, cautious).cause, StopCause::finished);
    if (rate < 100) continue;  // the loop is slower than a hand, for which laws are not designed
    EXPECT_LT(error_at_the_end_of(cautious, Phase::hold), 2e-3);
    Log designed;
    EXPECT_EQ(play_designed(spec, model_of(spec), rate, designed).cause, StopCause::finished);
    EXPECT_LT(error_at_the_end_of(designed, Phase::hold), 1e-3);
  }
}

TEST(Loop, RefusesRatesBeyondItsEnds) {
  const DeviceInfo info = SimDevice(mechanism()).info();
  for (const double rate : {-1., 0., 9.999, 20000.1, 1e9, test::kInfinity, kNaN})
    EXPECT_THAT(error_of([&] { ServoLoop::validate(info, {.rate_hz = rate, .virtual_time = true}); }),
                HasSubstr("it must be from 10 to 20000 Hz"));
}

TEST(Loop, WithstandsGainsUpToABillion) {
  for (const double kp : {0., 1e3, kLargestKp, 1e9})
    for (const double kd : {0., 10., kLargestKd, 1e9}) {
      SCOPED_TRACE(fmt::format("{} N/m, {} N s/m", kp, kd));
      Log log;
      // run() checks the forces, the rows and the final zero. The position stays within bounds, too.
      const ServoReport report = play_pd(mechanism(), {Vec3::Constant(kp), Vec3::Constant(kd)}, 1000, log);
      EXPECT_TRUE(report.cause == StopCause::finished || report.cause == StopCause::oscillation)
          << to_string(report.cause);
      for (const Sample& row : log.samples) ASSERT_LT(row.position.cwiseAbs().maxCoeff(), 1.05) << row.tick;
    }
}

TEST(Loop, RefusesGainsBeyondTheLargestByName) {
  for (const double gain : {-1e-300, 1.001 * kLargestKp, 1e9, test::kInfinity, kNaN}) {
    EXPECT_THAT(error_of([&] {
                  validate(PdGains{Vec3(1, gain, 1), Vec3::Zero()});
                }),
                HasSubstr("proportional gain kp of the y axis"));
    EXPECT_THAT(error_of([&] {
                  validate(PdGains{Vec3::Zero(), Vec3(1, 1, gain)});
                }),
                HasSubstr("derivative gain kd of the z axis"));
  }
  EXPECT_NO_THROW(validate(PdGains{Vec3::Constant(kLargestKp), Vec3::Constant(kLargestKd)}));
}

TEST(Loop, FollowsThroughDelaysOfUpToSixteenTicks) {
  for (const double ticks : {0., 0.5, 1., 2., 4., 8., 16.}) {
    SCOPED_TRACE(fmt::format("{} ticks", ticks));
    const SimSpec spec = mechanism(1e-3 * ticks);
    Log log;
    EXPECT_EQ(play_designed(spec, model_of(spec), 1000, log).cause, StopCause::finished);
    EXPECT_LT(error_at_the_end_of(log, Phase::hold), 2e-3);
    // A law that does not know the delay does no harm either; run() checks the forces.
    PlantModel ignorant = model_of(spec);
    ignorant.delay = 0;
    Log harmless;
    const StopCause cause = play_designed(spec, ignorant, 1000, harmless).cause;
    EXPECT_TRUE(cause == StopCause::finished || cause == StopCause::oscillation) << to_string(cause);
  }
}

TEST(Loop, FollowsWithPositionResolutionsOfUpToAMillimetre) {
  for (const double quantum : {0., 1e-12, 1e-9, 1e-6, 5e-5, 1e-3}) {
    SCOPED_TRACE(fmt::format("{} m", quantum));
    const SimSpec spec = mechanism(1e-3, quantum);
    Log log;
    EXPECT_EQ(play_designed(spec, model_of(spec), 1000, log).cause, StopCause::finished);
    EXPECT_LT(error_at_the_end_of(log, Phase::hold), 2e-4 + 3 * quantum);
  }
}

TEST(Loop, WithstandsDevicesOfAMicronewtonAndOfAHundredThousandNewtons) {
  for (const double force : {1e-6, 1e-3, 1., 1e3, 1e5}) {
    SCOPED_TRACE(fmt::format("{} N", force));
    const SimSpec spec = mechanism(1e-3, 5e-5, force);
    Log log, pd;
    (void)play_designed(spec, model_of(spec), 1000, log);
    (void)play_pd(spec, cautious_gains(force, 1000), 1000, pd);
  }
}

/// Virtual time that is late by up to half a period; in the first 900 waits it also repeats, reverses and pauses.
class ShakenClock final : public ServoClock {
 public:
  ShakenClock(std::int64_t period_ns, std::uint64_t seed) : period_(period_ns), random_(seed, 3) {}

  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override {
    const double fate = ++waits_ < 900 ? random_.between(0, 1) : 1;
    const auto late = static_cast<std::int64_t>(random_.between(0, 0.5) * static_cast<double>(period_));
    now_ = fate < 0.02   ? now_                       // repeats
           : fate < 0.04 ? now_ - 3 * period_ + late  // goes back
           : fate < 0.06 ? time_ns + 400 * late       // pauses
                         : time_ns + late;
  }

 private:
  std::int64_t period_, now_ = 0;
  int waits_ = 0;
  SplitMix64 random_;
};

TEST(Loop, KeepsItsOrderWhenTheClockJittersRepeatsReversesAndPauses) {
  const SimSpec spec = mechanism(1e-3);
  const TrackingDesign design = design_tracking(model_of(spec), {.max_force = spec.max_force});
  auto controller = follower(
      test::circle(),
      test::terms_of(std::make_unique<ObserverPd>(ObserverPd::Options{.design = design, .position_resolution = 5e-5})),
      {.gains = design.gains, .observer_hz = design.load_hz}, 1000);
  for (const std::string& estimator : velocity_estimator_names()) {
    SCOPED_TRACE(estimator);
    SimDevice sim(spec);
    Watched device(sim);
    ShakenClock clock(1'000'000, 1);
    Log log;
    const ServoReport report = test::run(device, controller, log, {.clock = &clock}, estimator);
    EXPECT_EQ(report.cause, StopCause::finished);
    EXPECT_GT(report.missed, 100U);
    ASSERT_GT(log.samples.size(), 1000U);
    for (std::size_t i = 1; i < log.samples.size(); ++i) {
      const Sample &before = log.samples[i - 1], &row = log.samples[i];
      ASSERT_GT(row.tick, before.tick);
      ASSERT_GE(row.time_ns, before.time_ns) << "tick " << row.tick;
      // Whatever the clock does, the path advances by at most five ticks: at most 0.4 m/s for 5 ms.
      ASSERT_LE((row.reference_position - before.reference_position).norm(), 0.4 * 5e-3) << "tick " << row.tick;
      // No position is differentiated over microseconds.
      const std::int64_t step = row.time_ns - before.time_ns;
      ASSERT_TRUE(step == 0 || step >= 100'000) << "tick " << row.tick << ": " << step << " ns";
    }
    EXPECT_LT(error_at_the_end_of(log, Phase::hold), 1e-3);
    controller = follower(test::circle(),
                          test::terms_of(std::make_unique<ObserverPd>(
                              ObserverPd::Options{.design = design, .position_resolution = 5e-5})),
                          {.gains = design.gains, .observer_hz = design.load_hz}, 1000);
  }
}

}  // namespace
}  // namespace haptrace
