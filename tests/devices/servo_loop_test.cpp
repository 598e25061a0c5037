#include "devices/servo_loop.h"

#include "control/error.h"
#include "control/pd.h"
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

/// A constant force until a tick, then finished.
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

Outcome run(Device& device, Controller& controller, ServoLoop::Options options, const StopRequest& stop = {}) {
  Outcome result;
  SampleSink* const sinks[] = {&result.log};
  const auto estimator = make_velocity_estimator("difference", 1000, 0);
  result.report = ServoLoop(device, controller, *estimator, sinks, options).run(stop);
  return result;
}

constexpr ServoLoop::Options kVirtual{.virtual_time = true};

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

TEST(ServoLoop, RefusesVirtualTimeForADeviceThatLivesInRealTime) {
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

TEST(ServoLoop, NeverSendsMoreThanTheDeviceBearsWhateverIsAsked) {
  PointMass device(1000);
  Scripted controller = push_until(500, Vec3(1e6, 0, 0));
  const Outcome result = run(device, controller, {.virtual_time = true, .limits = {.max_force = 50}});
  for (const Vec3& force : device.forces()) EXPECT_LE(force.norm(), 10 * (1 + 1e-12));
  EXPECT_NEAR(result.report.max_force, 10, 1e-9);
  EXPECT_TRUE(result.log.has(EventCode::force_limit));
}

TEST(ServoLoop, TellsOfALimitOnceASecondNotEveryTick) {
  PointMass device(1000);
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

// Every way out of a session, and what must hold after each.
struct WayOut {
  const char* name;
  StopCause cause;
  const char* detail;
  PointMass::Faults faults{};
  std::function<Command(const State&, StopRequest&)> script{};
  bool fault = true;
};

class EveryWayOut : public testing::TestWithParam<WayOut> {};

TEST_P(EveryWayOut, EndsWithZeroForceAndSaysWhy) {
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
                           .detail = "does not allow forces any more: its lid is open",
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

/// A controller whose force alternates whatever it is told, for two seconds.
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

TEST(ServoLoop, SoftensAForceThatVibratesInEverySessionAndSaysSo) {
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

TEST(ServoLoop, EndsASessionWhoseForceGoesOnVibrating) {
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
  Scripted controller([](const State& state) {
    if (state.tick == 50) {
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
    // Each tick woke at or after its own deadline, and deadlines stay on the grid: ticks are never bunched.
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

// ------------------------------------------------------------------------------------------------- a device that is
// away

/// Pushes until a tick, and keeps what it was told of gaps.
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

constexpr ServoLoop::Options kPatient{.virtual_time = true, .away_timeout = 1};
const PointMass::Faults kGap{.away_from = 601, .away_until = 801, .moved_while_away = Vec3(0.05, 0, 0)};

TEST(ServoLoop, LeavesAGapInRowsButNotInTimeWhileTheDeviceIsAway) {
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
  ServoLoop::Options options = kPatient;
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

TEST(ServoLoop, DoesNotCreditMotorsThatNobodySawWithHavingCooled) {
  PointMass device(1000, 0, {.away_from = 4001, .away_until = 9001});
  Resuming controller(11000);
  ServoLoop::Options options{.virtual_time = true, .away_timeout = 10};
  options.limits = {.max_continuous_force = 1, .continuous_time = 2};
  const Outcome result = run(device, controller, options);
  const auto& rows = result.log.samples;
  ASSERT_LT(rows[3999].force.x(), 1.2) << "limited when it is lost";
  ASSERT_EQ(rows[4000].tick, 9000U);
  // Cool motors would bear 2 N for 0.35 s and more; these have cooled no more than while the force faded in.
  const auto strong =
      std::count_if(rows.begin() + 4000, rows.begin() + 5000, [](const Sample& row) { return row.force.x() > 1.9; });
  EXPECT_LT(strong, 150);
}

TEST(ServoLoop, EndsWhenADeviceDoesNotComeBackInTimeAndSaysHowLongItWaited) {
  PointMass device(0.5, 20, {.away_from = 601});
  Resuming controller(5000);
  const Outcome result = run(device, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_THAT(result.report.detail, testing::AllOf(HasSubstr("the device was lost: the device stopped answering"),
                                                   HasSubstr("it was waited for 1 s")));
  EXPECT_EQ(result.log.samples.size(), 600U);
  ASSERT_FALSE(result.report.flight_record.empty());
  EXPECT_EQ(result.log.events.back().code, EventCode::device_lost);
  EXPECT_EQ(result.log.events.back().time_ns, 1'600'000'000);
  EXPECT_EQ(describe(result.log.events.back()), "the device did not come back within 1 s");
}

TEST(ServoLoop, DoesNotWaitForADeviceUnlessItIsToldTo) {
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

TEST(ServoLoop, TakesADeviceThatIsFoundButNotReadyForAway) {
  PointMass device(0.5, 20, {.away_from = 601, .away_until = 701, .ready_from = 0});
  /// Homes for a while after it is found.
  class Homing final : public Device {
   public:
    Homing(Device& inner, int ticks) : inner_(inner), left_(ticks) {}
    [[nodiscard]] const DeviceInfo& info() const noexcept override { return inner_.info(); }
    Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
      const Status status = inner_.exchange(wrench, dt, state);
      was_away_ = was_away_ || status == Status::away;
      if (status == Status::ok && was_away_ && left_-- > 0) {
        state.ready = false;
        state.position = nan3();  // nor is there one before it is homed
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
  EXPECT_NEAR(result.report.away, 0.25, 1e-9);
  for (std::size_t k = 601; k < 751; ++k) EXPECT_EQ(device.forces()[k], Vec3::Zero());

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
  /// Raises the request when it is told that the device was lost.
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

TEST(ServoLoop, HasNothingToGoOnWithWhenADeviceIsLostWhileItsForceFadesOut) {
  PointMass device(0.5, 20, {.away_from = 601, .away_until = 700});
  Resuming controller(500);
  const Outcome result = run(device, controller, kPatient);
  EXPECT_EQ(result.report.cause, StopCause::device_lost);
  EXPECT_EQ(result.log.samples.size(), 600U);
}

TEST(ServoLoop, WaitsForADeviceThatIsAwayBeforeTheFirstTick) {
  for (const std::uint64_t from : {0U, 1U}) {  // while it waits for the device to be ready, and at the first tick
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

TEST(ServoLoop, RefusesAPatienceThatIsNone) {
  PointMass device;
  Scripted controller = push_until(0, Vec3::Zero());
  for (const double patience : {-1.0, kNaN, 1e6})
    EXPECT_THROW(run(device, controller, {.virtual_time = true, .away_timeout = patience}), Error);
}

}  // namespace
}  // namespace haptrace
