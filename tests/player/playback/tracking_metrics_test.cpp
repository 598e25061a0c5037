#include "player/playback/tracking_metrics.h"

#include "player/tuning/live_monitor.h"
#include "tests/support/allocations.h"

#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr Event kRepetition{.code = EventCode::repetition, .values = {0, kNaN, kNaN}};

Sample row(int i, Phase phase, const Vec3& error, const Vec3& force) {
  Sample sample;
  sample.tick = static_cast<std::uint64_t>(i);
  sample.time_ns = std::int64_t{1'000'000} * i;
  sample.position = error;
  sample.reference_position = Vec3::Zero();
  sample.force = force;
  sample.phase = phase;
  return sample;
}

TEST(TrackingMetrics, MeasureTheThreeDimensionalErrorOverPhaseRunOnly) {
  TrackingMetrics metrics(1000, 1);
  metrics.push(kRepetition);
  metrics.push(row(0, Phase::approach, Vec3(1, 1, 1), Vec3::Zero()));
  metrics.push(row(1, Phase::run, Vec3(0.003, 0, 0.004), Vec3::Zero()));
  metrics.push(row(2, Phase::run, Vec3(0, 0.001, 0), Vec3(0, 3, 4)));
  metrics.push(row(3, Phase::hold, Vec3(1, 1, 1), Vec3::Zero()));
  EXPECT_EQ(metrics.last().samples, 2U);
  EXPECT_NEAR(metrics.last().rms_error, std::sqrt((25e-6 + 1e-6) / 2), 1e-12);
  EXPECT_NEAR(metrics.last().peak_error, 0.005, 1e-12);
  EXPECT_NEAR(metrics.last().max_force, 5, 1e-12);
  EXPECT_NEAR(metrics.last().duration, 0.001, 1e-12);
}

TEST(TrackingMetrics, RippleIsTheForceAboveTwentyFiveHertz) {
  for (const double rate : {250.0, 1000.0, 4000.0}) {
    const auto ripple = [&](double hz) {
      TrackingMetrics metrics(rate, 1);
      metrics.push(kRepetition);
      for (int i = 0; i < static_cast<int>(4 * rate); ++i) {
        Vec3 force(5, 0, 0);
        force.y() = std::sin(2 * std::numbers::pi * hz * i / rate);
        metrics.push(row(i, i < rate ? Phase::approach : Phase::run, Vec3::Zero(), force));
      }
      return metrics.last().force_ripple;
    };
    EXPECT_NEAR(ripple(80), std::numbers::sqrt2 / 2, 0.02) << rate;
    EXPECT_LT(ripple(2), 1e-3) << rate;
    EXPECT_NEAR(ripple(25), std::numbers::sqrt2 / 4, 0.01) << "half at the cut-off, " << rate;
  }
}

TEST(TrackingMetrics, KeepEveryRepetitionButOnlyTheLastOfAnEndlessSession) {
  TrackingMetrics metrics(1000, 2);
  for (int repetition = 0; repetition < 3; ++repetition) {
    metrics.push(kRepetition);
    for (int i = 0; i < 10; ++i) metrics.push(row(i, Phase::run, Vec3(0.001 * (repetition + 1), 0, 0), Vec3::Zero()));
  }
  ASSERT_EQ(metrics.repetitions().size(), 2U);
  EXPECT_NEAR(metrics.repetitions()[0].rms_error, 0.001, 1e-12);
  EXPECT_NEAR(metrics.last().rms_error, 0.003, 1e-12);
}

TEST(TrackingMetrics, KnowAfterWhichRepetitionOtherFeedbackActed) {
  TrackingMetrics metrics(1000, 1);
  const Event renewed{.code = EventCode::feedback_renewed, .values = {0.3, 1, kNaN}};
  metrics.push(kRepetition);
  EXPECT_FALSE(metrics.renewed_after());
  metrics.push(kRepetition);
  metrics.push(renewed);
  metrics.push(kRepetition);
  metrics.push(renewed);
  EXPECT_EQ(metrics.renewed_after(), 2U);
}

