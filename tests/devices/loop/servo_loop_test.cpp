#include "devices/loop/servo_loop.h"

#include "base/error.h"
#include "control/pd.h"
#include "control/resistance_timer.h"
#include "control/velocity_estimator.h"
#include "devices/loop/clock.h"
#include "devices/rest_watch.h"
#include "tests/support/allocations.h"
#include "tests/support/point_mass.h"
#include "tests/support/scripted.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <thread>
#include <tuple>

namespace haptrace {
namespace {

using test::Log;
using test::PointMass;
using test::Scripted;
using testing::HasSubstr;

/// Returns a controller with a constant force that finishes at `tick`.
Scripted push_until(std::uint64_t tick, const Vec3& force) {
  return Scripted([=](const State& state) {
    Command command;
    command.wrench.force = force;
    command.phase = Phase::run;
    if (state.tick >= tick) command.status = Command::Status::finished;
    return command;
  });
}

struct Outcome {
  ServoReport report;
  Log log;
};

Outcome run(Device& device, Controller& controller, ServoOptions options, const StopRequest& stop = {}) {
  Outcome result;
  SampleSink* const sinks[] = {&result.log};
  const auto estimator = make_velocity_estimator("difference", 1000, 0);
  result.report = ServoLoop(device, controller, *estimator, sinks, options).run(stop);
  return result;
}

constexpr ServoOptions kVirtual{.virtual_time = true};

TEST(ServoLoop, TicksAtItsRateInWholeNanoseconds) {
  for (const double rate : {10.0, 250.0, 1000.0, 3000.0, 20000.0}) {
    PointMass device;
    Scripted controller = push_until(99, Vec3::Zero());
    const Outcome result = run(device, controller, {.rate_hz = rate, .virtual_time = true});
    ASSERT_EQ(result.log.samples.size(), 100U);
    const auto period = static_cast<std::int64_t>(std::llround(1e9 / rate));
    for (std::size_t i = 0; i < 100; ++i) {
      EXPECT_EQ(result.log.samples[i].tick, i);
      EXPECT_EQ(result.log.samples[i].time_ns, static_cast<std::int64_t>(i) * period);
      EXPECT_EQ(result.log.samples[i].latency, 0);
    }
    EXPECT_NEAR(result.report.achieved_rate(), rate, 1e-3 * rate);
    EXPECT_EQ(result.report.missed, 0U);
  }
}

TEST(ServoLoop, RefusesRatesItCannotKeep) {
  PointMass device;
  Scripted controller = push_until(0, Vec3::Zero());
  for (const double rate : {0.0, -1.0, 9.9, 20001.0, kNaN}) {
    try {
      run(device, controller, {.rate_hz = rate, .virtual_time = true});
      ADD_FAILURE() << rate;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("it must be from 10 to 20000 Hz"));
    }
  }
}

TEST(ServoLoop, RejectsVirtualTimeForADeviceThatRunsInRealTime) {
  PointMass device;
  device.mutable_info().virtual_time = false;
  Scripted controller = push_until(0, Vec3::Zero());
  EXPECT_THROW(run(device, controller, kVirtual), Error);
}

TEST(ServoLoop, GivesTheControllerThePositionThatTheDeviceGaveAndTheForceItSent) {
  PointMass device;
  std::vector<State> states;
  states.reserve(1000);
  Scripted controller([&](const State& state) {
    states.push_back(state);
    Command command;
    command.wrench.force = Vec3(1, 0, 0);
    if (state.tick == 400) command.status = Command::Status::finished;
    return command;
  });
  const Outcome result = run(device, controller, kVirtual);
  for (std::size_t i = 1; i < states.size(); ++i) {
    EXPECT_EQ(states[i].position, result.log.samples[i].position);
    EXPECT_EQ(states[i].force_applied, result.log.samples[i - 1].force);
    EXPECT_EQ(states[i].dt, 1e-3);
  }
  EXPECT_EQ(states[0].dt, 0);
}

TEST(ServoLoop, FadesForcesInAndOut) {
  PointMass device;
  Scripted controller = push_until(1000, Vec3(1, 2, 2));
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.soft_start = 0.1, .release = 0.2}});
  const auto& samples = result.log.samples;
  EXPECT_EQ(samples.front().force, Vec3::Zero());
  for (std::size_t i = 1; i < 100; ++i) EXPECT_GE(samples[i].force.norm(), samples[i - 1].force.norm());
  EXPECT_NEAR(samples[500].force.norm(), 3, 1e-12);
  for (std::size_t i = 1001; i < samples.size(); ++i) EXPECT_LE(samples[i].force.norm(), samples[i - 1].force.norm());
  EXPECT_EQ(samples.back().force, Vec3::Zero());
  EXPECT_EQ(samples.back().phase, Phase::release);
  EXPECT_NEAR(static_cast<double>(samples.size()), 1200, 2);
}

TEST(ServoLoop, FadesInAndOutAlsoIfFarTooMuchForceIsRequested) {
  for (const double request : {20.0, 1e9}) {
    PointMass device;
    Scripted controller = push_until(300, Vec3(0, request, 0));
    const Outcome result =
        run(device, controller,
            {.virtual_time = true, .limits = {.max_force = 4, .max_velocity = 0, .soft_start = 0.1, .release = 0.2}});
    const auto& samples = result.log.samples;
    ASSERT_GT(samples.size(), 450U);
    EXPECT_NEAR(samples[10].force.y(), 1.6, 0.2) << request;
    EXPECT_NEAR(samples[200].force.y(), 4, 1e-9) << request;
    EXPECT_NEAR(samples[475].force.y(), 2, 0.2) << request;
    for (std::size_t i = 1; i < samples.size(); ++i)
      EXPECT_LT(std::abs(samples[i].force.y() - samples[i - 1].force.y()), 0.17) << request;
  }
}

TEST(ServoLoop, ReportsNoReleasedHandWhereItRemovedTheForceItself) {
  for (const std::uint64_t let_go : {500U, 1050U}) {
    PointMass device;
    Scripted controller([&](const State& state) {
      Command command;
      command.wrench.force = Vec3(1, 2, 2);
      if (state.tick == let_go) command.event = Event{.code = EventCode::hand_let_go};
      if (state.tick == 1000) command.status = Command::Status::finished;
      return command;
    });
    const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.release = 0.2}});
    EXPECT_EQ(result.log.has(EventCode::hand_let_go), let_go < 1000) << let_go;
  }
}

TEST(ServoLoop, EndsSoonOnRequestWhileTheForceFades) {
  PointMass device;
  StopRequest stop;
  Scripted controller([&](const State& state) {
    Command command;
    command.wrench.force = Vec3(1, 2, 2);
    command.phase = Phase::run;
    if (state.tick == 500) command.status = Command::Status::finished;
    if (state.tick == 1000) stop.raise();
    return command;
  });
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.release = 1e9}}, stop);
  EXPECT_EQ(result.report.cause, StopCause::finished) << "it was, before it was asked to";
  EXPECT_GT(result.log.samples[990].force.norm(), 2.9) << "its own fade lasts";
  EXPECT_NEAR(static_cast<double>(result.log.samples.size()), 3000, 3) << "two seconds from then on";
  EXPECT_EQ(device.forces().back(), Vec3::Zero());
}

TEST(ServoLoop, NeverSendsMoreThanTheLargestForceOfTheDevice) {
  PointMass device(1000);
  Scripted controller = push_until(500, Vec3(1e6, 0, 0));
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.max_force = 50}});
  for (const Vec3& force : device.forces()) EXPECT_LE(force.norm(), 10 * (1 + 1e-12));
  EXPECT_NEAR(result.report.max_force, 10, 1e-9);
  EXPECT_TRUE(result.log.has(EventCode::force_limit));
}

TEST(ServoLoop, ReportsALimitOnceASecondNotEveryTick) {
  PointMass device(1000);
  device.mutable_info().max_continuous_force = 10;
  Scripted controller = push_until(2500, Vec3(1e6, 0, 0));
  const Outcome result = run(device, controller, kVirtual);
  const auto told = std::count_if(result.log.events.begin(), result.log.events.end(),
                                  [](const Event& event) { return event.code == EventCode::force_limit; });
  EXPECT_EQ(told, 3);
}

TEST(ServoLoop, SendsNothingToAxesWithoutAMotor) {
  PointMass device;
  device.mutable_info().force_axes = {true, true, false};
  Scripted controller = push_until(300, Vec3(1, 1, 1));
  const Outcome result = run(device, controller, kVirtual);
  for (const Vec3& force : device.forces()) EXPECT_EQ(force.z(), 0);
  EXPECT_GT(device.forces()[280].x(), 0.9);
}

