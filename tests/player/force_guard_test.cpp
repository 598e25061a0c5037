// Tests of the guard against vibration in sessions on simulated devices, in virtual time. The guard detects loops that
// vibrate by themselves, and calms or ends them in time. It does not react to hands. docs/monitor.md has the statistics
// of many more cases.
#include "control/force_guard.h"

#include "control/filters.h"
#include "control/path/shapes.h"
#include "control/velocity_estimator.h"
#include "devices/loop/servo_loop.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback.h"
#include "tests/support/point_mass.h"
#include "tests/support/scripted.h"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <optional>

namespace haptrace {
namespace {

using test::Log;

double seconds_at(std::int64_t time_ns) {
  return 1e-9 * static_cast<double>(time_ns);
}

/// Returns the time of the first alarm that a hand cannot cause [s].
std::optional<double> first_alarm(const Log& log) {
  for (const Event& event : log.events)
    if (is_oscillation(event.code)) return seconds_at(event.time_ns);
  return std::nullopt;
}

/// Returns the rms of the sent force above 5 Hz at `time` [N], averaged with a time constant of 50 ms.
double ripple_at(const Log& log, double time, double rate_hz) {
  std::array<Butterworth2, 3> high{Butterworth2(Butterworth2::Kind::high_pass, 5, rate_hz),
                                   Butterworth2(Butterworth2::Kind::high_pass, 5, rate_hz),
                                   Butterworth2(Butterworth2::Kind::high_pass, 5, rate_hz)};
  double energy = 0;
  for (const Sample& sample : log.samples) {
    if (seconds_at(sample.time_ns) > time) break;
    double square = 0;
    for (std::size_t i = 0; i < 3; ++i)
      square += std::pow(high[i].update(sample.force[static_cast<Eigen::Index>(i)]), 2);
    energy += -std::expm1(-1 / (0.05 * rate_hz)) * (square - energy);
  }
  return std::sqrt(energy);
}

/// Expects an alarm by `latest`; 1 s later the ripple is below 0.12 of the largest force or the session has ended.
void expect_noticed_and_calm(const Log& log, const ServoReport& report, double latest, double max_force,
                             double rate_hz = 1000) {
  const auto alarm = first_alarm(log);
  ASSERT_TRUE(alarm);
  EXPECT_LE(*alarm, latest);
  if (report.cause == StopCause::oscillation) return;
  EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
  EXPECT_GT(report.duration, *alarm + 1);
  EXPECT_LT(ripple_at(log, *alarm + 1, rate_hz), 0.12 * max_force);
}

TEST(ForceGuard, NoticesGainsThatMakeAnUncalibratedDeviceUnstable) {
  // Latest time of the alarm after the first tick [s]; the force fades in for 0.5 s.
  for (const auto& [preset, latest] :
       {std::pair{"falcon", 0.6}, {"hapkit", 0.6}, {"inverse3", 0.6}, {"reference", 0.6}, {"touch", 0.6}}) {
    SCOPED_TRACE(preset);
    const auto device = open_device("sim:preset=" + std::string(preset) + ",hand=relaxed,seed=3");
    Log log;
    PlayOptions options;
    options.sinks.push_back(&log);
    options.gains = PdGains{Vec3::Constant(2000), Vec3::Constant(150)};
    options.playback.max_deviation = 1;
    const Path path = make_shape("square", {.size = 0.04, .duration = 4});
    const ServoReport report =
        play(*device, plan_playback(device->info(), path, options), options, StopRequest{}).session.servo;
    expect_noticed_and_calm(log, report, latest, device->info().max_force);
  }
}

/// A simulated device with an additional push, besides the hand that holds it.
class Handled final : public Device {
 public:
  using Push = std::function<double(double)>;  ///< force along x [N] as a function of time [s]

