// Tests of NaN and infinity at every boundary: zero force, a latched fault, and no filter that retains them.
#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/hand_watch.h"
#include "control/observer_pd.h"
#include "control/oscillation_monitor.h"
#include "control/path/place_tracker.h"
#include "control/pd.h"
#include "control/ripple.h"
#include "control/tunnel_wall.h"
#include "devices/plugin/plugin_device.h"
#include "player/guidance/guidance_controller.h"
#include "recorder/recorder.h"
#include "tests/extremes/support.h"
#include "tests/support/temp_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <memory>

namespace haptrace {
namespace {

using test::error_of, test::kInfinity, test::Log, test::Watched;
using testing::HasSubstr;

const std::initializer_list<double> kBad{kNaN, kInfinity, -kInfinity};

Vec3 with(double bad, int axis, Vec3 v = Vec3(0.01, 0.02, 0.03)) {
  v[axis] = bad;
  return v;
}

Command spring(const State& state) {
  Command command;
  command.wrench.force = 200 * (Vec3(0.02, 0, 0) - state.position) - 5 * state.velocity;
  if (state.tick > 2000) command.status = Command::Status::finished;
  return command;
}

TEST(NotANumber, FromADeviceEndsTheSessionAtThatTick) {
  for (const double bad : kBad)
    for (int axis = 0; axis < 3; ++axis)
      for (const std::uint64_t when : {1U, 2U, 300U}) {  // exchange 0 only checks that the device is ready
        SCOPED_TRACE(fmt::format("{} in axis {} of exchange {}", bad, axis, when));
        test::PointMass mass;
        Watched device(mass, [&](std::uint64_t exchange, DeviceState& state) {
          if (exchange == when) state.position = with(bad, axis);
        });
        test::Scripted controller(spring);
        Log log;
        const ServoReport report = test::run(device, controller, log);
        EXPECT_EQ(report.cause, StopCause::not_finite);
        EXPECT_TRUE(log.has(EventCode::not_finite));
        EXPECT_EQ(log.samples.size(), when - 1) << "no row is invented";
        EXPECT_EQ(device.count(), when + 2) << "it is told zero once, and not asked again";
        for (const Sample& row : report.flight_record) EXPECT_TRUE(is_finite(row.position));
      }
}

TEST(NotANumber, FromAControllerEndsTheSessionAtThatTick) {
  for (const double bad : kBad)
    for (const bool torque : {false, true}) {
      test::PointMass mass;
      Watched device(mass);
      test::Scripted controller([&](const State& state) {
        Command command = spring(state);
        if (state.tick == 200) (torque ? command.wrench.torque : command.wrench.force) = with(bad, 1);
        return command;
      });
      Log log;
      EXPECT_EQ(test::run(device, controller, log).cause, StopCause::not_finite);
      ASSERT_EQ(log.samples.size(), 201U);
      EXPECT_EQ(log.samples.back().force, Vec3::Zero());
      EXPECT_EQ(log.samples.back().phase, Phase::stopped);
      EXPECT_GT(log.samples[199].force.norm(), 0) << "this test could not fail";
    }
}

TEST(NotANumber, InOtherMeasurementsOfADeviceChangesNoForce) {
  // The device's velocities, forces and orientations are not finite for some ticks, then valid again.
  const Path path = test::circle();
  std::vector<Sample> expected;
  for (const double bad : {0., kNaN, kInfinity, -kInfinity}) {
    SCOPED_TRACE(fmt::format("{}", bad));
    SimDevice sim(test::sim_spec(R"({"mass": 0.4, "max_force": 20, "force_sensor": true, "hand": "relaxed",
                                     "wrist": {"inertia": 1e-4, "viscous": 1e-3, "max_torque": 0.4}})"));
    Watched device(sim, [&](std::uint64_t exchange, DeviceState& state) {
      if (bad == 0 || exchange % 100 < 90) return;
      state.velocity = state.force = Vec3::Constant(bad);
      state.orientation = Quat(bad, bad, bad, bad);
    });
    PlaybackController controller(Trajectory(path, Interpolation::cubic), test::terms_of(std::make_unique<PdLaw>()),
                                  {.gains = {Vec3::Constant(1000), Vec3::Constant(10)}}, {});
    controller.turn({.gains = {.kp = 1, .kd = 0.01}});
    Log log;
    EXPECT_EQ(test::run(device, controller, log).cause, StopCause::finished);
    for (const Sample& row : log.samples) ASSERT_TRUE(is_finite(row.torque)) << row.tick;
    if (expected.empty()) expected = log.samples;
    ASSERT_EQ(log.samples.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_EQ(log.samples[i].force, expected[i].force) << i;
  }
}

TEST(NotANumber, InAWrenchOrAStepIsTreatedAsNoForceAndNoStepByADevice) {
  const auto open = [](bool plugin) -> std::unique_ptr<Device> {
    if (plugin) return std::make_unique<PluginDevice>(FAULTY_PLUGIN, "{}", "plug-in");
    return std::make_unique<SimDevice>(test::sim_spec(R"({"mass": 0.4, "max_force": 20, "hand": "relaxed"})"));
  };
  for (const bool plugin : {false, true})
    for (const double bad : kBad) {
      SCOPED_TRACE(fmt::format("{} to {}", bad, plugin ? "a plug-in" : "sim"));
      const auto one = open(plugin), other = open(plugin);
      for (int tick = 0; tick < 200; ++tick) {
        const Vec3 good(1, -1, 0.5);
        DeviceState a, b;
        const bool now = tick == 100;
        (void)one->exchange({now ? with(bad, tick % 3) : good, now ? with(bad, 0) : Vec3(0, 0, 0)}, 1e-3, a);
        (void)other->exchange({now ? Vec3(0, 0, 0) : good, Vec3::Zero()}, 1e-3, b);
        ASSERT_EQ(a.position, b.position) << "tick " << tick;
        ASSERT_TRUE(is_finite(a.position));
      }
    }
  // A step that is not finite, for a device in virtual time.
  SimDevice sim(test::sim_spec(R"({"mass": 0.4, "max_force": 20})"));
  DeviceState state;
  for (const double bad : kBad) EXPECT_EQ(sim.exchange({Vec3(1, 0, 0), Vec3::Zero()}, bad, state), Device::Status::ok);
  EXPECT_EQ(state.position, Vec3::Zero());
}

TEST(NotANumber, FromAPluginEndsTheSession) {
  PluginDevice plugin(FAULTY_PLUGIN, R"({"fault":"nan","tick":50})", "plug-in");
  Watched device(plugin);
  test::Scripted controller(spring);
  Log log;
  EXPECT_EQ(test::run(device, controller, log).cause, StopCause::not_finite);
  EXPECT_EQ(log.samples.size(), 50U);
}

TEST(NotANumber, InATuningEndsTheSession) {
  for (const double bad : kBad) {
    Mailbox<Tuning> changes;
    PlaybackController controller(Trajectory(test::circle(), Interpolation::cubic),
                                  test::terms_of(std::make_unique<PdLaw>()),
                                  {.gains = {Vec3::Constant(500), Vec3::Constant(5)}}, {}, &changes);
    SimDevice sim(test::sim_spec(R"({"mass": 0.4, "max_force": 20, "hand": "relaxed"})"));
    Watched device(sim, [&](std::uint64_t exchange, DeviceState&) {
      changes.post({.gains = {Vec3::Constant(exchange < 300 ? 500 : bad), Vec3::Constant(5)}});
    });
    Log log;
    EXPECT_EQ(test::run(device, controller, log).cause, StopCause::not_finite) << bad;
  }
}

/// Feeds bad numbers to `one`, restarts it, and expects the same output as from `fresh`, which received none.
template <class Filter, class Feed, class Begin>
void expect_forgotten(Filter one, Filter fresh, const Feed& feed, const Begin& begin) {
  Gaussian random(6, 6);
  begin(one);
  for (int i = 0; i < 100; ++i) (void)feed(one, i, random.vector(), 0.);
  for (const double bad : kBad) (void)feed(one, 1, Vec3(1, 2, 3), bad);
  begin(one);
  begin(fresh);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 x = 1e-2 * (i < 1000 ? random.vector() : Vec3::Zero());
    ASSERT_EQ(feed(one, i, x, 0.), feed(fresh, i, x, 0.)) << "tick " << i;
  }
}

/// Returns `x`, with `bad` in two axes unless `bad` is 0.
Vec3 or_bad(const Vec3& x, double bad) {
  return bad == 0 ? x : Vec3(bad, x.y(), bad);
}

TEST(NotANumber, IsForgottenByEveryFilterThatRestarts) {
  StateObserver::Options options{.mass = Vec3(0.4, 1, 0), .delay = 2.5e-3, .bandwidth_hz = 20};
  expect_forgotten(
      StateObserver(options), StateObserver(options),
      [](StateObserver& observer, int i, const Vec3& x, double bad) -> Vec3 {
        observer.update(or_bad(x, bad), i == 0 ? 0 : 1e-3, or_bad(x, bad), Vec3::Zero());
        return observer.ahead().load;
      },
      [](StateObserver& observer) { observer.start(Vec3::Zero()); });

  const auto law = [] {
    return ObserverPd({.design = {.mass = Vec3(0.4, 1, 0.1), .delay = 2e-3, .observer_hz = 20, .authority = 5},
                       .position_resolution = 5e-5});
  };
  expect_forgotten(
      law(), law(),
      [](ObserverPd& pd, int i, const Vec3& x, double bad) -> Vec3 {
        State state;
        state.dt = i == 0 ? 0 : 1e-3;
        state.position = or_bad(1e-3 * x, bad);
        state.force_applied = or_bad(x, bad);
        const Reference reference{Vec3(1e-5, 0, 0), Vec3::Zero(), Vec3::Zero(), 0};
        return pd.force({state, reference, {.gains = {Vec3::Constant(900), Vec3::Constant(9)}}, or_bad(x, bad)});
      },
      [](ObserverPd& pd) { pd.start({}); });

  expect_forgotten(
      HandWatch(HandWatchOptions{}), HandWatch(HandWatchOptions{}),
      [](HandWatch& hand, int, const Vec3& x, double bad) {
        return hand.update(or_bad(900 * x, bad), or_bad(x, bad), nan3(), 1e-3 * (bad == 0 ? 1 : bad)).has_value();
      },
      [](HandWatch& hand) { hand.reset(); });
}

TEST(NotANumber, IsNotRememberedByFiltersThatContinue) {
  Gaussian random(2, 2);
  for (const std::string& name : velocity_estimator_names()) {
    const auto one = make_velocity_estimator(name, 1000, 5e-5), fresh = make_velocity_estimator(name, 1000, 5e-5);
    for (int i = 0; i < 500; ++i) {
      const Vec3 x = random.vector();
      for (const double bad : kBad) {
        if (i % 50 != 7) continue;
        EXPECT_TRUE(is_finite(one->update(with(bad, i % 3, x), 1e-3))) << name;
      }
      ASSERT_EQ(one->update(x, 1e-3), fresh->update(x, 1e-3)) << name;
    }
  }
  for (const auto kind : {Butterworth2::Kind::low_pass, Butterworth2::Kind::high_pass}) {
    Butterworth2 one(kind, 20, 1000), fresh(kind, 20, 1000);
    for (int i = 0; i < 500; ++i) {
      for (const double bad : kBad) {
        if (i % 50 != 7) continue;
        EXPECT_TRUE(std::isfinite(one.update(bad)));
      }
      const double x = random();
      ASSERT_EQ(one.update(x), fresh.update(x));
    }
  }
  // A monitor restarts by itself and must then give the same output as a new one.
  OscillationMonitor one({.max_force = 10}), fresh({.max_force = 10});
  State state;
  const Reference still{Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), 0};
  int found = 0;
  for (int i = 0; i < 1500; ++i) {
    state.dt = 1e-3;
    const double phase = 2 * std::numbers::pi * 40 * 1e-3 * i;
    state.position = Vec3(3e-3 * std::sin(phase), 0, 0);
    state.force_applied = Vec3(5 * std::cos(phase), 0, 0);
    if (i < 500) {
      (void)one.update(state, still);
      continue;
    }
    if (i == 500)
      for (const double bad : kBad) {
        State poisoned = state;
        (i % 2 == 0 ? poisoned.position : poisoned.force_applied) = with(bad, 0);
        EXPECT_FALSE(one.update(poisoned, still));
      }
    const auto a = one.update(state, still), b = fresh.update(state, still);
    ASSERT_EQ(a.has_value(), b.has_value()) << i;
    if (a) {
      ASSERT_EQ(a->energy, b->energy);
      ++found;
    }
  }
  EXPECT_GT(found, 0) << "this test could not fail";
}

TEST(NotANumber, CausesNoGuidanceForceAndLeavesTheEnergyTankAlone) {
  ArcPath::Builder builder(1e-3);
  for (int i = 0; i <= 100; ++i) builder.add(0.01 * i, Vec3(1e-3 * i, 0, 0), Vec3(3, 0, 0));
  const ArcPath path = builder.finish(2e-3);
  for (const double bad : kBad) {
    GuideTerms terms;
    terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
    terms.push_back(std::make_unique<ExpertForce>(1));
    Guidance guidance(std::move(terms), {});
    PlaceTracker projection(path, {});
    projection.start();
    State state;
    for (int i = 0; i < 500; ++i) {
      const bool now = i == 200 || i == 201;
      state.dt = i == 0 ? 0 : 1e-3;
      state.position = now ? with(bad, i % 3) : Vec3(1e-4 * i, 3e-3, 0);
      state.velocity = now ? with(bad, 1) : Vec3(0.1, 0, 0);
      const double level = guidance.tank().level();
      const Vec3 force = guidance.update(state, projection.update(state.position, state.dt), false);
      ASSERT_TRUE(is_finite(force)) << "tick " << i;
      if (now) {
        EXPECT_EQ(force, Vec3::Zero());
        EXPECT_EQ(guidance.tank().level(), level);
      } else {
        EXPECT_GT(force.norm(), 0.1) << "tick " << i;
      }
      state.force_applied = force;
    }
    EXPECT_TRUE(std::isfinite(guidance.given()));
  }
}

TEST(NotANumber, NeverCorruptsARecording) {
  for (const bool rounded : {false, true}) {
    SCOPED_TRACE(rounded ? "rounded" : "plain");
    const test::TempFolder folder;
    const std::string file = folder / "a.h5";
    Storage storage;
    if (rounded)
      storage = {.deflate = 1, .precision = {.position = 1e-6, .velocity = 1e-3, .force = 1e-3}, .rows_per_chunk = 128};
    Recorder recorder(file, {}, {.orientation = true, .torque = true, .force_measured = true, .reference = true},
                      {.storage = storage});
    // Write a device's measurements, valid or not, directly to the file.
    Gaussian random(1, 9);
    std::vector<Sample> rows;
    for (std::int64_t i = 0; i < 1000; ++i) {
      Sample row;
      row.tick = static_cast<std::uint64_t>(i);
      row.time_ns = i * 1'000'000;
      row.position = 0.1 * random.vector();
      row.velocity = row.reference_position = row.reference_velocity = random.vector();
      row.orientation = Quat::Identity();
      row.torque = Vec3::Zero();
      row.force_measured = random.vector();
      if (i % 7 == 3) row.force_measured = with(kNaN, 1);
      if (i % 11 == 5) row.orientation = nan_quat();
      if (i % 13 == 1) row.reference_position = row.reference_velocity = nan3();
      rows.push_back(row);
      recorder.push(row);
      recorder.between_ticks(true);
    }
    recorder.push(Event{.time_ns = 5, .code = EventCode::not_finite, .values = {kNaN, kInfinity, -kInfinity}});
    recorder.finish();

    for (const Finding& finding : check_recording(file))
      EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
    const RecordingReader reader(file);
    const auto read = reader.read(0, reader.rows());
    ASSERT_EQ(read.size(), rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i)
      for (const auto column : {&Sample::position, &Sample::force_measured, &Sample::reference_position})
        for (int axis = 0; axis < 3; ++axis) {
          const double was = (rows[i].*column)[axis], is = (read[i].*column)[axis];
          ASSERT_EQ(std::isnan(is), std::isnan(was)) << "row " << i;
          ASSERT_TRUE(std::isnan(was) || std::abs(is - was) <= (rounded ? 1e-3 : 0)) << "row " << i;
        }
  }
  // A session that such a device ends leaves a complete recording of all earlier samples and all columns.
  const test::TempFolder folder;
  Recorder recorder(folder / "b.h5", {.clock = "virtual"}, {.orientation = true, .force_measured = true});
  test::PointMass mass;
  Watched device(mass, [](std::uint64_t exchange, DeviceState& state) {
    state.orientation = exchange % 5 == 0 ? Quat(kInfinity, 0, 0, kNaN) : Quat(Quat::Identity());
    state.force = with(*(kBad.begin() + exchange % 3), 2);
    if (exchange > 100) state.position = nan3();
  });
  test::Scripted controller(spring);
  const auto estimator = make_velocity_estimator("lowpass", 1000, 0);
  SampleSink* const sinks[] = {&recorder};
  ServoLoop loop(device, controller, *estimator, sinks, {.virtual_time = true});
  const StopRequest never;
  EXPECT_EQ(loop.run(never).cause, StopCause::not_finite);
  recorder.finish();
  EXPECT_TRUE(check_recording(folder / "b.h5").empty());
  EXPECT_EQ(RecordingReader(folder / "b.h5").rows(), 100U);
}

TEST(NotANumber, IsRefusedWhereverANumberIsGiven) {
  const DeviceInfo info = test::PointMass().info();
  const auto refused = [](const auto& call) { return error_of(call) != "no error"; };
  for (const double bad : kBad) {
    SCOPED_TRACE(fmt::format("{}", bad));
    EXPECT_TRUE(refused([&] { validate(PdGains{Vec3::Constant(bad), Vec3::Zero()}); }));
    for (const auto field :
         {&SafetyLimits::max_force, &SafetyLimits::max_continuous_force, &SafetyLimits::continuous_time,
          &SafetyLimits::max_torque, &SafetyLimits::max_velocity, &SafetyLimits::soft_start, &SafetyLimits::release}) {
      SafetyLimits limits;
      limits.*field = bad;
      EXPECT_TRUE(refused([&] { validate(limits); }));
    }
    for (const auto field : {&ServoOptions::rate_hz, &ServoOptions::ready_timeout, &ServoOptions::away_timeout}) {
      ServoOptions options{.virtual_time = true};
      options.*field = bad;
      EXPECT_TRUE(refused([&] { ServoLoop::validate(info, options); }));
    }
    for (const auto field : {&PlaybackOptions::speed, &PlaybackOptions::hold, &PlaybackOptions::approach_speed,
                             &PlaybackOptions::max_deviation}) {
      PlaybackOptions options;
      options.*field = bad;
      EXPECT_TRUE(refused([&] { validate(options); }));
    }
    for (const auto field :
         {&GuidanceOptions::speed, &GuidanceOptions::wait, &GuidanceOptions::hold, &GuidanceOptions::approach_speed,
          &GuidanceOptions::time_limit, &GuidanceOptions::max_deviation}) {
      GuidanceOptions options;
      options.*field = bad;
      EXPECT_TRUE(refused([&] { validate(options); }));
    }
    for (const auto field :
         {&OscillationMonitorOptions::rate_hz, &OscillationMonitorOptions::max_force, &OscillationMonitorOptions::delay,
          &OscillationMonitorOptions::position_resolution, &OscillationMonitorOptions::mass}) {
      OscillationMonitorOptions options{.max_force = 1};
      options.*field = bad;
      EXPECT_TRUE(refused([&] { validate(options); }));
    }
    for (const auto field : {&Guidance::Options::energy, &Guidance::Options::gate_width, &Guidance::Options::delay,
                             &Guidance::Options::rate_hz, &Guidance::Options::max_damping}) {
      Guidance::Options options;
      options.*field = bad;
      EXPECT_TRUE(refused([&] { Guidance({}, options); }));
    }
    for (const char* field : {"mass", "viscous", "delay_s", "position_resolution", "max_force"}) {
      nlohmann::json spec{{"mass", 0.4}, {"max_force", 8}};
      spec[field] = bad;
      EXPECT_TRUE(refused([&] { (void)read_sim_spec(spec, "test"); })) << field;
    }
    EXPECT_TRUE(refused([&] { (void)make_velocity_estimator("lowpass", bad, 0); }));
    EXPECT_TRUE(refused([&] { (void)make_velocity_estimator("lowpass", 1000, bad); }));
    EXPECT_TRUE(refused([&] { (void)make_velocity_estimator(fmt::format("lowpass:{}", bad), 1000, 0); }));
    EXPECT_TRUE(refused([&] { (void)design_tracking({.mass = Vec3(1, bad, 1), .delay = 1e-3}, {.max_force = 8}); }));
    EXPECT_TRUE(refused([&] { (void)design_tracking({.mass = Vec3::Ones(), .delay = bad}, {.max_force = 8}); }));
    Path path = test::circle();
    path.position[7].y() = bad;
    EXPECT_THAT(error_of([&] { Trajectory(path, Interpolation::cubic); }), HasSubstr("sample 8"));
    path = test::circle();
    path.time[7] = bad;
    EXPECT_THAT(error_of([&] { Trajectory(path, Interpolation::cubic); }), HasSubstr("sample 8"));
    EXPECT_TRUE(refused([&] { ArcPath::Builder{bad}; }));
  }
}

}  // namespace
}  // namespace haptrace