// Ways in which a session ends, and the expected results.
struct WayOut {
  const char* name;
  StopCause cause;
  const char* detail;
  PointMass::Faults faults{};
  std::function<Command(const State&, StopRequest&)> script{};
  bool fault = true;
};

class EveryWayOut : public testing::TestWithParam<WayOut> {};

TEST_P(EveryWayOut, EndsWithZeroForceAndReportsTheReason) {
  const WayOut& way = GetParam();
  PointMass device(0.5, 2, way.faults);
  StopRequest stop;
  Scripted controller([&](const State& state) {
    Command command;
    command.wrench.force = Vec3(2, 0, 0);
    command.phase = Phase::run;
    return way.script && state.tick >= 500 ? way.script(state, stop) : command;
  });
  const Outcome result =
      run(device, controller, {.virtual_time = true, .limits = {.max_velocity = 5, .release = 0.1}}, stop);

  EXPECT_EQ(result.report.cause, way.cause) << to_string(result.report.cause);
  EXPECT_THAT(result.report.detail, HasSubstr(way.detail));
  EXPECT_GT(device.forces()[490].norm(), 1.9) << "there was a force to stop";
  if (way.cause != StopCause::device_lost) {
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
  }
  EXPECT_LT(result.log.samples.size(), 700U);
  if (way.fault) {
    ASSERT_FALSE(result.report.flight_record.empty());
    EXPECT_LE(result.report.flight_record.size(), 200U);
    EXPECT_EQ(result.report.flight_record.back().tick, result.log.samples.back().tick);
    EXPECT_GE(result.report.flight_record.back().time_ns - result.report.flight_record.front().time_ns, 190'000'000);
  } else {
    EXPECT_TRUE(result.report.flight_record.empty());
    EXPECT_EQ(result.log.samples.back().force, Vec3::Zero());
  }
}

Command pushing(Command::Status status = Command::Status::working) {
  Command command;
  command.wrench.force = Vec3(2, 0, 0);
  command.phase = Phase::run;
  command.status = status;
  return command;
}

INSTANTIATE_TEST_SUITE_P(
    Sessions, EveryWayOut,
    testing::Values(WayOut{.name = "Finished",
                           .cause = StopCause::finished,
                           .detail = "",
                           .script = [](const State&, StopRequest&) { return pushing(Command::Status::finished); },
                           .fault = false},
                    WayOut{.name = "Interrupted",
                           .cause = StopCause::interrupted,
                           .detail = "interrupted",
                           .script =
                               [](const State& state, StopRequest& stop) {
                                 if (state.tick == 500) stop.raise();
                                 return pushing();
                               },
                           .fault = false},
                    WayOut{.name = "InterruptedTwice",
                           .cause = StopCause::interrupted,
                           .detail = "interrupted",
                           .script =
                               [](const State&, StopRequest& stop) {
                                 stop.raise();
                                 return pushing();
                               },
                           .fault = false},
                    WayOut{
                        .name = "Deviation",
                        .cause = StopCause::deviation,
                        .detail = "50.0 mm off the path, the limit is 30.0 mm",
                        .script =
                            [](const State&, StopRequest&) {
                              Command command = pushing(Command::Status::deviation);
                              command.event = Event{.code = EventCode::deviation_limit, .values = {0.05, 0.03, kNaN}};
                              return command;
                            }},
                    WayOut{.name = "PositionJumps",
                           .cause = StopCause::velocity,
                           .detail = "m/s is over the limit of 5 m/s",
                           .faults = {.jump_at = 600}},
                    WayOut{.name = "PositionIsNotANumber",
                           .cause = StopCause::not_finite,
                           .detail = "position is not finite",
                           .faults = {.nan_at = 600}},
                    WayOut{.name = "ForceIsNotANumber",
                           .cause = StopCause::not_finite,
                           .detail = "force is not finite",
                           .script =
                               [](const State&, StopRequest&) {
                                 Command command = pushing();
                                 command.wrench.force.y() = kNaN;
                                 return command;
                               }},
                    WayOut{.name = "ForceIsInfinite",
                           .cause = StopCause::not_finite,
                           .detail = "force is not finite",
                           .script =
                               [](const State&, StopRequest&) {
                                 Command command = pushing();
                                 command.wrench.force.z() = std::numeric_limits<double>::infinity();
                                 return command;
                               }},
                    WayOut{.name = "DeviceNoLongerReady",
                           .cause = StopCause::device_not_ready,
                           .detail = "no longer allows forces: its lid is open",
                           .faults = {.ready_until = 600}},
                    WayOut{.name = "DeviceLost",
                           .cause = StopCause::device_lost,
                           .detail = "the device was lost: ",
                           .faults = {.lost_at = 600}}),
    [](const auto& instance) { return instance.param.name; });

TEST(ServoLoop, FadesTheLastTrustedForceAfterADeviation) {
  PointMass device(100);
  Scripted controller([](const State& state) {
    Command command = pushing(state.tick < 500 ? Command::Status::working : Command::Status::deviation);
    if (state.tick >= 500) command.wrench.force = Vec3(-9, 9, 0);
    return command;
  });
  const Outcome result = run(device, controller, kVirtual);
  for (std::size_t i = 500; i < result.log.samples.size(); ++i) {
    EXPECT_GE(result.log.samples[i].force.x(), 0) << "the new force is not trusted";
    EXPECT_LE(result.log.samples[i].force.norm(), 2);
    EXPECT_EQ(result.log.samples[i].phase, Phase::stopped);
  }
  EXPECT_NEAR(static_cast<double>(result.log.samples.size()), 550, 2);
}

/// Returns a controller whose force oscillates in open loop for 2 s.
Scripted shaking(double hz, const Vec3& amplitude, const Vec3& feedforward, double declared) {
  return Scripted([=](const State& state) {
    Command command;
    const double sine = std::sin(2 * std::numbers::pi * hz * 1e-9 * static_cast<double>(state.time_ns));
    command.feedforward = sine * feedforward;
    command.wrench.force = sine * amplitude + command.feedforward;
    command.vibration = declared;
    if (state.tick >= 2000) command.status = Command::Status::finished;
    return command;
  });
}

TEST(ServoLoop, SoftensAForceThatVibratesInEverySessionAndReportsIt) {
  PointMass device(100);
  Scripted controller = shaking(60, Vec3(4, 0, 0), Vec3::Zero(), 0);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  EXPECT_TRUE(result.report.vibration.watched);
  EXPECT_LE(result.report.vibration.share, 0.3);
  EXPECT_NEAR(result.report.vibration.frequency_hz, 60, 2);
  EXPECT_GT(result.report.vibration.worst_ripple, 2);
  const auto steps = std::count_if(result.log.events.begin(), result.log.events.end(),
                                   [](const Event& event) { return is_oscillation(event.code); });
  EXPECT_GE(steps, 1);
  for (std::size_t i = 900; i < result.log.samples.size(); ++i)
    EXPECT_LE(result.log.samples[i].force.norm(), 4 * result.report.vibration.share + 1e-9);
}

TEST(ServoLoop, GivesTheFeedbackBackToGainsThatReplaceThoseThatVibrated) {
  PointMass device(100);
  bool vibrated = false, vibrates_after = false;
  Scripted controller([&](const State& state) {
    Command command;
    const bool other = state.tick >= 1000;
    const double sine = std::sin(2 * std::numbers::pi * 60e-9 * static_cast<double>(state.time_ns));
    command.wrench.force = other ? Vec3(0.5, 0, 0) : Vec3(4 * sine, 0, 0);
    command.renewed = state.tick == 1000;
    vibrated |= state.vibrated;
    vibrates_after |= state.tick > 1000 && state.vibrated;
    if (state.tick >= 2000) command.status = Command::Status::finished;
    return command;
  });
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  EXPECT_TRUE(vibrated);
  EXPECT_FALSE(vibrates_after);
  EXPECT_EQ(result.report.vibration.share, 1);
  const auto is_renewal = [](const Event& event) { return event.code == EventCode::feedback_renewed; };
  ASSERT_EQ(std::ranges::count_if(result.log.events, is_renewal), 1);
  const Event renewal = *std::ranges::find_if(result.log.events, is_renewal);
  EXPECT_EQ(renewal.values[1], 1);
  EXPECT_THAT(describe(renewal), HasSubstr("to 100 %"));
  EXPECT_LT(result.log.samples[1001].force.norm(), 0.2) << "without a jump";
  EXPECT_NEAR(result.log.samples[1600].force.norm(), 0.5, 1e-6);
}

TEST(ServoLoop, EndsASessionWhoseForceKeepsVibrating) {
  PointMass device(100);
  Scripted controller = shaking(60, Vec3(4000, 0, 0), Vec3::Zero(), 0);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::oscillation);
  EXPECT_LT(result.report.duration, 1.2);
  EXPECT_TRUE(result.report.vibration.ended);
  EXPECT_THAT(result.report.detail, HasSubstr("still vibrates at 60 Hz"));
  EXPECT_EQ(result.log.samples.back().phase, Phase::stopped);
}

