// Tests of control laws, limits, monitors, learning and guidance with extreme parameters.
#include "control/feedforward.h"
#include "control/force_guard.h"
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/iterative_learning.h"
#include "control/observer_pd.h"
#include "control/oscillation_monitor.h"
#include "control/path/place_tracker.h"
#include "control/reach_forces.h"
#include "control/tunnel_wall.h"
#include "tests/extremes/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <memory>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

TEST(Laws, WithstandMassesFromNothingToATonneAndAnyGain) {
  for (const double mass : {0., 1e-9, 1e-3, 1., 1e3})
    for (const double gain : {0., 1e3, 1e9})
      for (const double authority : {0., 1., 1e9}) {
        SCOPED_TRACE(fmt::format("{} kg, gain {}, authority {} N", mass, gain, authority));
        ObserverPd law({.design = {.mass = Vec3(mass, 1, 0), .delay = 2e-3, .observer_hz = 50, .authority = authority},
                        .position_resolution = 5e-5});
        InertiaFeedforward inertia(Vec3::Constant(mass));
        State state;
        law.start(state);
        Vec3 sent = Vec3::Zero();
        for (int i = 0; i < 500; ++i) {
          state.dt = i == 0 ? 0 : 1e-3;
          state.force_applied = sent;
          state.position = Vec3(1e-3 * (i % 20), 0, 5);
          const Reference reference{Vec3(0.05, 0.01, 0), Vec3(0.1, 0, 0), Vec3(1, 0, 0), 1e-3 * i};
          const Tuning tuning{.gains = {Vec3::Constant(gain), Vec3::Constant(gain)}};
          const Vec3 before = inertia.force({state, reference, tuning, Vec3::Zero()});
          const Vec3 force = law.force({state, reference, tuning, before});
          ASSERT_TRUE(is_finite(force) && is_finite(before)) << "tick " << i;
          ASSERT_EQ(force.z(), 0) << "an axis without mass is not driven";
          if (mass == 0) {
            ASSERT_EQ(force.x(), 0);
          }
          sent = (before + force).cwiseMax(-20).cwiseMin(20);
        }
      }
}

TEST(Laws, LimitAnyForceAndForgetIt) {
  for (const double peak : {0., 1e-6, 8., 1e5})
    for (const double continuous : {0., 1e-9, 3., 1e4})
      for (const double asked : {0., 5e-324, 1e-300, 1e-9, 1., 1e9, 1e154, 1e300}) {
        SCOPED_TRACE(fmt::format("{} N of at most {}, for long {}", asked, peak, continuous));
        ForceLimiter limiter({.max_force = peak, .max_continuous_force = continuous, .continuous_time = 0.01});
        double last = 0;
        for (int i = 0; i < 200; ++i) {
          const auto result = limiter.limit(Vec3(0, asked, 0));
          limiter.acted(result.force, 1e-3);
          ASSERT_TRUE(is_finite(result.force));
          last = result.force.stableNorm();
          ASSERT_LE(last, (peak > 0 ? std::min(peak, asked) : asked) * (1 + 1e-12));
          ASSERT_GE(limiter.time_left(asked), 0);
        }
        if (continuous > 0 && (peak == 0 || continuous < peak)) {
          EXPECT_LE(last, continuous * (1 + 1e-6)) << "for long";
        }
        // Once the motors have cooled, an earlier demand no longer reduces the limit.
        for (int i = 0; i < 10'000; ++i) limiter.acted(Vec3::Zero(), 1e-3);
        const double least = peak > 0 && continuous > 0 ? std::min(peak, continuous) : std::max(peak, continuous);
        EXPECT_GE(limiter.allowed(), least);
        EXPECT_TRUE(std::isfinite(limiter.heat()));
      }
}

TEST(Laws, WithstandAnyAmplitudeRateAndDeviceInMonitorsAndTheGuard) {
  for (const double rate : {10., 1e3, 2e4})
    for (const double amplitude : {0., 1e-300, 1e-12, 1e-3, 10.})
      for (const double force : {1e-6, 10., 1e9})
        for (const double delay : {0., 1.5e-3, 0.1}) {
          SCOPED_TRACE(fmt::format("{} Hz, {} m, {} N, {} s", rate, amplitude, force, delay));
          OscillationMonitor monitor({.rate_hz = rate, .max_force = force, .delay = delay, .mass = 1e3});
          ForceGuard guard({.monitor = {.rate_hz = rate, .max_force = force}, .max_torque = force});
          State state;
          state.dt = 1 / rate;
          const Reference reference{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), 0};
          for (int i = 0; i < static_cast<int>(0.6 * rate) + 20; ++i) {
            const double phase = 2 * std::numbers::pi * 30 * i / rate;
            state.position = Vec3(amplitude * std::sin(phase), 0, 0);
            state.force_applied = Vec3(force * std::cos(phase), 0, 0);
            const auto verdict = monitor.update(state, reference);
            if (verdict) {
              ASSERT_TRUE(std::isfinite(verdict->energy) && std::isfinite(verdict->frequency_hz) &&
                          std::isfinite(verdict->amplitude));
            }
            (void)guard.watch({state.force_applied, state.force_applied}, state.position, 0, state.dt);
            ASSERT_TRUE(std::isfinite(guard.summary().worst_ripple));
            ASSERT_GE(guard.summary().share, 0.01);
            ASSERT_LE(guard.summary().share, 1);
          }
        }
}