  Handled(const std::string& device, double max_force, Push push) : push_(std::move(push)) {
    SimParts parts = read_sim_device(DeviceSpec::parse(device));
    parts.spec.max_force = 200;  // the session's limit is lower, but a push may exceed it
    device_.emplace(parts.spec, parts.options);
    info_ = device_->info();
    info_.max_force = max_force;
    info_.max_continuous_force = 0;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    time_ += dt;
    return device_->exchange({wrench.force + Vec3(push_(time_), 0, 0), wrench.torque}, dt, state);
  }
  void close() noexcept override {}

 private:
  std::optional<SimDevice> device_;
  DeviceInfo info_;
  Push push_;
  double time_ = 0;
};

/// Force along x [N] as a function of position [m], velocity [m/s] and time [s].
using Law = std::function<double(double, double, double)>;

ServoReport hold(Device& device, const Law& law, double seconds, Log& log, const std::string& velocity = "lowpass:100",
                 double rate_hz = 1000) {
  test::Scripted controller([&](const State& state) {
    const double time = seconds_at(state.time_ns);
    Command command;
    command.wrench.force.x() = law(state.position.x(), state.velocity.x(), time);
    if (time >= seconds) command.status = Command::Status::finished;
    return command;
  });
  const auto estimator = make_velocity_estimator(velocity, rate_hz, 5e-5);
  SampleSink* sinks[] = {&log};
  return ServoLoop(device, controller, *estimator, sinks, {.rate_hz = rate_hz, .virtual_time = true})
      .run(StopRequest{});
}

Law spring(double kp, double kd) {
  return [kp, kd](double x, double v, double) { return -kp * x - kd * v; };
}
Law wall(double stiffness) {
  return [stiffness](double x, double, double) { return x < 0 ? -stiffness * x : 0; };
}
double sinusoid(double hz, double time) {
  return std::sin(2 * std::numbers::pi * hz * time);
}

TEST(ForceGuard, NoticesFrequenciesUpToHalfTheServoRate) {
  constexpr double kMax = 8;
  struct Case {
    double rate_hz, kd;
    const char* velocity;
    double least_hz, most_hz;
  };
  for (const Case& each : {Case{1000, 250, "lowpass:300", 120, 300}, Case{4000, 900, "lowpass:500", 120, 1200},
                           Case{250, 120, "lowpass:75", 15, 112}, Case{1000, 250, "difference", 120, 500}}) {
    SCOPED_TRACE(testing::Message() << each.rate_hz << " Hz, " << each.velocity);
    Handled device("sim:preset=omega3,hand=none,seed=1", kMax, [](double t) { return t < 0.3 ? 0.5 : 0; });
    Log log;
    const ServoReport report = hold(device, spring(200, each.kd), 3, log, each.velocity, each.rate_hz);
    expect_noticed_and_calm(log, report, 0.5, kMax, each.rate_hz);
    EXPECT_GE(report.vibration.frequency_hz, each.least_hz);
    EXPECT_LE(report.vibration.frequency_hz, each.most_hz);
  }
}

TEST(ForceGuard, NoticesAForceThatAlternatesFromTickToTick) {
  // The position responds within a tick: v' = (1 - kd dt / m) v, which alternates and grows for kd dt > 2 m.
  test::PointMass device(0.1, 0.5);
  Log log;
  const ServoReport report = hold(
      device, [](double x, double v, double) { return 200 * (0.005 - x) - 300 * v; }, 3, log, "difference");
  expect_noticed_and_calm(log, report, 0.5, device.info().max_force);
  EXPECT_GT(report.vibration.frequency_hz, 450);
}

/// Returns a push that carries the tool into the wall at 0.5 s and holds it there [N].
double lean(double time) {
  return time < 0.5 ? 1 : -1.5;
}
double lean_hard(double time) {
  return time < 0.5 ? 1 : -5;
}

TEST(ForceGuard, NoticesAWallThatIsTooStiffAndLeavesSofterOnesAlone) {
  constexpr double kMax = 8.9;
  for (const auto& [hand, push] :
       {std::pair{"relaxed", &lean}, {"firm", &lean_hard}, {"loose", &lean}, {"none", &lean}}) {
    for (const double stiffness : {1e3, 5e3, 20e3}) {
      SCOPED_TRACE(testing::Message() << hand << ", " << stiffness << " N/m");
      Handled device("sim:preset=falcon,seed=3,hand=" + std::string(hand), kMax, push);
      Log log;
      const ServoReport report = hold(device, wall(stiffness), 4, log);
      if (stiffness < 20e3)
        EXPECT_FALSE(first_alarm(log)) << *first_alarm(log);
      else
        expect_noticed_and_calm(log, report, 1.1, kMax);
    }
  }
}

/// An ordinary activity of a hand.
struct Activity {
  const char* name;
  double (*push)(double);  ///< see Handled
  const char* options = "hand=relaxed";
};

constexpr Activity kActivities[] = {
    Activity{"Rest", [](double) { return 0.0; }},
    Activity{"Tremor0p1N", [](double t) { return 0.1 * sinusoid(8, t); }},
    Activity{"Tremor0p3NAt4Hz", [](double t) { return 0.3 * sinusoid(4, t); }},
    Activity{"Tremor0p3NAt8Hz", [](double t) { return 0.3 * sinusoid(8, t); }},
    Activity{"Tremor0p3NAt12Hz", [](double t) { return 0.3 * sinusoid(12, t); }},
    Activity{"Tremor1N", [](double t) { return sinusoid(6, t) - 0.5; }},
    Activity{"TremorOfAPatient", [](double) { return 0.0; }, "hand=tremor"},
    Activity{"WritingAt8Hz", [](double t) { return 2.5 * sinusoid(8, t) - 1.5; }},
    Activity{"TapsAt2Hz", [](double t) { return 3 * sinusoid(2, t); }},
    Activity{"TapsAt7Hz", [](double t) { return 3 * sinusoid(7, t) - 0.5; }},
    Activity{"Knocks", [](double t) { return std::fmod(t, 1) < 0.01 ? -6.0 : -0.5; }},
    Activity{"Pushing", [](double t) { return std::fmod(t, 4) < 2 ? -6.0 : 6.0; }},
    Activity{"LettingGo", [](double t) { return t < 3 ? -4.0 : 0.0; }, "hand=firm"},
};

class OrdinaryActivities : public testing::TestWithParam<Activity> {};

TEST_P(OrdinaryActivities, AreNoVibration) {
  for (const char* preset : {"falcon", "omega3"}) {
    for (const auto& [name, law] : {std::pair{"a cautious spring", spring(100, 3)},
                                    {"a stiff spring", spring(1000, 15)},
                                    {"a wall of 1 kN/m", wall(1000)}}) {
      SCOPED_TRACE(testing::Message() << name << " on " << preset);
      Handled device("sim:preset=" + std::string(preset) + ",seed=3," + GetParam().options, 8.9, GetParam().push);
      Log log;
      const ServoReport report = hold(device, law, 20, log);
      EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
      EXPECT_FALSE(first_alarm(log)) << *first_alarm(log);
      EXPECT_FALSE(report.vibration.ended);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, OrdinaryActivities, testing::ValuesIn(kActivities),
                         [](const auto& activity) { return std::string(activity.param.name); });

TEST(ForceGuard, WritingAt8HzOnAWallIsAtMostAHint) {
  // A writing hand touches the wall every 125 ms and absorbs its energy.
  for (const double stiffness : {500.0, 1000.0, 2000.0}) {
    SCOPED_TRACE(stiffness);
    Handled device("sim:preset=omega3,seed=3,hand=firm", 8.9, [](double t) { return 6 * sinusoid(8, t) - 1; });
    Log log;
    const ServoReport report = hold(device, wall(stiffness), 20, log);
    EXPECT_EQ(report.cause, StopCause::finished);
    EXPECT_EQ(report.vibration.steps[static_cast<std::size_t>(VibrationRule::contacts)], 0);
  }
}

}  // namespace
}  // namespace haptrace