TEST(ServoLoop, LeavesFeedforwardDeclaredVibrationAndExperimentsAlone) {
  for (const auto& [feedforward, declared, watch] :
       {std::tuple{Vec3(4, 0, 0), 0.0, true}, {Vec3(0, 0, 0), 4.0, true}, {Vec3(0, 0, 0), 0.0, false}}) {
    PointMass device(100);
    Scripted controller = shaking(60, Vec3(4, 0, 0) - feedforward, feedforward, declared);
    const Outcome result = run(device, controller, {.virtual_time = true, .watch_vibration = watch});
    EXPECT_EQ(result.report.vibration.share, 1);
    double largest = 0;
    for (std::size_t i = 1500; i < 2000; ++i) largest = std::max(largest, result.log.samples[i].force.norm());
    EXPECT_NEAR(largest, 4, 0.1);
  }
}

TEST(ServoLoop, MissesTicksThatComeTooLateAndNeverCatchesUp) {
  PointMass device;
  Scripted controller([stalled = false](const State& state) mutable {
    if (state.tick >= 50 && !std::exchange(stalled, true)) {  // a busy machine may miss tick 50 itself
      const std::int64_t until = monotonic_ns() + 25'000'000;
      while (monotonic_ns() < until) {
      }
    }
    Command command;
    if (state.tick >= 150) command.status = Command::Status::finished;
    return command;
  });
  const Outcome result = run(device, controller, {.realtime = false});
  EXPECT_GE(result.report.missed, 24U);
  EXPECT_GE(result.report.overruns, 1U);
  EXPECT_TRUE(result.log.has(EventCode::overrun));
  const auto& samples = result.log.samples;
  EXPECT_EQ(samples.front().time_ns, 0) << "time begins at the first sample, however late it woke";
  EXPECT_EQ(samples.size() + result.report.missed, samples.back().tick + 1);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    EXPECT_GT(samples[i].time_ns, samples[i - 1].time_ns);
    // Each tick wakes at or after its deadline, and the deadlines stay on the grid: ticks never bunch up.
    EXPECT_GE(samples[i].latency, 0);
    const auto deadline = [&](const Sample& s) { return 1e-9 * static_cast<double>(s.time_ns) - double(s.latency); };
    EXPECT_NEAR(deadline(samples[i]) - deadline(samples[0]), 1e-3 * static_cast<double>(samples[i].tick), 1e-8);
  }
}

TEST(ServoLoop, WaitsForADeviceThatIsNotReadyYetAndSendsItNoForce) {
  PointMass device(0.5, 2, {.ready_from = 300});
  Scripted controller = push_until(200, Vec3(1, 0, 0));
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  for (std::size_t i = 0; i < 300; ++i) EXPECT_EQ(device.forces()[i], Vec3::Zero());
  EXPECT_EQ(result.log.samples.front().time_ns, 0);
  EXPECT_EQ(result.log.samples.front().tick, 0U);
}

TEST(ServoLoop, ReportsThatADeviceBecameReadyAndAfterHowLong) {
  const auto codes_of = [](std::uint64_t ready_from) {
    PointMass device(0.5, 2, {.ready_from = ready_from});
    Scripted controller = push_until(10, Vec3(1, 0, 0));
    const Outcome result = run(device, controller, kVirtual);
    std::vector<EventCode> codes;
    for (const Event& event : result.log.events) {
      codes.push_back(event.code);
      EXPECT_EQ(event.time_ns == 0, event.code != EventCode::finished) << "before the first tick";
      if (event.code == EventCode::device_ready) {
        EXPECT_EQ(describe(event), "the device was ready after 0.6 s");
      }
    }
    return codes;
  };
  using enum EventCode;
  EXPECT_THAT(codes_of(300), testing::ElementsAre(device_not_ready, device_ready, started, finished));
  EXPECT_THAT(codes_of(0), testing::ElementsAre(started, finished)) << "a device that is ready at once needs no event";
}

TEST(ServoLoop, GivesUpOnADeviceThatNeverGetsReady) {
  PointMass device(0.5, 2, {.ready_from = PointMass::kNever});
  Scripted controller = push_until(200, Vec3(1, 0, 0));
  const Outcome result = run(device, controller, {.virtual_time = true, .ready_timeout = 2});
  EXPECT_EQ(result.report.cause, StopCause::device_not_ready);
  EXPECT_THAT(result.report.detail, HasSubstr("did not become ready within 2 s: its lid is open"));
  EXPECT_EQ(result.report.samples, 0U);
}

TEST(ServoLoop, AllocatesNothingInATick) {
  PointMass device;
  const PdGains gains{Vec3::Constant(500), Vec3::Constant(5)};
  std::size_t first = 0, last = 0;
  Scripted controller([&](const State& state) {
    if (state.tick == 1) first = test::allocations();
    if (state.tick == 900) last = test::allocations();
    Command command;
    command.reference = {Vec3(0.01, 0, 0), Vec3::Zero(), Vec3::Zero()};
    command.wrench.force = pd_force(gains, state, command.reference);
    if (state.tick > 900) command.status = Command::Status::finished;
    return command;
  });
  run(device, controller, {.virtual_time = true, .limits = {.max_force = 1, .max_continuous_force = 0.5}});
  EXPECT_EQ(last, first);
}

// ---- sustained forces ----

/// Virtual time in which every tick lasts `periods` periods.
class SlowClock final : public ServoClock {
 public:
  explicit SlowClock(std::int64_t periods) : periods_(periods) {}
  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override { now_ = std::max(time_ns, now_ + periods_ * 1'000'000); }

 private:
  std::int64_t periods_, now_ = 0;
};

double seconds(const Sample& sample) {
  return 1e-9 * static_cast<double>(sample.time_ns);
}

/// Returns a controller that demands 20 N for `duration` [s], with this patience [s].
Scripted demand(double duration, double patience = 0) {
  return Scripted([=](const State& state) {
    Command command;
    command.wrench.force = Vec3(20, 0, 0);
    command.patience = patience;
    command.phase = Phase::run;
    if (1e-9 * static_cast<double>(state.time_ns) >= duration) command.status = Command::Status::finished;
    return command;
  });
}

TEST(ServoLoop, LimitsForcesByTheirDurationAtAnyTickTimes) {
  for (const std::int64_t periods : {1, 3, 15}) {
    PointMass device(1000);
    Scripted controller = demand(3);
    SlowClock clock(periods);
    ServoOptions options{.virtual_time = true, .clock = &clock};
    options.limits = {.max_continuous_force = 3, .soft_start = 0};
    const Outcome result = run(device, controller, options);
    const auto& rows = result.log.samples;
    const auto limited =
        std::find_if(rows.begin() + 5, rows.end(), [](const Sample& row) { return row.force.norm() < 9.99; });
    ASSERT_NE(limited, rows.end());
    EXPECT_NEAR(seconds(*limited), 10 * std::log(1 / (1 - 0.64 * 0.09)), 0.005 + 2e-3 * static_cast<double>(periods))
        << periods << " periods a tick";
  }
}

TEST(ServoLoop, LimitsADeviceThatStatesNoContinuousForceWithCautionAndReportsItOnce) {
  PointMass device(1000);
  Scripted controller = demand(12);
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.soft_start = 0}});
  EXPECT_EQ(result.report.cause, StopCause::finished);
  for (const Sample& row : result.log.samples) {
    if (seconds(row) > 0.1 && seconds(row) < 1.1) {
      EXPECT_NEAR(row.force.norm(), 10, 1e-9);
    }
    if (seconds(row) > 4.7) {
      EXPECT_LT(row.force.norm(), 1.1 * 3.05);
    }
  }
  std::vector<std::string> words;
  for (const Event& event : result.log.events)
    if (event.code == EventCode::continuous_limit) words.push_back(describe(event));
  ASSERT_GT(words.size(), 5U);
  EXPECT_THAT(words.front(), HasSubstr("the device states no continuous force, 3 N are assumed"));
  for (const std::string& text : words) EXPECT_LE(text.size(), 127U);
  EXPECT_THAT(words.back(), testing::Not(HasSubstr("assumed")));
}

