// Tests of orientation on a device that takes torque: recording, playback and metrics.
#include "control/path/orientation_trajectory.h"
#include "devices/sim/presets.h"
#include "devices/sim/sim_device.h"
#include "formats/path/path_file.h"
#include "player/playback/orientation_follower.h"
#include "player/playback/playback.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::Log;
using testing::HasSubstr;

/// Returns the orientation of the path: it turns about every axis and rests at both ends.
Quat intended(double t) {
  const double s = 0.5 * (1 - std::cos(std::numbers::pi * std::clamp(t, 0.0, 2.0)));
  return quaternion(Vec3(0.5 * std::sin(std::numbers::pi * s), 0.3 * s, -0.2 * std::sin(2 * std::numbers::pi * s)));
}

Path turning_path() {
  Path path{.name = "turning"};
  for (double t = 0; t <= 2.0001; t += 0.01) {
    path.time.push_back(t);
    path.position.emplace_back(0.01 * std::sin(t), 0, 0);
    path.orientation.push_back(intended(t));
  }
  return path;
}

SimSpec wrist_device(const char* hand = "none") {
  nlohmann::json spec = device_preset("sigma7", "test");
  spec["hand"] = hand;
  return read_sim_spec(spec, "test");
}

PlayResult played(Device& device, const PlayOptions& options, Log* log = nullptr, const Path& path = turning_path()) {
  PlayOptions with_log = options;
  if (log != nullptr) with_log.sinks.push_back(log);
  return play(device, plan_playback(device.info(), path, with_log), with_log, StopRequest{});
}

TEST(OrientationPlayback, TurnsTheToolAsThePathDoes) {
  for (const char* hand : {"none", "relaxed", "pinch"}) {
    SimDevice device(wrist_device(hand));
    Log log;
    const PlayResult result = played(device, {}, &log);
    EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
    EXPECT_LT(result.last.rms_rotation_error, 0.15) << hand;
    EXPECT_GT(result.last.peak_rotation_error, result.last.rms_rotation_error);
    for (const Sample& sample : log.samples) {
      EXPECT_LE(sample.torque.norm(), device.info().max_torque * (1 + 1e-12));
      if (sample.phase != Phase::run) continue;
      EXPECT_TRUE(is_finite(sample.reference_orientation));
    }
    EXPECT_EQ(to_json(result).at("rms_rotation_error_rad"), result.last.rms_rotation_error);
  }
}

TEST(OrientationPlayback, FollowsTheNearerTheStifferItIs) {
  double before = 1;
  for (const double kp : {0.3, 1.0, 3.0}) {
    SimDevice device(wrist_device("relaxed"));
    PlayOptions options;
    options.turn.gains = OrientationGains{.kp = kp, .kd = 0.02 * kp};
    const double error = played(device, options).last.rms_rotation_error;
    EXPECT_LT(error, 0.7 * before) << kp;
    before = error;
  }
}

TEST(OrientationPlayback, LeadsTheToolToTheStartWithoutAStep) {
  SimDevice device(wrist_device());
  Path path = turning_path();
  for (Quat& q : path.orientation) q = q * quaternion(Vec3(0, 0, 0.8));
  Log log;
  const PlayResult result = played(device, {}, &log, path);
  EXPECT_EQ(result.session.servo.cause, StopCause::finished);
  Quat before = Quat::Identity();
  for (const Sample& sample : log.samples) {
    if (sample.phase == Phase::approach) {
      EXPECT_LT(rotation_between(before, sample.reference_orientation).norm(),
                1.001e-3 * OrientationFollower::kApproachSpeed);
    }
    before = sample.reference_orientation;
  }
}

TEST(OrientationPlayback, SendsNoTorqueWhenOnlyThePositionIsAskedForOrKnown) {
  PlayOptions only;
  only.turn.off = true;
  Path flat = turning_path();
  flat.orientation.clear();
  for (const auto& [options, path] : {std::pair{only, turning_path()}, std::pair{PlayOptions{}, flat}}) {
    SimDevice device(wrist_device());
    Log log;
    const PlayResult result = played(device, options, &log, path);
    EXPECT_TRUE(std::isnan(result.last.rms_rotation_error));
    EXPECT_FALSE(to_json(result).contains("rms_rotation_error_rad"));
    for (const Sample& sample : log.samples) {
      EXPECT_EQ(sample.torque, Vec3::Zero());
      EXPECT_FALSE(is_finite(sample.reference_orientation));
    }
  }
}

TEST(OrientationPlayback, SaysWhyItDoesNotTurnATool) {
  const auto note = [](auto change) {
    DeviceInfo info = SimDevice(wrist_device()).info();
    change(info);
    const PlayPlan plan = plan_playback(info, turning_path(), {});
    EXPECT_FALSE(plan.turn);
    return plan.notes.empty() ? "" : plan.notes.front();
  };
  EXPECT_THAT(note([](DeviceInfo& info) { info.max_torque = 0; }), HasSubstr("give it with --max-torque"));
  EXPECT_THAT(note([](DeviceInfo& info) { info.torque_axes[1] = false; }), HasSubstr("no motor about some"));
  EXPECT_THAT(note([](DeviceInfo& info) { info.measures_orientation = false; }),
              HasSubstr("does not measure orientation"));
  EXPECT_EQ(note([](DeviceInfo& info) { info.torque_axes = {}; }), "") << "such a device needs no note";
}

