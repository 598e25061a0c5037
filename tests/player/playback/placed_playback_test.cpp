// Tests of playbacks that are placed, slowed down below a limit, or have gains along the path.
#include "control/path/shapes.h"
#include "devices/loop/servo_loop.h"
#include "formats/path/path_changing.h"
#include "player/playback/playback.h"
#include "player/playback/reference_stream.h"
#include "player/playback/speed_limit.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::PointMass;
using testing::AllOf;
using testing::HasSubstr;
using testing::SizeIs;

/// Plays a path on a device that is the same in every direction.
std::vector<Sample> played(std::shared_ptr<const PathSource> path, PlayOptions options = {}) {
  PointMass device;
  Log log;
  options.smoothing = 0;  // chosen by the noise of each axis
  options.sinks.push_back(&log);
  const PlayPlan plan = plan_playback(device.info(), std::move(path), options);
  EXPECT_EQ(play(device, plan, options, StopRequest{}).session.servo.cause, StopCause::finished);
  return log.samples;
}

std::shared_ptr<const PathSource> figure() {
  return source_of(make_shape("figure8", {.size = 0.08, .duration = 1}));
}

TEST(PlacedPlayback, IsThePlacedPlaybackOfThePathOnADeviceThatIsTheSameInEveryDirection) {
  const std::vector<Sample> plain = played(figure());
  std::vector<PathChange> changes(4);
  changes[0].rotation = parse_rotation("z=90deg");
  changes[1].rotation = parse_rotation("1,2,-3=2.2");
  changes[2].mirror = 1;
  changes[3] = {.mirror = 0, .rotation = parse_rotation("-1,0.5,0=-40deg")};
  for (const PathChange& change : changes) {
    const auto path = figure();
    const Similarity similarity = similarity_of(change, *path);
    const std::vector<Sample> placed = played(changed(path, similarity));
    ASSERT_EQ(placed.size(), plain.size()) << describe(change);
    for (std::size_t i = 0; i < plain.size(); ++i) {
      ASSERT_LT((placed[i].position - similarity.point(plain[i].position)).norm(), 1e-9) << i;
      ASSERT_LT((placed[i].force - similarity.direction(plain[i].force)).norm(), 1e-6) << i;
    }
  }
}

TEST(PlacedPlayback, RefusesAPathThatWasMovedOutOfTheWorkspaceWithTheNumbers) {
  const auto path = figure();
  const PathChange change{.offset = Vec3(0.25, 0, 0)};
  const auto far = changed(path, similarity_of(change, *path));
  PointMass device;
  const double reach = 1e3 * far->facts().bounds.max.x();
  EXPECT_THAT(error_of([&] { (void)plan_playback(device.info(), far, {}); }),
              AllOf(HasSubstr(fmt::format("by {:.1f} mm (x from", reach - 200)),
                    HasSubstr(fmt::format("{:.1f} mm, the workspace", reach)), HasSubstr("to 200.0 mm"),
                    HasSubstr("--fit"), HasSubstr("--offset")));
}

/// Returns a movement along x that is slow, fast, and slow again.
Path hurried() {
  Path path{.name = "hurried"};
  double x = -0.15;
  for (int i = 0; i <= 2000; ++i) {
    const double t = 1e-3 * i;
    const double speed = 0.05 + 1.2 * std::exp(-std::pow((t - 1) / 0.05, 2));
    path.time.push_back(t);
    path.position.emplace_back(x, 0, 0);
    x += 1e-3 * speed;
  }
  return path;
}

TEST(SpeedLimit, StretchesTimeOnlyWhereThePathIsTooFastAndSaysWhereAndByHowMuch) {
  PointMass device;
  PlayOptions options;
  options.session.loop.limits.max_velocity = 1.5;
  options.playback.speed = 2;
  const PlayPlan plan = plan_playback(device.info(), hurried(), options);
  const double fastest = 0.9 * options.session.loop.limits.max_velocity;
  Trajectory::Cursor cursor;
  double peak = 0;
  for (double t = 0; t < plan.path->duration(); t += 1e-4)
    peak = std::max(peak, 2 * plan.path->first()->trajectory.sample(t, cursor).velocity.norm());
  EXPECT_LE(peak, 1.005 * fastest);
  EXPECT_GT(peak, 0.9 * fastest) << "it is slowed down no more than needed";
  const auto places = plan.stretch.places();
  ASSERT_THAT(places, SizeIs(1));
  EXPECT_NEAR(0.5 * (places[0].begin + places[0].end), 1, 0.02);
  EXPECT_LT(places[0].end - places[0].begin, 0.6) << "the rest keeps its time";
  EXPECT_NEAR(places[0].factor, 2 * 1.25 / fastest, 0.05);
  ASSERT_FALSE(plan.notes.empty());
  EXPECT_THAT(plan.notes.front(),
              AllOf(HasSubstr("hurried would move at up to 2.4"), HasSubstr("below 1.35 m/s"),
                    HasSubstr("stretched from 0."), HasSubstr("by up to 1.8"), HasSubstr("s instead of 1.00 s")));
  options.playback.speed = 1;
  EXPECT_TRUE(plan_playback(device.info(), hurried(), options).stretch.is_identity());
}