TEST(ServoLoop, TakesTheContinuousForceThatDeviceOrSessionState) {
  const auto settles_at = [](double of_device, double of_session) {
    PointMass device(1e5);
    device.mutable_info().max_continuous_force = of_device;
    Scripted controller = demand(60);
    const Outcome result =
        run(device, controller, {.virtual_time = true, .limits = {.max_continuous_force = of_session}});
    for (const Event& event : result.log.events) EXPECT_THAT(describe(event), testing::Not(HasSubstr("assumed")));
    return result.log.samples[50'000].force.norm();
  };
  EXPECT_NEAR(settles_at(5, 0), 5, 0.1);
  EXPECT_NEAR(settles_at(5, 2), 2, 0.1);
  EXPECT_NEAR(settles_at(0, 6), 6, 0.2);
  EXPECT_NEAR(settles_at(10, 0), 10, 1e-9) << "it bears its peak for ever";
}

TEST(ServoLoop, EndsASessionThatAHandResistsForLongerThanItsControllerAllows) {
  for (const double continuous : {0.0, 4.0, 10.0}) {
    SCOPED_TRACE(continuous);
    PointMass device(1000);
    device.mutable_info().max_continuous_force = continuous;
    Scripted controller = demand(60, kPatience);
    const Outcome result = run(device, controller, kVirtual);
    EXPECT_EQ(result.report.cause, StopCause::resistance);
    EXPECT_EQ(result.report.detail, "stopped: the hand resisted the force for 15 s");
    EXPECT_NEAR(result.report.duration, 15.8, 1.3);
    const auto count = [&](EventCode code) {
      return std::count_if(result.log.events.begin(), result.log.events.end(),
                           [&](const Event& event) { return event.code == code; });
    };
    EXPECT_EQ(count(EventCode::force_resisted), 1);
    EXPECT_EQ(count(EventCode::resistance_limit), 1);
    EXPECT_EQ(result.log.samples.back().phase, Phase::stopped);
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
  }
}

TEST(ServoLoop, BlamesNoHandForAForceThatSways) {
  for (const double frequency_hz : {2.0, 5.0, 12.0}) {
    SCOPED_TRACE(frequency_hz);
    PointMass device(1000);
    Scripted controller([=](const State& state) {
      Command command;
      const double phase = 1e-9 * static_cast<double>(state.time_ns) * frequency_hz;
      command.wrench.force = Vec3(phase - std::floor(phase) < 0.5 ? 100 : -100, 0, 0);
      command.patience = kPatience;
      if (state.tick >= 40'000) command.status = Command::Status::finished;
      return command;
    });
    const Outcome result = run(device, controller, {.virtual_time = true, .watch_vibration = false});
    EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
    EXPECT_FALSE(result.log.has(EventCode::force_resisted));
  }
}

TEST(ServoLoop, ContinuesAgainstAHandForEverIfItsControllerAllowsIt) {
  PointMass device(1000);
  Scripted controller = demand(40);
  EXPECT_EQ(run(device, controller, kVirtual).report.cause, StopCause::finished);
}

TEST(ServoLoop, LimitsTorquesThatLastAsItDoesForces) {
  PointMass device(1000);
  device.mutable_info().torque_axes = {true, true, true};
  device.mutable_info().max_torque = 0.4;
  Scripted controller([](const State& state) {
    Command command;
    command.wrench.torque = Vec3(0, 1, 0);
    if (state.tick >= 10'000) command.status = Command::Status::finished;
    return command;
  });
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_NEAR(result.log.samples[1000].torque.norm(), 0.4, 1e-9);
  EXPECT_LT(result.log.samples[9000].torque.norm(), 1.1 * 0.12);
  EXPECT_TRUE(result.log.has(EventCode::continuous_limit));
}

// ---- rest after homing ----

/// Becomes ready during a push that continues for 0.5 s.
class PushedHome final : public Device {
 public:
  PushedHome() {
    info_.name = "pushed home";
    info_.virtual_time = true;
    info_.max_force = 10;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    time_ += dt;
    state = DeviceState{};
    state.ready = time_ > 0.2;
    state.position.x() = 0.1 * std::min(time_, still_at);
    pushed_while_moving = pushed_while_moving || (time_ < still_at && !wrench.force.isZero(0));
    return Status::ok;
  }
  void close() noexcept override {}

  double still_at = 0.7;  ///< end of the push [s]
  bool pushed_while_moving = false;

 private:
  DeviceInfo info_;
  double time_ = 0;
};

TEST(ServoLoop, WaitsUntilAHandleThatIsStillPushedHomeRests) {
  PushedHome device;
  Scripted controller = push_until(500, Vec3(5, 0, 0));
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  EXPECT_FALSE(device.pushed_while_moving);
  EXPECT_NEAR(result.log.samples.front().position.x(), 0.07, 1e-9);
  EXPECT_NEAR(result.report.max_force, 5, 1e-9);
}

TEST(ServoLoop, ReportsThatAHandleDoesNotComeToRest) {
  PushedHome device;
  device.still_at = 1e9;
  Scripted controller = push_until(500, Vec3(5, 0, 0));
  const Outcome result = run(device, controller, {.virtual_time = true, .ready_timeout = 2});
  EXPECT_EQ(result.report.cause, StopCause::device_not_ready);
  EXPECT_THAT(result.report.detail, HasSubstr("its handle does not come to rest: hold it still"));
  EXPECT_FALSE(device.pushed_while_moving);
}

/// A handle that nobody moves. Its measured position jumps once, as after a lost count of an encoder.
class Jumping final : public Device {
 public:
  explicit Jumping(double jump) : jump_(jump) {
    info_.name = "jumping encoder";
    info_.virtual_time = true;
    info_.workspace_min = Vec3::Constant(-0.1);
    info_.workspace_max = Vec3::Constant(0.1);
    info_.max_force = 10;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double, DeviceState& state) noexcept override {
    force = wrench.force.x();
    state = DeviceState{};
    state.ready = true;
    if (++calls_ > 500) state.position.x() = jump_;
    return Status::ok;
  }
  void close() noexcept override {}

  double force = 0;  ///< last force received [N]

 private:
  DeviceInfo info_;
  double jump_;
  int calls_ = 0;
};

TEST(ServoLoop, BoundsTheKickAfterAJumpOfThePositionThatTheSpeedLimitLetsPass) {
  // The numbers are in docs/safety.md: the default velocity estimator shows a jump as a speed of at most 280 / s times
  // its length.
  constexpr double kSpeedOfJump = 280, kKp = 3000, kKd = 25;
  for (const double jump : {0.1e-3, 1e-3, 1.4e-3, 5e-3, 5.5e-3}) {
    SCOPED_TRACE(jump);
    Jumping device(jump);
    Scripted controller([&](const State& state) {
      Command command;
      command.phase = Phase::run;
      command.wrench.force = -kKp * state.position - kKd * state.velocity;
      if (state.tick >= 600) command.status = Command::Status::finished;
      return command;
    });
    Log log;
    SampleSink* const sinks[] = {&log};
    const auto estimator = make_velocity_estimator("lowpass:100", 1000, 0);
    ServoOptions options = kVirtual;
    options.limits = {.max_velocity = 1.5};
    const ServoReport report = ServoLoop(device, controller, *estimator, sinks, options).run({});
    double speed = 0, force = 0, later = 0;
    for (const Sample& sample : log.samples) {
      speed = std::max(speed, sample.velocity.norm());
      force = std::max(force, sample.force.norm());
      if (sample.tick > 510) later = std::max(later, sample.force.norm());
    }
    EXPECT_EQ(device.force, 0);
    EXPECT_LE(speed, kSpeedOfJump * jump);
    if (kSpeedOfJump * jump > 1.5) {
      EXPECT_EQ(report.cause, StopCause::velocity);
      EXPECT_LE(force, std::min(10.0, kKp * jump + kKd * 1.5));
      EXPECT_EQ(later, 0);
      continue;
    }
    EXPECT_EQ(report.cause, StopCause::finished);
    EXPECT_GT(speed, 0.95 * kSpeedOfJump * jump);
    EXPECT_LE(force, std::min(10.0, kKp * jump + kKd * kSpeedOfJump * jump));
    EXPECT_GE(force, std::min(10.0, 0.9 * (kKp * jump + kKd * kSpeedOfJump * jump)));
    EXPECT_LT(later, 1.1 * kKp * jump) << "after 10 ms, the spring alone is left";
  }
}

TEST(ServoLoop, IsTheSameToTheBitInVirtualTime) {
  const auto session = [] {
    PointMass device;
    const PdGains gains{Vec3::Constant(900), Vec3::Constant(5)};
    Scripted controller([&](const State& state) {
      Command command;
      command.reference = {Vec3(0.01 * std::sin(1e-9 * static_cast<double>(state.time_ns)), 0, 0), Vec3::Zero(),
                           Vec3::Zero()};
      command.wrench.force = pd_force(gains, state, command.reference);
      if (state.tick > 900) command.status = Command::Status::finished;
      return command;
    });
    return run(device, controller, kVirtual).log.samples;
  };
  const auto one = session(), other = session();
  ASSERT_EQ(one.size(), other.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].position, other[i].position);
    EXPECT_EQ(one[i].force, other[i].force);
    EXPECT_EQ(one[i].velocity, other[i].velocity);
  }
}

TEST(ServoLoop, FlushesDenormalsInTheTickAndRestoresTheModeAfterwards) {
  PointMass device;
  volatile double tiny = 1e-308;
  double in_tick = 1;
  Scripted controller([&](const State&) {
    in_tick = tiny * 0.01;
    Command command;
    command.status = Command::Status::finished;
    return command;
  });
  run(device, controller, kVirtual);
  EXPECT_EQ(in_tick, 0);
  EXPECT_GT(tiny * 0.01, 0);
}

TEST(ServoLoop, StopsAWrongForceSignBeforeItRunsAway) {
  PointMass device(0.2, 0, {.pushes_back = true});
  device.place(Vec3(0.01, 0, 0));
  const PdGains gains{Vec3::Constant(1000), Vec3::Constant(2)};
  Scripted controller([&](const State& state) {
    Command command;
    command.reference = {Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
    command.wrench.force = pd_force(gains, state, command.reference);
    return command;
  });
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.max_velocity = 1}});
  EXPECT_EQ(result.report.cause, StopCause::velocity);
  EXPECT_LT(result.log.samples.back().position.norm(), 0.2);
  EXPECT_EQ(device.forces().back(), Vec3::Zero());
}