TEST(Laws, ReachThroughAnyFieldAndClampAtAnySpeed) {
  for (const double gain : {0., 1e-9, 13., 1e3})
    for (const double stiffness : {0., 1., 1e6})
      for (const double speed : {0., 1e-300, 1e-3, 1e3, 1e150})
        for (const double step : {0., 1e-9, 1e-3, 10.}) {
          SCOPED_TRACE(fmt::format("{} N s/m, {} N/m, {} m/s, {} s", gain, stiffness, speed, step));
          ReachForces::Options options{.field = curl_field(gain, Vec3::UnitZ()), .max_force = 8};
          if (stiffness > 0) options.clamp = ClampOptions{.stiffness = stiffness, .damping = gain};
          ReachForces forces({.target = Vec3(0.1, 0, 0)}, options);
          Vec3 sent = Vec3::Zero();
          for (int i = 0; i < 300; ++i) {
            const State state{.dt = step,
                              .position = Vec3(1e-3 * i, 1e-4 * (i % 20), 0),
                              .velocity = Vec3(speed, speed, 0),
                              .force_applied = sent};
            const Vec3 force = forces.update(state, i < 200, 1, true);
            ASSERT_TRUE(is_finite(force)) << "tick " << i;
            const double size = std::hypot(force.x(), force.y(), force.z());
            ASSERT_TRUE(std::isfinite(forces.tank().level()));
            if (stiffness == 0 && forces.tank().level() > 0) {
              ASSERT_LE(size, 8 * (1 + 1e-12));
            }
            sent = size > 8 ? Vec3(8 / size * force) : force;
          }
        }
}

RepetitionLog repetition(double duration, double rate, double force) {
  RepetitionLog log;
  for (double t = 0; t <= duration; t += 1 / rate) {
    log.time.push_back(t);
    log.position.emplace_back(1e-3 * std::sin(t), 0, 0);
    log.reference.emplace_back(Vec3::Zero());
    log.acceleration.emplace_back(Vec3::Ones());
    log.known.emplace_back(Vec3::Zero());
    log.sent.emplace_back(Vec3::Constant(force));
  }
  return log;
}

TEST(Laws, LearnWithAnyForceMassDelayAndCutOff) {
  for (const double rate : {10., 1000., 20000.})
    for (const double cutoff : {1e-3, 15., 0.5 * rate, 1e5})
      for (const double mass : {0., 1e-9, 1e3})
        for (const double delay : {0., 0.016}) {
          SCOPED_TRACE(fmt::format("{} Hz, {} Hz, {} kg, {} s", rate, cutoff, mass, delay));
          const double duration = 200 / rate;
          IterativeLearning learning({.mass = Vec3::Constant(mass),
                                      .delay = delay,
                                      .rate_hz = rate,
                                      .cutoff_hz = cutoff,
                                      .duration = duration});
          for (const double force : {0., 1e-300, 10., 1e9}) {
            (void)learning.learn(repetition(duration, rate, force));
            for (const Vec3& f : learning.table().force) ASSERT_TRUE(is_finite(f));
          }
        }
}

TEST(Laws, RefuseToLearnWithInvalidParameters) {
  using Options = IterativeLearning::Options;
  for (const double bad : {0., -1., test::kInfinity, kNaN}) {
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.cutoff_hz = bad, .duration = 1}); }), HasSubstr("cut-off"));
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.rate_hz = bad, .duration = 1}); }), HasSubstr("rate"));
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.duration = bad}); }),
                HasSubstr("needs repetitions longer than 0"));
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.speed = bad, .duration = 1}); }), HasSubstr("speed"));
  }
  for (const double bad : {-1e-9, test::kInfinity, kNaN}) {
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.delay = bad, .duration = 1}); }), HasSubstr("delay"));
    EXPECT_THAT(error_of([&] { IterativeLearning(Options{.mass = Vec3(0, bad, 0), .duration = 1}); }),
                HasSubstr("mass"));
  }
}

TEST(Laws, WithstandWallsUpToABillionAndForcesOfAnyScaleInGuidance) {
  ArcPath::Builder builder(1e-3);
  for (int i = 0; i <= 100; ++i) builder.add(0.01 * i, Vec3(1e-3 * i, 0, 0), Vec3(3, -1e6, 0));
  const ArcPath path = builder.finish(2e-3);
  for (const double stiffness : {0., 1., 1e9})
    for (const double onset : {1e-12, 1e-3})
      for (const double scale : {0., 1., 1e9}) {
        SCOPED_TRACE(fmt::format("{} N/m over {} m, {} times", stiffness, onset, scale));
        GuideTerms terms;
        terms.push_back(
            std::make_unique<TunnelWall>(TunnelWall::Options{.stiffness = stiffness, .onset = onset, .max_force = 5}));
        terms.push_back(std::make_unique<WallDamping>(1e3, onset));
        terms.push_back(std::make_unique<ExpertForce>(scale));
        terms.push_back(std::make_unique<PaceHelp>(PaceHelpOptions{.pace = 100}));
        terms.push_back(std::make_unique<ErrorAmplification>(1e4, 100));
        Guidance guidance(std::move(terms), {});
        PlaceTracker projection(path, {.allow_back = true});
        projection.start();
        State state;
        Gaussian random(8, 8);
        for (int i = 0; i < 500; ++i) {
          state.dt = i == 0 ? 0 : 1e-3;
          state.position = Vec3(1e-4 * i, 0, 0) + (i % 100 < 50 ? 1e-3 : 0.0) * random.vector();
          state.velocity = random.vector();
          const Vec3 force = guidance.update(state, projection.update(state.position, state.dt), false);
          ASSERT_TRUE(is_finite(force)) << "tick " << i;
          ASSERT_TRUE(std::isfinite(guidance.tank().level()) && std::isfinite(guidance.given())) << "tick " << i;
          state.force_applied = force.norm() > 10 ? Vec3(10 * force.normalized()) : force;
        }
        EXPECT_LE(guidance.given(), guidance.budget() + 1);
      }
}

}  // namespace
}  // namespace haptrace