TEST(OrientationPlayback, KeepsToTheTorqueLimitOfTheSession) {
  SimDevice device(wrist_device("firm"));
  PlayOptions options;
  options.session.loop.limits.max_torque = 0.05;
  Log log;
  (void)played(device, options, &log);
  double largest = 0;
  for (const Sample& sample : log.samples) largest = std::max(largest, sample.torque.norm());
  EXPECT_LE(largest, 0.05 * (1 + 1e-12));
  EXPECT_GT(largest, 0.04);
}

TEST(OrientationPlayback, StopsWhenTheToolIsHeldOffByMoreThanTheLimit) {
  SimDevice device(wrist_device("tense"));
  PlayOptions options;
  options.turn.max_deviation = 0.1;
  Log log;
  const PlayResult result = played(device, options, &log);
  EXPECT_EQ(result.session.servo.cause, StopCause::deviation);
  EXPECT_THAT(result.session.servo.detail, HasSubstr("degrees off"));
  EXPECT_EQ(log.samples.back().torque, Vec3::Zero()) << "it faded";
  options.playback.on_deviation = DeviationPolicy::soften;
  SimDevice softened(wrist_device("tense"));
  EXPECT_EQ(played(softened, options).session.servo.cause, StopCause::finished);
}

TEST(OrientationPlayback, EndsWithoutTorqueOnEveryWayOut) {
  for (const int raised : {1, 2}) {
    SimDevice device(wrist_device("relaxed"));
    StopRequest stop;
    struct Stopper final : SampleSink {
      StopRequest& stop;
      int raised;
      explicit Stopper(StopRequest& s, int times) : stop(s), raised(times) {}
      using SampleSink::push;
      void push(const Sample& sample) noexcept override {
        if (sample.time_ns == 1'500'000'000)
          for (int i = 0; i < raised; ++i) stop.raise();
      }
    } stopper(stop, raised);
    Log log;
    PlayOptions options;
    options.sinks = {&stopper, &log};
    const PlayResult result = play(device, plan_playback(device.info(), turning_path(), options), options, stop);
    EXPECT_EQ(result.session.servo.cause, StopCause::interrupted);
    EXPECT_LT(log.samples.back().torque.norm(), 1e-3);
  }
}

TEST(OrientationPlayback, IsRecordedReadBackAndPlayedAgain) {
  const test::TempFolder folder;
  const std::string file = folder / "played.h5";
  SimDevice device(wrist_device("relaxed"));
  PlayOptions options;
  options.session.recording = SessionOptions::Recording{.file = file};
  const PlayResult result = played(device, options);
  EXPECT_EQ(result.session.recording_error, "");
  EXPECT_TRUE(check_recording(file).empty());

  const RecordingReader reader(file);
  EXPECT_TRUE(reader.columns().orientation && reader.columns().torque && reader.columns().reference_orientation);
  double error2 = 0;
  std::uint64_t rows = 0;
  for (const Sample& sample : reader.read(0, reader.rows())) {
    if (sample.phase != Phase::run) continue;
    error2 += rotation_between(sample.orientation, sample.reference_orientation).squaredNorm();
    ++rows;
  }
  EXPECT_NEAR(std::sqrt(error2 / static_cast<double>(rows)), result.last.rms_rotation_error, 1e-12);

  const auto path = open_path(file);
  EXPECT_TRUE(path->facts().orientation);
  SimDevice again(wrist_device("none"));
  const PlayOptions plain;
  const PlayResult second = play(again, plan_playback(again.info(), path, plain), plain, StopRequest{});
  EXPECT_LT(second.last.rms_rotation_error, 0.15);
}

TEST(OrientationPlayback, AllocatesNothingInATick) {
  OrientationFollower follower({.gains = {.kp = 1, .kd = 0.02}});
  const OrientationTrajectory path(turning_path(), Interpolation::cubic, 0, 2);
  Trajectory::Cursor cursor;
  State state{.dt = 1e-3, .orientation = Quat::Identity()};
  const std::size_t before = test::allocations();
  follower.start(state);
  (void)follower.begin_approach(intended(0));
  Vec3 sum = Vec3::Zero();
  for (int k = 0; k < 1000; ++k) sum += follower.torque(state, path.sample(1e-3 * k, cursor));
  EXPECT_EQ(test::allocations(), before);
  EXPECT_TRUE(is_finite(sum));
  state.orientation = nan_quat();
  EXPECT_EQ(follower.torque(state, path.sample(1, cursor)), Vec3::Zero()) << "the orientation of the tool is unknown";
}

}  // namespace
}  // namespace haptrace