TEST(TrackingMetrics, DoNotCountAGapOrTheReturnFromIt) {
  TrackingMetrics metrics(1000, 1);
  metrics.push(kRepetition);
  int i = 0;
  for (; i < 500; ++i) metrics.push(row(i, Phase::run, Vec3(0.001, 0, 0), Vec3::Zero()));
  metrics.push(Event{.code = EventCode::device_lost});
  i += 3000;
  metrics.push(Event{.code = EventCode::device_found, .values = {3, kNaN, kNaN}});
  for (; i < 4000; ++i) metrics.push(row(i, Phase::approach, Vec3(0.05, 0, 0), Vec3(9, 0, 0)));
  for (; i < 4500; ++i) metrics.push(row(i, Phase::run, Vec3(0.001, 0, 0), Vec3::Zero()));
  ASSERT_EQ(metrics.repetitions().size(), 1U);
  EXPECT_EQ(metrics.last().samples, 1000U);
  EXPECT_NEAR(metrics.last().duration, 0.998, 1e-9);
  EXPECT_NEAR(metrics.last().peak_error, 0.001, 1e-12);
  EXPECT_EQ(metrics.last().max_force, 0);
}

TEST(TrackingMetrics, AreZeroWhenNothingRan) {
  const TrackingMetrics metrics(1000, 3);
  EXPECT_TRUE(metrics.repetitions().empty());
  EXPECT_EQ(metrics.last().samples, 0U);
  EXPECT_EQ(metrics.last().rms_error, 0);
}

TEST(TrackingMetrics, AllocateNothingWhileASessionRuns) {
  TrackingMetrics metrics(1000, 5);
  const std::size_t before = test::allocations();
  for (int repetition = 0; repetition < 10; ++repetition) {
    metrics.push(kRepetition);
    for (int i = 0; i < 1000; ++i) metrics.push(row(i, Phase::run, Vec3::Zero(), Vec3::Ones()));
  }
  EXPECT_EQ(test::allocations(), before);
}

TEST(LiveMonitor, PostsTheNewestMetricsAndTheWorstLatencySinceTheLastPost) {
  LiveMonitor monitor;
  EXPECT_EQ(monitor.latest().samples, 0U);
  for (int i = 0; i <= 1000; ++i) {
    Sample sample = row(i, Phase::run, Vec3(0.003, 0, 0.004), Vec3(0, 3, 4));
    sample.latency = i == 985 ? 7e-4F : 1e-5F;
    sample.velocity = Vec3(0, 0.2, 0);
    monitor.push(sample);
  }
  monitor.push(Event{.code = EventCode::overrun});
  const LiveStatus live = monitor.latest();
  EXPECT_NEAR(live.time, 1, 0.021);
  EXPECT_NEAR(live.rate, 1000, 1e-6);
  EXPECT_NEAR(live.force, 5, 1e-12);
  EXPECT_NEAR(live.deviation, 0.005, 1e-12);
  EXPECT_NEAR(live.speed, 0.2, 1e-12);
  EXPECT_NEAR(live.jitter, 7e-4, 1e-9);
  EXPECT_EQ(live.phase, Phase::run);
}

TEST(LiveMonitor, ReportsALostDeviceAlthoughThereAreNoSamples) {
  LiveMonitor monitor;
  for (int i = 0; i < 1000; ++i) monitor.push(row(i, Phase::run, Vec3::Zero(), Vec3(0, 3, 4)));
  monitor.push(Event{.code = EventCode::device_lost});
  EXPECT_TRUE(monitor.latest().away);
  EXPECT_EQ(monitor.latest().losses, 1U);
  EXPECT_EQ(monitor.latest().force, 0);
  monitor.push(Event{.code = EventCode::device_found, .values = {2, kNaN, kNaN}});
  EXPECT_FALSE(monitor.latest().away);
  for (int i = 3000; i <= 4000; ++i) monitor.push(row(i, Phase::run, Vec3::Zero(), Vec3::Zero()));
  EXPECT_NEAR(monitor.latest().rate, 1000, 1) << "while it was there";
}

}  // namespace
}  // namespace haptrace