TEST(SpeedLimit, IsKeptByTheReferenceOfAWholePlayback) {
  PointMass device;
  Log log;
  PlayOptions options;
  options.session.loop.limits.max_velocity = 1.5;
  options.playback.speed = 2;
  options.sinks.push_back(&log);
  const PlayPlan plan = plan_playback(device.info(), hurried(), options);
  options.playback.max_deviation = 0.2;
  (void)play(device, plan, options, StopRequest{});
  double peak = 0, change = 0;
  for (std::size_t i = 1; i < log.samples.size(); ++i) {
    if (log.samples[i].phase != Phase::run || log.samples[i - 1].phase != Phase::run) continue;
    peak = std::max(peak, log.samples[i].reference_velocity.norm());
    change = std::max(change, (log.samples[i].reference_velocity - log.samples[i - 1].reference_velocity).norm());
  }
  EXPECT_LT(peak, options.session.loop.limits.max_velocity);
  EXPECT_GT(peak, 1);
  EXPECT_LT(change, 0.25) << "the stretch makes no jump in the speed";
}

TEST(SpeedLimit, RejectsAPathThatNeedsALargeFactorAndOneWithJumps) {
  PointMass device;
  PlayOptions options;
  options.session.loop.limits.max_velocity = 1.5;
  options.playback.speed = 20;
  EXPECT_THAT(error_of([&] { (void)plan_playback(device.info(), hurried(), options); }),
              HasSubstr("too close to the velocity limit"));
  options.playback.speed = 2;
  options.interpolation = Interpolation::hold;
  EXPECT_THAT(error_of([&] { (void)plan_playback(device.info(), hurried(), options); }),
              HasSubstr("too close to the velocity limit"));
}

/// Returns the gain kp of a PD law along x with kd = kp / 50, from the force that it sent.
double gain_of(const Sample& sample) {
  const double error = sample.reference_position.x() - sample.position.x();
  const double velocity_error = sample.reference_velocity.x() - sample.velocity.x();
  return sample.force.x() / (error + velocity_error / 50);
}

TEST(Impedance, IsFollowedAlongThePathByPlaceAndByTimeAtAnySpeed) {
  Path line{.name = "line"};
  for (int i = 0; i <= 2000; ++i) {
    line.time.push_back(1e-3 * i);
    line.position.emplace_back(5e-5 * i, 0, 0);
  }
  for (const bool by_place : {true, false}) {
    ImpedanceProfile profile{.by_place = by_place, .at = {0, 0.05, 0.1}, .gains = {}};
    if (!by_place) profile.at = {0, 1, 2};
    for (const double kp : {300.0, 900.0, 300.0})
      profile.gains.push_back({Vec3::Constant(kp), Vec3::Constant(kp / 50)});
    PlayOptions options;
    options.impedance = profile;
    options.interpolation = Interpolation::linear;
    for (const double speed : {1.0, 0.5}) {
      options.playback.speed = speed;
      std::size_t rows = 0;
      for (const Sample& sample : played(source_of(Path(line)), options)) {
        const double x = sample.reference_position.x();
        if (sample.phase != Phase::run || sample.time_ns < 600'000'000 || x > 0.0999) continue;
        ++rows;
        const double lag = 600 * speed * 0.05;  // of the time constant [N/m]
        EXPECT_NEAR(gain_of(sample), profile.gains_at(by_place ? x : x / 0.05).kp.x(), lag + 3) << x;
      }
      EXPECT_GT(rows, 1000U);
    }
  }
}

TEST(Impedance, StatesItsLargestGainsAsThoseOfTheSession) {
  PointMass device;
  PlayOptions options;
  options.impedance = {.by_place = true,
                       .at = {0, 0.05},
                       .gains = {{Vec3(100, 900, 5), Vec3::Constant(3)}, {Vec3(700, 200, 5), Vec3::Constant(9)}}};
  const PlayPlan plan = plan_playback(device.info(), figure(), options);
  EXPECT_EQ(plan.tuning.gains.kp, Vec3(700, 900, 5));
  EXPECT_EQ(plan.tuning.gains.kd, Vec3::Constant(9));
  options.gains = PdGains{Vec3::Constant(1), Vec3::Constant(1)};
  EXPECT_THAT(error_of([&] { (void)plan_playback(device.info(), figure(), options); }),
              HasSubstr("remove one of them"));
}

}  // namespace
}  // namespace haptrace