// ----------------------------------------------------------------------------------------------------- lost devices

/// Pushes until a tick and records its states and resumptions.
class Resuming final : public Controller {
 public:
  explicit Resuming(std::uint64_t last) : last_(last) { states.reserve(10000); }
  void start(const State&) noexcept override { ++starts; }
  void resume(const State& first) noexcept override {
    resumed_at = first;
    ++resumes;
  }
  [[nodiscard]] Command update(const State& state) noexcept override {
    states.push_back(state);
    return pushing(state.tick >= last_ ? Command::Status::finished : Command::Status::working);
  }

  int starts = 0, resumes = 0;
  State resumed_at;
  std::vector<State> states;

 private:
  std::uint64_t last_;
};

constexpr ServoOptions kPatient{.virtual_time = true, .away_timeout = 1};
const PointMass::Faults kGap{.away_from = 601, .away_until = 801, .moved_while_away = Vec3(0.05, 0, 0)};

TEST(ServoLoop, LeavesAGapInTheSamplesButNotInTimeWhileTheDeviceIsAway) {
  PointMass device(0.5, 20, kGap);
  Resuming controller(1500);
  const Outcome result = run(device, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  const auto& rows = result.log.samples;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    ASSERT_EQ(rows[i].tick, i < 600 ? i : i + 200);
    ASSERT_EQ(rows[i].time_ns, 1'000'000 * static_cast<std::int64_t>(rows[i].tick)) << "time goes on";
  }
  std::vector<std::pair<EventCode, std::int64_t>> told;
  for (const Event& event : result.log.events)
    if (event.code == EventCode::device_lost || event.code == EventCode::device_found)
      told.emplace_back(event.code, event.time_ns);
  EXPECT_EQ(told, (std::vector<std::pair<EventCode, std::int64_t>>{{EventCode::device_lost, 600'000'000},
                                                                   {EventCode::device_found, 800'000'000}}));
  EXPECT_EQ(result.report.returns, 1U);
  EXPECT_NEAR(result.report.away, 0.2, 1e-9);
  EXPECT_NEAR(result.report.achieved_rate(), 1000, 1e-6) << "while it was there";
  EXPECT_EQ(result.report.missed, 0U);
}

TEST(ServoLoop, ComesBackToADeviceWithZeroForceAndFadesIn) {
  PointMass device(0.5, 20, kGap);
  Resuming controller(1500);
  ServoOptions options = kPatient;
  options.limits = {.max_velocity = 1, .soft_start = 0.1};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << "the jump of the position is no speed";
  EXPECT_FALSE(device.force_while_away());
  EXPECT_GT(device.forces()[600].norm(), 1.9);
  EXPECT_EQ(device.forces()[601], Vec3::Zero()) << "the first that the device sees again";
  const auto& rows = result.log.samples;
  EXPECT_EQ(rows[600].force, Vec3::Zero());
  for (std::size_t i = 601; i < 700; ++i) {
    EXPECT_GE(rows[i].force.x(), rows[i - 1].force.x());
    EXPECT_LE(rows[i].force.x() - rows[i - 1].force.x(), 2 / 100.0 + 1e-12);
  }
  EXPECT_NEAR(rows[700].force.x(), 2, 1e-9);
  EXPECT_EQ(rows[600].velocity, Vec3::Zero()) << "estimated anew";
  EXPECT_EQ(controller.starts, 1);
  EXPECT_EQ(controller.resumes, 1);
  EXPECT_EQ(controller.resumed_at.tick, 800U);
  EXPECT_EQ(controller.resumed_at.position, rows[600].position);
  EXPECT_EQ(controller.states[600].dt, 0) << "no time that a controller could integrate over";
  EXPECT_EQ(controller.states[600].force_applied, Vec3::Zero());
  EXPECT_EQ(controller.states[601].dt, 1e-3);
}

TEST(ServoLoop, DoesNotAssumeThatMotorsCooledWhileTheDeviceWasAway) {
  PointMass device(1000, 0, {.away_from = 4001, .away_until = 9001});
  Resuming controller(11000);
  ServoOptions options{.virtual_time = true, .away_timeout = 10};
  options.limits = {.max_continuous_force = 1, .continuous_time = 2};
  const Outcome result = run(device, controller, options);
  const auto& rows = result.log.samples;
  ASSERT_LT(rows[3999].force.x(), 1.2) << "limited when it is lost";
  ASSERT_EQ(rows[4000].tick, 9000U);
  // Cool motors withstand 2 N for at least 0.35 s. These motors count as cooled only during the fade-in.
  const auto strong =
      std::count_if(rows.begin() + 4000, rows.begin() + 5000, [](const Sample& row) { return row.force.x() > 1.9; });
  EXPECT_LT(strong, 150);
}

