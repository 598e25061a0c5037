// Tests of forces against a hand that does not yield: on the approach, along the path and at its end.
#include "control/limits.h"
#include "control/path/shapes.h"
#include "control/resistance_timer.h"
#include "devices/registry.h"
#include "formats/path/path_source.h"
#include "player/guidance/guide.h"
#include "player/playback/playback.h"
#include "tests/support/point_mass.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::Log;
using testing::HasSubstr;

constexpr double kPeak = 8.9, kContinuous = kCautiousShare * kPeak;  // preset falcon [N]
constexpr const char* kStubborn = "sim:preset=falcon,hand=tense,seed=3";

Path circle(double x, double duration = 4) {
  return make_shape("circle", {.size = 0.02, .duration = duration, .centre = Vec3(x, 0, 0)});
}

double seconds_of(const Sample& sample) {
  return 1e-9 * static_cast<double>(sample.time_ns);
}

SessionResult played(const Path& path, PlayOptions options, Log& log) {
  const auto device = open_device(kStubborn);
  options.sinks.push_back(&log);
  options.gains = PdGains{Vec3::Constant(1500), Vec3::Constant(5)};
  return play(*device, plan_playback(device->info(), path, options), options, StopRequest{}).session;
}

/// Returns the last time at which the force exceeded three quarters of the peak [s].
double last_strong(const Log& log) {
  double last = 0;
  for (const Sample& sample : log.samples)
    if (sample.force.norm() > 0.75 * kPeak) last = seconds_of(sample);
  return last;
}

/// Returns the first such time [s].
double first_strong(const Log& log) {
  for (const Sample& sample : log.samples)
    if (sample.force.norm() > 0.75 * kPeak) return seconds_of(sample);
  return 0;
}

TEST(HoldingForce, DecaysWithinSecondsAndThenEndsAPlaybackThatPausesOrSoftens) {
  for (const DeviationPolicy policy : {DeviationPolicy::pause, DeviationPolicy::soften}) {
    SCOPED_TRACE(to_string(policy));
    Log log;
    PlayOptions options;
    options.playback.on_deviation = policy;
    options.playback.max_deviation = 0.01;
    options.playback.repetitions = 100;
    options.playback.hold = 60;
    // The path's start is 30 mm away from the hand.
    const SessionResult result = played(circle(0.02), options, log);
    EXPECT_EQ(result.servo.cause, StopCause::resistance);
    EXPECT_THAT(result.servo.detail, HasSubstr("the hand resisted the force for"));
    EXPECT_TRUE(log.has(EventCode::force_resisted));
    EXPECT_LT(last_strong(log) - first_strong(log), 3) << "seconds of nearly all of its force";
    const double patience = policy == DeviationPolicy::pause ? kPatienceOfPause : kPatience;
    EXPECT_GT(result.servo.duration, patience);
    EXPECT_LT(result.servo.duration, patience + 10);
    for (const Sample& sample : log.samples)
      if (seconds_of(sample) > 8) {
        ASSERT_LT(sample.force.norm(), 1.15 * kContinuous) << seconds_of(sample);
      }
  }
}

TEST(HoldingForce, EndsAPlaybackAlsoWhereTheDeviceMayHoldItsPeakForEver) {
  for (const DeviationPolicy policy : {DeviationPolicy::pause, DeviationPolicy::soften, DeviationPolicy::stop}) {
    SCOPED_TRACE(to_string(policy));
    Log log;
    PlayOptions options;
    options.playback.on_deviation = policy;
    options.playback.max_deviation = policy == DeviationPolicy::stop ? 0.1 : 0.01;
    options.playback.repetitions = 100;
    options.playback.hold = 60;
    options.session.loop.limits.max_continuous_force = kPeak;
    const SessionResult result = played(circle(0.02), options, log);
    EXPECT_EQ(result.servo.cause, StopCause::resistance);
    EXPECT_TRUE(log.has(EventCode::force_resisted));
    EXPECT_LT(result.servo.duration, kPatienceOfPause + 15);
  }
}

TEST(HoldingForce, IsNotRaisedOnTheWayToTheStartWhileItWaitsForTheHand) {
  Log log;
  PlayOptions options;
  options.playback.on_deviation = DeviationPolicy::pause;
  options.playback.max_deviation = 0.005;
  const SessionResult result = played(circle(0.02), options, log);
  EXPECT_EQ(result.servo.cause, StopCause::resistance);
  EXPECT_TRUE(log.has(EventCode::reference_waits));
  for (const Sample& sample : log.samples) {
    ASSERT_EQ(sample.phase == Phase::stopped ? Phase::approach : sample.phase, Phase::approach);
    // The reference takes 0.1 s to stop.
    ASSERT_LT((sample.reference_position - sample.position).norm(), 0.015);
  }
}

TEST(HoldingForce, DoesNotEndAPlaybackThatIsNotResisted) {
  const auto device = open_device("sim:preset=falcon,hand=relaxed,seed=3");
  Log log;
  PlayOptions options;
  options.playback.repetitions = 8;
  options.playback.on_deviation = DeviationPolicy::pause;
  options.sinks.push_back(&log);
  const auto result = play(*device, plan_playback(device->info(), circle(0), options), options, StopRequest{});
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_FALSE(log.has(EventCode::force_resisted));
}

GuideResult guided_along(const Path& path, GuideOptions options, Log& log) {
  const auto device = open_device(kStubborn);
  options.sinks.push_back(&log);

  return guide(*device, plan_guidance(device->info(), source_of(path), options), options, StopRequest{});
}

TEST(HoldingForce, EndsAGuidanceWhoseHandStaysBehindOnTheWayToTheStart) {
  Log log;
  GuideOptions options;
  options.guidance.max_deviation = 0.02;
  const GuideResult result = guided_along(circle(0.025), options, log);
  EXPECT_EQ(result.session.servo.cause, StopCause::deviation);
  EXPECT_THAT(result.session.servo.detail, HasSubstr("off the path, the limit is 20.0 mm"));
}

TEST(HoldingForce, DecaysOnTheWayToAGuidanceAndEndsIt) {
  Log log;
  GuideOptions options;
  options.guidance.approach_speed = 0.001;  // the approach takes a minute
  options.guidance.max_deviation = 0.1;
  const GuideResult result = guided_along(circle(0.025), options, log);
  EXPECT_EQ(result.session.servo.cause, StopCause::resistance);
  EXPECT_LT(last_strong(log) - first_strong(log), 4);
}

TEST(HoldingForce, IsNotSentAtAllByAGuidanceThatIsFree) {
  Log log;
  GuideOptions options;
  options.free = true;
  options.guidance.led = false;
  options.guidance.time_limit = 2;
  options.guidance.max_deviation = 0.01;
  (void)guided_along(circle(0.025), options, log);
  ASSERT_GT(log.samples.size(), 100U);
  for (const Sample& sample : log.samples) ASSERT_TRUE(sample.force.isZero(0)) << seconds_of(sample);
}

}  // namespace
}  // namespace haptrace
