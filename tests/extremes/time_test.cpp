// Tests over a day, a week and an uptime of years: integer nanoseconds and tick indices do not drift, and steps of zero
// time have no effect.
#include "base/nano_time.h"
#include "control/guidance.h"
#include "control/hand_watch.h"
#include "control/observer_pd.h"
#include "control/reaction_ladder.h"
#include "devices/loop/clock.h"
#include "recorder/recorder.h"
#include "tests/extremes/support.h"
#include "tests/support/temp_folder.h"

#include <bit>
#include <fmt/format.h>
#include <memory>

namespace haptrace {
namespace {

using test::Log, test::Watched;

constexpr std::int64_t kSecond = 1'000'000'000, kDay = 86400 * kSecond, kWeek = 7 * kDay;
const std::initializer_list<double> kNoSteps{0.0, -0.0, -1e-3, -test::kInfinity, kNaN};  // [s]

TEST(Time, DoesNotDriftForADeviceInADayOrAWeek) {
  NanoTime time;
  for (int hour = 0; hour < 24; ++hour) time.advance(3600);
  EXPECT_EQ(time.ns(), kDay);
  for (int hour = 24; hour < 168; ++hour) time.advance(3600);
  EXPECT_EQ(time.ns(), kWeek);
  for (int tick = 0; tick < 1'000'000; ++tick) time.advance(1e-3);
  EXPECT_EQ(time.ns(), kWeek + 1000 * kSecond);
  for (int tick = 0; tick < 300'000; ++tick) time.advance(1.0 / 300);
  EXPECT_EQ(time.ns(), kWeek + 2000 * kSecond);
}

/// An exact clock with a long uptime and one long pause.
class LongClock final : public ServoClock {
 public:
  LongClock(std::int64_t uptime, std::int64_t pause_from, std::int64_t pause)
      : now_(uptime), pause_from_(uptime + pause_from), pause_(pause) {}
  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override {
    now_ = time_ns;
    if (now_ < pause_from_ || paused_) return;
    now_ += pause_;
    paused_ = true;
  }

 private:
  std::int64_t now_, pause_from_, pause_;
  bool paused_ = false;
};

TEST(Time, TicksStayOnTheirGridADayAndAWeekLater) {
  for (const double rate : {10., 300., 1000., 20000.})
    for (const std::int64_t pause : {kDay, kWeek, 52 * kWeek}) {
      SCOPED_TRACE(fmt::format("{} Hz, {} days", rate, pause / kDay));
      const std::int64_t period = std::llround(1e9 / rate);
      test::PointMass mass(1e20);  // hardly moves in a year
      Watched device(mass);
      std::vector<State> states;
      states.reserve(100);
      test::Scripted controller([&](const State& state) {
        states.push_back(state);
        Command command;
        command.wrench.force = Vec3(0.1, 0, 0);
        if (states.size() == 40) command.status = Command::Status::finished;
        return command;
      });
      LongClock clock(52 * kWeek + 12345, 20 * period, pause + period / 3);
      Log log;
      const ServoReport report = test::run(
          device, controller, log, {.rate_hz = rate, .limits = {.soft_start = 0, .release = 0}, .clock = &clock});
      EXPECT_EQ(report.overruns, 1U);
      ASSERT_EQ(states.size(), 40U);
      for (std::size_t i = 0; i < states.size(); ++i) {
        const std::int64_t late = states[i].time_ns - static_cast<std::int64_t>(states[i].tick) * period;
        if (i == 20)
          ASSERT_EQ(late, pause + period / 3);
        else
          ASSERT_EQ(late, 0) << "row " << i;
        if (i > 21) {
          ASSERT_EQ(states[i].dt, 1e-9 * static_cast<double>(period));
        }
      }
      EXPECT_EQ(states.back().tick, 39 + report.missed);
    }
}

TEST(Time, DoesNotDriftForAPathInAWeek) {
  constexpr double kPathWeek = 7 * 86400;  // [s]
  Path path{.name = "a week", .time = {0, kPathWeek}, .position = {Vec3::Zero(), Vec3(0.1, 0, 0)}};
  // No double represents these steps exactly. They are as long as allowed, so that a week takes a million of them.
  constexpr double kSpeed = 97.3, kRate = 1000, kStep = 4.9e-3;
  PlaybackController controller(Trajectory(path, Interpolation::linear), {}, {}, {.speed = kSpeed, .rate_hz = kRate});
  State state;
  controller.start(state);
  state.dt = kStep;
  Command command;
  double begun = kNaN;
  long ticks = 0;
  while (command.phase != Phase::hold && ticks < 2'000'000) {
    command = controller.update(state);
    if (command.phase != Phase::run) continue;
    if (std::isnan(begun)) begun = command.reference.time;
    // The pace is always 1. The expected value multiplies whole steps, so it is rounded only once.
    const double expected = begun + kSpeed * kStep * static_cast<double>(ticks++);
    if (expected < kPathWeek) {
      ASSERT_LE(std::abs(command.reference.time - expected), 4e-10) << "tick " << ticks;
    }
  }
  EXPECT_EQ(command.phase, Phase::hold);
  EXPECT_EQ(command.reference.time, kPathWeek);
}

TEST(Time, StampsOfTheUnixEpochPlayLikeThoseFromZero) {
  const Path plain = test::circle();
  Path stamped = plain;
  for (double& t : stamped.time) t += 1.7e9;
  const Trajectory one(plain, Interpolation::cubic), other(stamped, Interpolation::cubic);
  // A double resolves such a time stamp to 0.24 us; at 0.3 m/s this is less than 0.1 um.
  for (double t = 0; t < 1; t += 1.7e-3) {
    const Reference a = one.sample(t), b = other.sample(t);
    ASSERT_LE((a.position - b.position).norm(), 5e-7);
    ASSERT_LE((a.velocity - b.velocity).norm(), 1e-3);
  }
}

TEST(Time, IsExactToTheNanosecondInARecordingAfterAWeek) {
  const test::TempFolder folder;
  Recorder recorder(folder / "week.h5", {}, {});
  constexpr std::int64_t kTick = 333'333;
  for (std::int64_t i = 0; i < 3000; ++i) {
    Sample row;
    row.tick = static_cast<std::uint64_t>(i);
    row.time_ns = (i < 1000 ? 0 : i < 2000 ? kDay : kWeek) + i * kTick;
    row.position = Vec3::Zero();
    row.velocity = Vec3::Zero();
    recorder.push(row);
    recorder.between_ticks(true);
  }
  recorder.finish();
  const RecordingReader reader(folder / "week.h5");
  const auto rows = reader.read(0, reader.rows());
  ASSERT_EQ(rows.size(), 3000U);
  for (std::int64_t i = 0; i < 3000; ++i)
    ASSERT_EQ(rows[static_cast<std::size_t>(i)].time_ns, (i < 1000 ? 0 : i < 2000 ? kDay : kWeek) + i * kTick);
}

TEST(Time, StepsOfNoTimeMoveNothing) {
  for (const double none : kNoSteps) {
    SCOPED_TRACE(fmt::format("{} s", none));
    for (const std::string& name : velocity_estimator_names()) {
      const auto with = make_velocity_estimator(name, 1000, 5e-5), without = make_velocity_estimator(name, 1000, 5e-5);
      for (int i = 0; i < 50; ++i) {
        const Vec3 at(1e-3 * i, -2e-4 * i * i, 0);
        EXPECT_EQ(with->update(at, 1e-3), without->update(at, 1e-3)) << name;
        if (i > 0) {
          EXPECT_EQ(with->update(Vec3(9, 9, 9), none), without->update(at, none)) << name;
        }
      }
    }
    StateObserver observer({.mass = Vec3(1, 0.1, 0), .delay = 3e-3});
    observer.start(Vec3(0.1, 0.2, 0.3));
    for (int i = 0; i < 50; ++i) observer.update(Vec3(0.1, 0.2, 0.3), none, Vec3(1, 2, 3), Vec3::Zero());
    EXPECT_EQ(observer.now().position, Vec3(0.1, 0.2, 0.3));
    EXPECT_EQ(observer.now().velocity, Vec3::Zero());

    NanoTime time;
    time.advance(1);
    EXPECT_EQ(time.advance(none), kSecond);
    Ramp ramp(0.5);
    for (const double target : {0., 1.}) EXPECT_EQ(ramp.advance(target, none, 0.25), 0.5);
    Tuning tuning;
    tuning.approach({.gains = {Vec3::Constant(100), Vec3::Zero()}}, none);
    EXPECT_EQ(tuning.gains.kp, Vec3::Zero());
    ReactionLadder ladder;
    (void)ladder.update(VibrationAlarm{}, none);
    EXPECT_EQ(ladder.share(), 1);

    SimDevice device(test::sim_spec(R"({"mass": 0.4, "max_force": 8, "hand": "relaxed"})"));
    DeviceState state;
    for (int i = 0; i < 10; ++i)
      ASSERT_EQ(device.exchange({Vec3(5, 5, 5), Vec3::Zero()}, none, state), Device::Status::ok);
    EXPECT_EQ(device.true_position(), Vec3::Zero());
  }
}

TEST(Time, PausesOfAnyLengthLeaveEveryFilterFinite) {
  for (const double pause : {1e-9, 0.0049, 0.0051, 1., 3600., 6e5, 1e300}) {
    SCOPED_TRACE(fmt::format("{} s", pause));
    for (const std::string& name : velocity_estimator_names()) {
      const auto estimator = make_velocity_estimator(name, 1000, 5e-5);
      for (int i = 0; i < 30; ++i) {
        const Vec3 v = estimator->update(Vec3(1e-3 * i, 0, 0), i % 10 == 9 ? pause : 1e-3);
        ASSERT_TRUE(is_finite(v)) << name;
      }
    }
    ObserverPd law({.design = {.mass = Vec3::Ones(), .delay = 1e-3, .observer_hz = 20, .authority = 5}});
    OscillationMonitor monitor({.max_force = 10});
    HandWatch hand(HandWatchOptions{});
    State state;
    law.start(state);
    const Reference reference{Vec3(0.01, 0, 0), Vec3::Zero(), Vec3::Zero(), 0};
    for (int i = 0; i < 300; ++i) {
      state.dt = i % 100 == 99 ? pause : 1e-3;
      state.force_applied = Vec3(i % 7, 0, 0);
      ASSERT_TRUE(is_finite(law.force({state, reference, {.gains = {Vec3::Constant(1e3), Vec3::Constant(10)}}})));
      (void)monitor.update(state, reference);
      (void)hand.update(state.force_applied, Vec3(0.01, 0, 0), nan3(), state.dt);
    }
  }
}

TEST(Time, HistogramsTakeAnyDuration) {
  DurationHistogram histogram;
  for (const std::int64_t ns : {std::numeric_limits<std::int64_t>::min(), std::int64_t{-1}, std::int64_t{0}, kWeek,
                                std::numeric_limits<std::int64_t>::max()})
    histogram.record(ns, 1'000'000);
  EXPECT_EQ(histogram.count(), 5'000'000U);
  for (const double q : {-1., 0., 0.5, 1., 2.}) EXPECT_GE(histogram.quantile(q), 0);
  EXPECT_NEAR(histogram.max(), 9.223372036854775e9, 1);
  EXPECT_EQ(histogram.quantile(0.5), 0);
}

}  // namespace
}  // namespace haptrace