TEST(ServoLoop, EndsWhenADeviceDoesNotComeBackInTimeAndReportsTheWait) {
  PointMass device(0.5, 20, {.away_from = 601});
  Resuming controller(5000);
  const Outcome result = run(device, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_THAT(result.report.detail, testing::AllOf(HasSubstr("the device was lost: the device stopped answering"),
                                                   HasSubstr("the session waited 1 s for it")));
  EXPECT_EQ(result.log.samples.size(), 600U);
  ASSERT_FALSE(result.report.flight_record.empty());
  EXPECT_EQ(result.log.events.back().code, EventCode::device_lost);
  EXPECT_EQ(result.log.events.back().time_ns, 1'600'000'000);
  EXPECT_EQ(describe(result.log.events.back()), "the device did not come back within 1 s");
}

TEST(ServoLoop, DoesNotWaitForADeviceUnlessTheOptionIsSet) {
  PointMass device(0.5, 20, kGap);
  Resuming controller(1500);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_EQ(result.report.detail, "the device was lost: the device stopped answering");
  EXPECT_EQ(result.log.samples.size(), 600U);
  EXPECT_EQ(std::count_if(result.log.events.begin(), result.log.events.end(),
                          [](const Event& event) { return event.code == EventCode::device_lost; }),
            1);
}

TEST(ServoLoop, TreatsADeviceThatIsFoundButNotReadyAsAway) {
  PointMass device(0.5, 20, {.away_from = 601, .away_until = 701, .ready_from = 0});
  /// Homes for some ticks after it comes back.
  class Homing final : public Device {
   public:
    Homing(Device& inner, int ticks) : inner_(inner), left_(ticks) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      const Status status = inner_.exchange(wrench, dt, state);
      was_away_ = was_away_ || status == Status::away;
      if (status == Status::ok && was_away_ && left_-- > 0) {
        state.ready = false;
        state.position = nan3();  // no position before it is homed
      }
      return status;
    }
    void close() noexcept override {}

   private:
    Device& inner_;
    int left_;
    bool was_away_ = false;
  } homing(device, 150);
  Resuming controller(1500);
  const Outcome result = run(homing, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_NEAR(result.report.away, 0.25 + 1e-9 * static_cast<double>(RestWatch::kRestNs), 1e-9) << "until it rests";
  for (std::size_t k = 601; k < 1051; ++k) EXPECT_EQ(device.forces()[k], Vec3::Zero());

  PointMass again(0.5, 20, {.away_from = 601, .away_until = 701});
  Homing never(again, 1 << 20);
  Resuming other(1500);
  const Outcome lost = run(never, other, kPatient);
  EXPECT_EQ(lost.report.cause, StopCause::device_lost);
  EXPECT_THAT(lost.report.detail, HasSubstr("it answers again, but does not allow forces"));
}

TEST(ServoLoop, EndsAtOnceWhenAskedToWhileTheDeviceIsAway) {
  StopRequest stop;
  PointMass device(0.5, 20, {.away_from = 601});
  /// Raises the stop request when the device is lost.
  struct Raiser final : SampleSink {
    explicit Raiser(StopRequest& request) : request_(request) {}
    void push(const Sample&) noexcept override {}
    void push(const Event& event) noexcept override {
      if (event.code == EventCode::device_lost) request_.raise();
      last_ = event;
    }
    StopRequest& request_;
    Event last_;
  } raiser(stop);
  SampleSink* const sinks[] = {&raiser};
  Resuming controller(1500);
  const auto estimator = make_velocity_estimator("difference", 1000, 0);
  const ServoReport report = ServoLoop(device, controller, *estimator, sinks, kPatient).run(stop);
  EXPECT_EQ(report.cause, StopCause::interrupted);
  EXPECT_EQ(report.samples, 600U);
  EXPECT_EQ(raiser.last_.code, EventCode::interrupted);
  EXPECT_LE(raiser.last_.time_ns, 601'000'000);
}

TEST(ServoLoop, EndsWhenADeviceIsLostWhileItsForceFadesOut) {
  PointMass device(0.5, 20, {.away_from = 601, .away_until = 700});
  Resuming controller(500);
  const Outcome result = run(device, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_EQ(result.log.samples.size(), 600U);
}

TEST(ServoLoop, WaitsForADeviceThatIsAwayBeforeTheFirstTick) {
  for (const std::uint64_t from : {0U, 1U}) {  // during the wait for the device to be ready, and at the first tick
    PointMass device(0.5, 20, {.away_from = from, .away_until = 300});
    Resuming controller(500);
    const Outcome result = run(device, controller, kPatient);
    EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
    EXPECT_EQ(controller.starts, 1);
    EXPECT_EQ(controller.resumes, 0);
    EXPECT_EQ(result.log.samples.front().time_ns, 0);
    EXPECT_EQ(result.report.away, 0);
    PointMass never(0.5, 20, {.away_from = from});
    EXPECT_EQ(run(never, controller, kPatient).report.cause, StopCause::device_lost);
  }
}

TEST(ServoLoop, AllocatesNothingWhileTheDeviceIsAwayAndWhenItComesBack) {
  struct Counting final : SampleSink {
    void push(const Sample&) noexcept override {}
    void push(const Event& event) noexcept override {
      if (event.code == EventCode::device_lost) before = test::allocations();
    }
    std::size_t before = 0;
  } counting;
  std::size_t after = 0;
  Scripted controller([&](const State& state) {
    if (state.tick == 900) after = test::allocations();
    return pushing(state.tick > 900 ? Command::Status::finished : Command::Status::working);
  });
  PointMass device(0.5, 20, kGap);
  SampleSink* const sinks[] = {&counting};
  const auto estimator = make_velocity_estimator("lowpass:100", 1000, 0);
  const ServoReport report = ServoLoop(device, controller, *estimator, sinks, kPatient).run(StopRequest{});
  EXPECT_EQ(report.cause, StopCause::finished);
  EXPECT_EQ(report.returns, 1U);
  EXPECT_EQ(after, counting.before);
}

// ------------------------------------------------------------------------------------------------------ stale states

/// Glides at a constant velocity for any force. It takes a new sample at the exchanges that `is_taken` selects, and
/// repeats the last sample at all others.
class Gliding final : public Device {
 public:
  explicit Gliding(std::function<bool(std::uint64_t)> is_taken) : is_taken_(std::move(is_taken)) {
    info_.virtual_time = true;
    info_.workspace_min = Vec3::Constant(-0.2);
    info_.workspace_max = Vec3::Constant(0.2);
    info_.max_force = 10;
    forces.reserve(1 << 16);
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    if (forces.size() < forces.capacity()) forces.push_back(wrench.force);
    time_ += dt;
    if (is_taken_(calls_++)) {
      taken_ = time_ - late;
      ++sequence_;
    }
    state.position = taken_ * velocity;
    state.age = states_age ? time_ - taken_ : 0;
    state.sequence = sequence_;
    return Status::ok;
  }
  void close() noexcept override {}

  Vec3 velocity{0.02, 0, 0};  ///< [m/s]
  double late = 0;            ///< age of a new sample [s]
  bool states_age = true;
  std::vector<Vec3> forces;

 private:
  DeviceInfo info_;
  std::function<bool(std::uint64_t)> is_taken_;
  double time_ = 0, taken_ = 0;
  std::uint64_t calls_ = 0, sequence_ = 0;
};

TEST(ServoLoop, DoesNotStoreARepeatedStateAsASample) {
  Gliding device([](std::uint64_t call) { return call % 16 == 0; });
  Resuming controller(1600);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  EXPECT_NEAR(result.report.achieved_rate(), 62.5, 1);
  EXPECT_NEAR(result.report.exchange_rate(), 1000, 10);
  EXPECT_TRUE(result.report.lacks_states());
  EXPECT_EQ(result.report.gaps, 0U);
  EXPECT_EQ(result.log.samples.size(), result.report.samples);
  for (std::size_t i = 2; i < result.log.samples.size(); ++i) {
    const Sample &row = result.log.samples[i], &before = result.log.samples[i - 1];
    EXPECT_EQ(row.tick - before.tick, 16U);
    EXPECT_NEAR(row.velocity.x(), 0.02, 1e-9) << "over the time between the samples";
    EXPECT_NEAR(controller.states[i].dt, 0.016, 1e-12);
  }
  // Between two samples, the loop holds the last force.
  for (std::size_t k = 801; k < 816; ++k) EXPECT_EQ(device.forces[k].x(), 2);
}

TEST(ServoLoop, EstimatesTheVelocityOverTheSamplesOwnTimes) {
  // Every fourth sample is 0.5 ms old when it arrives.
  std::uint64_t call = 0;
  Gliding device([&](std::uint64_t now) {
    call = now;
    return true;
  });
  struct Late final : Device {
    Late(Gliding& inner, std::uint64_t& call) : inner_(inner), call_(call) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      inner_.late = (call_ + 1) % 4 == 0 ? 0.5e-3 : 0;
      return inner_.exchange(wrench, dt, state);
    }
    void close() noexcept override {}
    Gliding& inner_;
    std::uint64_t& call_;
  } late(device, call);
  Resuming controller(400);
  const Outcome result = run(late, controller, kVirtual);
  ASSERT_EQ(result.report.cause, StopCause::finished);
  EXPECT_EQ(result.report.stale, 0U);
  for (std::size_t i = 2; i < result.log.samples.size(); ++i)
    EXPECT_NEAR(result.log.samples[i].velocity.x(), 0.02, 1e-6) << i;
}

TEST(ServoLoop, EstimatesNoSpeedFromASilenceAndFadesItsForce) {
  Gliding device([](std::uint64_t call) { return call < 601 || call >= 691; });
  device.velocity.x() = 0.1;
  Resuming controller(1500);
  ServoOptions options = kVirtual;
  options.limits = {.max_velocity = 0.2, .soft_start = 0.1};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  const auto& rows = result.log.samples;
  ASSERT_EQ(rows[599].tick, 599U);
  ASSERT_EQ(rows[600].tick, 690U) << "no sample is invented";
  EXPECT_EQ(device.forces[620].x(), 2) << "held for 20 ms";
  EXPECT_EQ(device.forces[635], Vec3::Zero()) << "faded over 10 ms";
  EXPECT_EQ(device.forces[691], Vec3::Zero());
  EXPECT_EQ(rows[600].velocity, Vec3::Zero()) << "estimated anew";
  for (std::size_t i = 601; i < 700; ++i) EXPECT_LE(rows[i].force.x() - rows[i - 1].force.x(), 2 / 100.0 + 1e-12);
  EXPECT_NEAR(rows[701].force.x(), 2, 1e-9);
  EXPECT_EQ(controller.resumes, 1);
  EXPECT_EQ(result.report.gaps, 1U);
  EXPECT_NEAR(result.report.away, 0.091, 1e-9);
  EXPECT_TRUE(result.log.has(EventCode::states_stopped));
  EXPECT_TRUE(result.log.has(EventCode::states_resumed));
  EXPECT_FALSE(result.report.lacks_states());
}

/// Returns a device with a sample every 21 ms. Each sample follows a gap, so the force never fades in fully.
Gliding sparse_device() {
  return Gliding([](std::uint64_t call) { return call % 21 == 0; });
}

TEST(ServoLoop, EndsWhenSamplesComeTooSeldomForAForce) {
  Gliding device = sparse_device();
  Resuming controller(20000);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_THAT(result.report.detail, HasSubstr("its samples come 21 ms apart; a force needs one every 20 ms"));
  EXPECT_NEAR(result.report.duration, 1, 0.1);
  EXPECT_EQ(device.forces.back(), Vec3::Zero());
}

TEST(ServoLoop, RecordsSparseSamplesWithoutAForceToTheEnd) {
  Gliding device = sparse_device();
  Scripted controller = push_until(5000, Vec3::Zero());
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_GT(result.report.gaps, 200U);
}

TEST(ServoLoop, PlaysOnThroughSingleGapsHoweverManyThereAre) {
  // Five gaps of 30 ms per second, for 10 s.
  Gliding device([](std::uint64_t call) { return call % 200 >= 30; });
  Resuming controller(10000);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_GT(result.report.gaps, 40U);
}

TEST(ServoLoop, EndsOrWaitsWhenADeviceStaysSilent) {
  for (const double patience : {0.0, 1.0}) {
    Gliding device([](std::uint64_t call) { return call < 601; });
    Resuming controller(5000);
    ServoOptions options = kVirtual;
    options.away_timeout = patience;
    const Outcome result = run(device, controller, options);
    EXPECT_EQ(result.report.cause, StopCause::device_lost);
    EXPECT_EQ(result.log.samples.size(), 600U);
    EXPECT_EQ(device.forces.back(), Vec3::Zero());
    EXPECT_NEAR(1e-9 * static_cast<double>(result.log.events.back().time_ns), 0.6 + ServoLoop::kSilence + patience,
                0.01);
  }
}

TEST(ServoLoop, EndsSoonWhenAskedToWhileStatesAreStale) {
  for (const int raised : {1, 2}) {
    StopRequest stop;
    Gliding device([&](std::uint64_t call) {
      if (call == 605)
        for (int k = 0; k < raised; ++k) stop.raise();
      return call < 601;
    });
    Resuming controller(5000);
    const Outcome result = run(device, controller, kVirtual, stop);
    EXPECT_EQ(result.report.cause, StopCause::interrupted);
    EXPECT_EQ(device.forces.back(), Vec3::Zero());
    EXPECT_LE(device.forces.size(), raised > 1 ? 608U : 640U);
  }
}

/// Stands still for 1 s at a tick, like a stopped process.
class Stalling final : public ServoClock {
 public:
  explicit Stalling(std::int64_t at_ns) : at_ns_(at_ns) {}
  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override {
    now_ = std::max(now_, time_ns);
    if (now_ < at_ns_ || stalled_) return;
    stalled_ = true;
    now_ += 1'000'000'000;
  }

 private:
  std::int64_t at_ns_, now_ = 0;
  bool stalled_ = false;
};

TEST(ServoLoop, RestartsAfterATimeWithoutTicks) {
  Gliding device([](std::uint64_t) { return true; });
  device.velocity.x() = 0.025;  // 25 mm during the stop
  Stalling clock(600'000'000);
  Resuming controller(2500);
  ServoOptions options = kVirtual;
  options.clock = &clock;
  options.limits = {.max_velocity = 0.05, .soft_start = 0.1};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_EQ(device.forces[600].x(), 2);
  EXPECT_EQ(device.forces[601], Vec3::Zero()) << "no force from before";
  for (std::size_t k = 602; k < 700; ++k)
    EXPECT_LE(device.forces[k].x() - device.forces[k - 1].x(), 2 / 100.0 + 1e-12) << k;
  EXPECT_EQ(controller.resumes, 1);
  EXPECT_EQ(controller.resumed_at.force_applied, Vec3::Zero());
  EXPECT_EQ(result.report.gaps, 1U);
  EXPECT_TRUE(result.log.has(EventCode::force_held)) << "by the motors, for a second";
}

/// A gliding handle; one of its exchanges takes long. It takes its samples at the start or at the end of an exchange
/// and does not report which.
class Blocking final : public Device, public ServoClock {
 public:
  Blocking(std::int64_t takes_ns, bool takes_at_end) : takes_ns_(takes_ns), at_end_(takes_at_end) {
    info_.virtual_time = true;
    info_.workspace_min = Vec3::Constant(-0.2);
    info_.workspace_max = Vec3::Constant(0.2);
    info_.max_force = 10;
    forces.reserve(1 << 12);
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double, DeviceState& state) noexcept override {
    if (forces.size() < forces.capacity()) forces.push_back(wrench.force);
    const std::int64_t began_ns = now_;
    if (forces.size() == kBlockedCall) now_ += takes_ns_;
    state.position = 1e-9 * static_cast<double>(at_end_ ? now_ : began_ns) * velocity;
    return Status::ok;
  }
  void close() noexcept override {}
  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override { now_ = std::max(now_, time_ns); }

  static constexpr std::size_t kBlockedCall = 300;
  Vec3 velocity{0.14, 0, 0};  ///< [m/s]
  std::vector<Vec3> forces;

 private:
  std::int64_t takes_ns_, now_ = 0;
  bool at_end_;
  DeviceInfo info_;
};

Event first_of(const Log& log, EventCode code) {
  for (const Event& event : log.events)
    if (event.code == code) return event;
  ADD_FAILURE() << "no event " << static_cast<int>(code);
  return {};
}

TEST(ServoLoop, EstimatesNoFalseSpeedFromALongExchange) {
  for (const bool at_end : {true, false})
    for (const std::int64_t takes_ns : {3'000'000, 10'000'000, 18'000'000}) {
      SCOPED_TRACE(testing::Message() << takes_ns << at_end);
      Blocking device(takes_ns, at_end);
      Resuming controller(600);
      ServoOptions options = kVirtual;
      options.clock = &device;
      const Outcome result = run(device, controller, options);
      ASSERT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
      EXPECT_EQ(controller.resumes, 0);
      for (std::size_t i = 100; i < result.log.samples.size(); ++i)
        ASSERT_NEAR(result.log.samples[i].velocity.x(), 0.14, 0.03) << i;
      EXPECT_THAT(describe(first_of(result.log, EventCode::overrun)), HasSubstr("the exchange with the device took"));
    }
}

TEST(ServoLoop, RestartsAfterATooLongExchangeAndReportsTheForceThatTheMotorsKept) {
  Blocking device(100'000'000, true);
  Resuming controller(1000);
  ServoOptions options = kVirtual;
  options.clock = &device;
  options.limits = {.max_velocity = 0.3, .soft_start = 0.1};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_EQ(controller.resumes, 1);
  EXPECT_EQ(result.report.gaps, 1U);
  const auto& rows = result.log.samples;
  for (std::size_t i = 1; i < rows.size(); ++i)
    EXPECT_NEAR(rows[i].position.x(), 1e-9 * static_cast<double>(rows[i].time_ns) * 0.14, 1e-4) << i;
  EXPECT_LT(device.forces[Blocking::kBlockedCall].norm(), 0.1) << "it fades in";
  const Event held = first_of(result.log, EventCode::force_held);
  EXPECT_NEAR(held.values[0], 0.1, 1e-6);
  EXPECT_NEAR(held.values[1], 2, 0.1);
}

TEST(ServoLoop, KeepsTheZeroForceThatATimeWithoutTicksEndsAFadeWith) {
  Gliding device([](std::uint64_t) { return true; });
  Stalling clock(600'000'000);
  Resuming controller(500);
  ServoOptions options = kVirtual;
  options.clock = &clock;
  options.limits = {.release = 1};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  const auto& rows = result.log.samples;
  ASSERT_EQ(rows.size(), 601U);
  EXPECT_GT(rows[599].force.norm(), 1);
  EXPECT_EQ(rows.back().force, Vec3::Zero());
  EXPECT_EQ(rows.back().phase, Phase::release);
  EXPECT_EQ(result.report.gaps, 1U);
}

TEST(ServoLoop, DoesNotLoseADeviceWhoseNewestStateIsFromBeforeATimeWithoutTicks) {
  // Simulates a driver's thread that stopped with the process.
  Gliding device([](std::uint64_t call) { return call < 601 || call >= 604; });
  Stalling clock(600'000'000);
  Resuming controller(2500);
  ServoOptions options = kVirtual;
  options.clock = &clock;
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_EQ(result.report.gaps, 1U);
  EXPECT_EQ(result.report.stale, 3U);
  EXPECT_EQ(controller.resumes, 1);
}

TEST(ServoLoop, StaysLostWithTheDeviceThatRepeatsItsState) {
  // A device that comes back but repeats the same sample has not returned.
  Gliding device([](std::uint64_t call) { return call < 601 || call >= 1300; });
  Resuming controller(2500);
  ServoOptions options = kVirtual;
  options.away_timeout = 2;
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished) << result.report.detail;
  EXPECT_EQ(result.report.returns, 1U);
  EXPECT_EQ(controller.resumes, 1);
  ASSERT_GT(result.log.samples.size(), 601U);
  EXPECT_EQ(result.log.samples[600].tick, 1299U);
}

TEST(ServoLoop, LeavesNoForceToAReleaseThatATimeWithoutTicksInterrupted) {
  PointMass device(0.5, 20);
  Stalling clock(600'000'000);
  Resuming controller(550);
  ServoOptions options = kVirtual;
  options.clock = &clock;
  options.limits = {.release = 0.25};
  const Outcome result = run(device, controller, options);
  EXPECT_EQ(result.report.cause, StopCause::finished);
  EXPECT_GT(device.forces()[600].x(), 1);
  for (std::size_t k = 601; k < device.forces().size(); ++k) EXPECT_EQ(device.forces()[k], Vec3::Zero()) << k;
}

TEST(ServoLoop, EstimatesNoFalseSpeedFromUnevenSamples) {
  // The samples are 1 ms apart at 0.02 m/s, but every second one reports an age of 0.9 ms.
  Gliding device([](std::uint64_t) { return true; });
  struct Uneven final : Device {
    explicit Uneven(Gliding& inner) : inner_(inner) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      const Status status = inner_.exchange(wrench, dt, state);
      state.age = ++calls_ % 2 == 0 ? 0.9e-3 : 0;
      return status;
    }
    void close() noexcept override {}
    Gliding& inner_;
    int calls_ = 0;
  } uneven(device);
  Resuming controller(400);
  const Outcome result = run(uneven, controller, kVirtual);
  ASSERT_EQ(result.report.cause, StopCause::finished);
  double mean = 0;
  for (std::size_t i = 2; i < 400; ++i) {
    EXPECT_LE(result.log.samples[i].velocity.x(), 2 * 0.02 * (1 + 1e-9)) << "not ten times as much";
    mean += result.log.samples[i].velocity.x() / 398;
  }
  EXPECT_NEAR(mean, 0.02, 0.01);
}

TEST(ServoLoop, LosesADeviceWhoseFirstStateIsOldAndStaysSo) {
  Gliding device([](std::uint64_t call) { return call == 0; });
  device.late = 5;
  Resuming controller(5000);
  const Outcome result = run(device, controller, kVirtual);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_THAT(result.report.detail, HasSubstr("it answers, but measures no new sample"));
  EXPECT_EQ(result.report.samples, 0U);
  EXPECT_TRUE(controller.states.empty());
}

TEST(ServoLoop, DoesNotAskTheControllerAboutAStateThatStopsTheSession) {
  struct Stop {
    PointMass::Faults faults;
    EventCode code;
  };
  for (const Stop& stop :
       {Stop{{.jump_at = 601}, EventCode::velocity_limit}, Stop{{.nan_at = 601}, EventCode::not_finite},
        Stop{{.ready_until = 601}, EventCode::device_not_ready}}) {
    PointMass device(0.5, 20, stop.faults);
    Resuming controller(1500);
    ServoOptions options = kVirtual;
    options.limits = {.max_velocity = 5};
    const Outcome result = run(device, controller, options);
    EXPECT_TRUE(result.report.stopped_by_fault());
    EXPECT_EQ(controller.states.size(), 600U) << static_cast<int>(stop.code);
    EXPECT_EQ(result.log.events.size(), 2U) << "started, and why it stopped";
    EXPECT_EQ(result.log.events.back().code, stop.code);
  }
}

TEST(ServoLoop, ReportsItsFirstReasonToStopOnceEvenIfOthersFollow) {
  // While the force fades after a deviation, the position jumps, is NaN, or the device is no longer ready.
  for (const PointMass::Faults& faults :
       {PointMass::Faults{.jump_at = 511}, PointMass::Faults{.nan_at = 511}, PointMass::Faults{.ready_until = 511}}) {
    PointMass device(0.5, 20, faults);
    Scripted controller([](const State& state) {
      Command command = pushing(state.tick < 500 ? Command::Status::working : Command::Status::deviation);
      if (state.tick >= 500) command.event = Event{.code = EventCode::deviation_limit, .values = {0.05, 0.03, kNaN}};
      return command;
    });
    ServoOptions options = kVirtual;
    options.limits = {.max_velocity = 5};
    const Outcome result = run(device, controller, options);
    EXPECT_EQ(result.report.cause, StopCause::deviation) << to_string(result.report.cause);
    EXPECT_EQ(result.log.events.size(), 2U);
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
    EXPECT_LT(device.forces().size(), 520U) << "cut to zero at once";
  }
  StopRequest stop;
  PointMass device(0.5, 20);
  Scripted controller([&](const State& state) {
    if (state.tick == 500 || state.tick == 510) stop.raise();
    return pushing();
  });
  const Outcome result = run(device, controller, kVirtual, stop);
  EXPECT_EQ(result.report.cause, StopCause::interrupted);
  EXPECT_EQ(result.log.events.size(), 2U) << "the second request adds no second event";
}

TEST(ServoLoop, RefusesAPositionThatNoHandCanReach) {
  for (const double leap : {-2e6, 12.0, 1e300}) {
    struct Leaping final : Device {
      Leaping(Device& inner, double leap) : inner_(inner), leap_(leap) {}
      [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner_.info(); }
      Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
        const Status status = inner_.exchange(wrench, dt, state);
        if (calls_++ > 600) state.position.x() = leap_;
        return status;
      }
      void close() noexcept override {}
      Device& inner_;
      double leap_;
      int calls_ = 0;
    };
    PointMass device(0.5, 20);
    Leaping leaping(device, leap);
    Resuming controller(1500);
    const Outcome result = run(leaping, controller, kVirtual);
    EXPECT_EQ(result.report.cause, StopCause::outside_workspace) << leap;
    EXPECT_THAT(result.report.detail, HasSubstr("from the centre of its workspace"));
    EXPECT_EQ(result.log.samples.size(), 600U);
    EXPECT_EQ(controller.states.size(), 600U) << "the controller never sees it";
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
  }
}

TEST(ServoLoop, CallsNoControllerAfterALimitTripsAndReportsTheStopOnce) {
  using Status = Command::Status;
  for (const auto& [status, code] : {std::pair{Status::deviation, EventCode::deviation_limit},
                                     {Status::oscillation, EventCode::oscillation_stays},
                                     {Status::no_path, EventCode::path_unreadable}}) {
    PointMass device(0.5, 20);
    int asked_after = 0;
    bool stopped = false;
    Scripted controller([&](const State& state) {
      Command command;
      command.wrench.force = Vec3(2, 0, 0);
      if (stopped) ++asked_after;
      if (state.tick < 500) return command;
      stopped = true;
      command.status = status;
      command.event = Event{.code = code, .values = {0.1, 0.05, 0.05}};
      return command;
    });
    const Outcome result = run(device, controller, kVirtual);
    EXPECT_TRUE(result.report.stopped_by_fault());
    EXPECT_EQ(asked_after, 0);
    EXPECT_EQ(std::count_if(result.log.events.begin(), result.log.events.end(),
                            [&](const Event& event) { return event.code == code; }),
              1);
    EXPECT_GT(result.log.samples.size(), 540U) << "the force faded over 50 ms";
    EXPECT_EQ(result.log.samples.back().phase, Phase::stopped);
  }
}

TEST(ServoLoop, AllocatesNothingWhileStatesAreStale) {
  std::size_t before = 0, after = 0;
  Gliding device([&](std::uint64_t call) {
    if (call == 600) before = test::allocations();
    if (call == 750) after = test::allocations();
    return call < 601 || call >= 691;
  });
  struct Counting final : SampleSink {
    using SampleSink::push;
    void push(const Sample&) noexcept override {}
  } counting;
  Scripted controller([](const State& state) {
    return pushing(state.tick > 900 ? Command::Status::finished : Command::Status::working);
  });
  SampleSink* const sinks[] = {&counting};
  const auto estimator = make_velocity_estimator("lowpass:100", 1000, 0);
  EXPECT_EQ(ServoLoop(device, controller, *estimator, sinks, kVirtual).run(StopRequest{}).cause, StopCause::finished);
  EXPECT_GT(before, 0U);
  EXPECT_EQ(after, before);
}

TEST(ServoLoop, RejectsAnInvalidPatience) {
  PointMass device;
  Scripted controller = push_until(0, Vec3::Zero());
  for (const double patience : {-1.0, kNaN, 1e6})
    EXPECT_THROW(run(device, controller, {.virtual_time = true, .away_timeout = patience}), Error);
}

}  // namespace
}  // namespace haptrace
