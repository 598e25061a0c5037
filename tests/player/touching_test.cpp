// Tests of sessions whose hand also touches the objects of a scene.
#include "control/observer_pd.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/guidance/guide.h"
#include "player/playback/playback.h"
#include "player/record.h"
#include "player/touching_controller.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/allocations.h"
#include "tests/support/delayed_mass.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/scripted.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;
using test::identified;
using test::known_plant;
using test::Log;
using test::PointMass;
using test::TempFolder;
using testing::HasSubstr;

constexpr double kStiffness = 1000;  // of the wall [N/m]

/// Returns a scene with a wall that takes x > 0 away.
std::shared_ptr<Scene> wall(const std::string& more = "") {
  return read_scene(nlohmann::json::parse(fmt::format(
                        R"({{{}"objects": [{{"kind": "wall", "name": "fence", "point": [0, 0, 0], "normal": [-1, 0, 0],
                             "stiffness": {}}}]}})",
                        more, kStiffness)),
                    "test");
}

double depth_at(const Vec3& position) {
  return std::max(position.x(), 0.0);
}

/// Returns a path from 40 mm in front of the wall to 20 mm behind its surface, along x.
Path through_the_wall() {
  Path path;
  path.name = "through";
  for (int i = 0; i <= 200; ++i) {
    const double s = 0.5 - 0.5 * std::cos(std::numbers::pi * i / 200.0);
    path.time.push_back(0.01 * i);
    path.position.emplace_back(-0.04 + 0.06 * s, 0, 0);
  }
  return path;
}

State state_at(const Vec3& position, std::size_t tick) {
  State state;
  state.tick = tick;
  state.dt = tick == 0 ? 0 : 1e-3;
  state.position = position;
  return state;
}

PlayResult touched_along(Device& device, PlayOptions options, Log* log = nullptr,
                         const Path& path = through_the_wall()) {
  if (log != nullptr) options.sinks.push_back(log);
  return play(device, plan_playback(device.info(), path, options), options, StopRequest{});
}

/// Returns options of a playback that goes on where the wall holds the tool back.
PlayOptions through(const std::shared_ptr<Scene>& scene) {
  PlayOptions options;
  options.playback.on_deviation = DeviationPolicy::soften;
  options.playback.max_deviation = 0.05;
  options.session.touch.scene = scene;
  options.session.loop.limits.soft_start = 0;
  return options;
}

TEST(TouchingController, AddsTheSceneToItsControllerAndAllocatesNothing) {
  test::Scripted inner([](const State& state) {
    Command command;
    command.wrench.force = Vec3(1, 2, 3) - 50 * state.position;
    command.wrench.torque = Vec3(0, 0, 0.1);
    command.feedforward = Vec3(1, 2, 3);
    command.reference.position = Vec3(0.01, 0, 0);
    command.phase = Phase::run;
    return command;
  });
  const auto alone = make_scene_controller(wall(), 1000);
  TouchingController both(inner, {.scene = wall()}, PointMass().info(), 1000);
  bool touched = false;
  for (std::size_t tick = 0; tick < 2000; ++tick) {
    const double t = 1e-3 * static_cast<double>(tick);
    const State state = state_at({0.01 * std::sin(7 * t), 0.02 * std::cos(3 * t), 0.01}, tick);
    if (tick == 0) {
      alone->start(state);
      both.start(state);
    }
    const Command one = inner.update(state), other = alone->update(state);
    const std::size_t before = test::allocations();
    const Command sum = both.update(state);
    ASSERT_EQ(test::allocations(), before);
    ASSERT_LE((sum.wrench.force - one.wrench.force - other.wrench.force).norm(), 1e-12);
    ASSERT_EQ(sum.wrench.torque, one.wrench.torque);
    ASSERT_EQ(sum.feedforward, one.feedforward) << "the scene responds to the position, so it may be softened";
    ASSERT_EQ(sum.phase, Phase::run);
    ASSERT_EQ(sum.reference.position, one.reference.position);
    ASSERT_EQ(sum.contacts.size(), other.contacts.size());
    touched |= !sum.contacts.empty();
  }
  EXPECT_TRUE(touched);
}

TEST(TouchingController, ReportsTheEventsOfItsControllerFirstAndLosesNone) {
  int said = 0;
  test::Scripted inner([&](const State&) {
    Command command;
    if (++said <= 3) command.event = Event{.code = EventCode::mark, .values = {static_cast<double>(said), 0, 0}};
    return command;
  });
  TouchingController both(inner, {.scene = wall()}, PointMass().info(), 1000);
  std::vector<EventCode> heard;
  for (std::size_t tick = 0; tick < 60; ++tick) {
    const State state = state_at({tick > 0 && tick < 10 ? 0.002 : -0.01, 0, 0}, tick);
    if (tick == 0) both.start(state);
    if (const Command command = both.update(state); command.event) heard.push_back(command.event->code);
  }
  EXPECT_THAT(heard, testing::ElementsAre(EventCode::mark, EventCode::mark, EventCode::mark, EventCode::touched,
                                          EventCode::left));
}

TEST(TouchingController, FollowsTheShareOfTheSessionAndRestsInAPauseOnlyIfAsked) {
  for (const bool rests : {false, true}) {
    Mailbox<SessionRequests> requests;
    test::Scripted inner([](const State&) { return Command{}; });
    TouchingController both(inner, {.scene = wall(), .requests = &requests, .rests_in_pause = rests},
                            PointMass().info(), 1000);
    std::size_t tick = 0;
    const auto after = [&](double seconds) {
      double force = 0;
      for (const std::size_t end = tick + static_cast<std::size_t>(1e3 * seconds); tick < end; ++tick) {
        const State state = state_at({tick < 5 ? -0.01 : 0.002, 0, 0}, tick);
        if (tick == 0) both.start(state);
        force = both.update(state).wrench.force.x();
      }
      return force;
    };
    const double full = -kStiffness * 0.002;
    EXPECT_NEAR(after(0.1), full, 1e-9);
    requests.post({.share = 0.3});
    EXPECT_NEAR(after(1), 0.3 * full, 1e-9);
    requests.post({.paused = true});
    EXPECT_NEAR(after(1.5), rests ? 0 : full, 1e-9);
    requests.post({});
    EXPECT_NEAR(after(1.5), full, 1e-9);
  }
}

/// Keeps what a controller is told about the forces that acted.
class Witness final : public Controller {
 public:
  Witness() { seen.reserve(5000); }
  [[nodiscard]] Command update(const State& state) noexcept override {
    seen.push_back(state);
    Command command;
    command.wrench.force = Vec3(3, 1, 0);
    if (seen.size() == 2000) command.status = Command::Status::finished;
    return command;
  }
  std::vector<State> seen;
};

TEST(TouchingController, TellsItsControllerWhichPartOfTheSentForceWasOfTheScene) {
  Witness witness;
  PointMass device;
  device.mutable_info().force_axes = {true, false, true};
  device.place({0.001, 0, 0});
  device.throw_at({0.02, 0, 0});
  SessionOptions options;
  options.touch.scene = wall();
  options.loop.limits.max_force = 2.5;
  Log log;
  SampleSink* const sinks[] = {&log};
  const SessionResult result = run_session(device, witness, {}, sinks, options, StopRequest{});
  EXPECT_EQ(result.servo.cause, StopCause::finished) << result.servo.detail;
  int clipped = 0;
  for (std::size_t i = 1; i < 2000; ++i) {
    const State& state = witness.seen[i];
    ASSERT_EQ(state.force_applied, log.samples[i - 1].force);
    ASSERT_LE((state.force_applied - state.force_touched - state.share_applied * Vec3(3, 0, 0)).norm(), 1e-12) << i;
    clipped += state.share_applied > 0 && state.share_applied < 1 ? 1 : 0;
  }
  EXPECT_GT(clipped, 100) << "the fade at the start and the limit reduce the force";
}

TEST(PlaybackWithAScene, SendsTheSumOfBothForcesAndRecordsTheContacts) {
  const TempFolder folder;
  PointMass device;
  PlayOptions options = through(wall());
  options.session.recording = SessionOptions::Recording{.file = folder / "played.h5"};
  const PlayResult result = touched_along(device, options);
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  ASSERT_EQ(result.session.touches.size(), 1U);
  EXPECT_EQ(result.session.touches[0].times, 1);
  EXPECT_EQ(to_json(result)["touches"][0]["object"], "fence");

  const RecordingReader reader(folder / "played.h5");
  EXPECT_TRUE(check_recording(folder / "played.h5").empty());
  EXPECT_EQ(reader.header().scene.objects, std::vector<std::string>{"fence"});
  const auto contacts = reader.contacts(0, reader.contact_rows());
  const PdGains gains = result.plan.tuning.gains;
  std::size_t i = 0;
  for (const Sample& row : reader.read(0, reader.rows())) {
    const double depth = depth_at(row.position);
    if (row.phase != Phase::release) {
      const Vec3 pd = gains.kp.cwiseProduct(row.reference_position - row.position) +
                      gains.kd.cwiseProduct(row.reference_velocity - row.velocity);
      ASSERT_LE((row.force - pd - Vec3(-kStiffness * depth, 0, 0)).norm(), 1e-12);
    }
    if (depth == 0) continue;
    ASSERT_LT(i, contacts.size());
    ASSERT_EQ(contacts[i].tick, row.tick);
    ASSERT_NEAR(contacts[i].depth, depth, 1e-12);
    ASSERT_NEAR(contacts[i].proxy.x(), 0, 1e-12);
    ASSERT_EQ(contacts[i].normal, Vec3(-1, 0, 0));
    ++i;
  }
  EXPECT_GT(i, 100U);
  EXPECT_EQ(i, contacts.size());
}

TEST(PlaybackWithAScene, IsThatWithoutOneToTheLastBitWhereNothingIsTouched) {
  Path away = through_the_wall();
  for (Vec3& p : away.position) p.x() -= 0.05;
  PlayOptions options = through(wall(R"("passivity": true, )"));
  options.identified = identified(known_plant());
  SimDevice one(test::true_device()), other(test::true_device());
  Log with, without;
  (void)touched_along(one, options, &with, away);
  options.session.touch = {};
  (void)touched_along(other, options, &without, away);
  ASSERT_EQ(with.samples.size(), without.samples.size());
  for (std::size_t i = 0; i < with.samples.size(); ++i) ASSERT_EQ(with.samples[i].force, without.samples[i].force);
}

TEST(PlaybackWithAScene, IsHeldBackByAWallThatTheObserverDoesNotCancel) {
  PlayOptions options = through(wall(R"("passivity": true, )"));
  options.identified = identified(known_plant());
  options.playback.hold = 3;
  SimDevice device(test::true_device());
  Log log;
  const PlayResult result = touched_along(device, options, &log);
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_EQ(result.session.gain_share, 1) << "a wall across the path is no vibration";
  for (const EventCode code : {EventCode::hand_resists, EventCode::hand_let_go, EventCode::force_resisted,
                               EventCode::oscillation, EventCode::deviation_over})
    EXPECT_FALSE(log.has(code)) << static_cast<int>(code);

  // The spring of the law and that of the wall are in balance. An observer that took the wall for a load would push
  // the tool to the reference.
  const double kp = result.plan.tuning.gains.kp.x();
  const double balance = kp * 0.02 / (kp + kStiffness);
  const Sample& last = *std::ranges::find_if(log.samples, [](const Sample& s) { return s.phase == Phase::release; });
  EXPECT_NEAR(last.position.x(), balance, 0.15 * 0.02);
  EXPECT_LT(last.position.x(), 0.02 - 0.5 * (0.02 - balance));
}

TEST(ObserverPd, TakesAKnownForceThatIsInTheMotorsForNoLoad) {
  const PlantModel plant = test::late_plant();
  const IdentifiedDevice device = identified(plant);
  ObserverPd law({.design = device.design, .rate_hz = 1000, .position_resolution = 0});
  const Tuning tuning{.gains = device.design.gains, .observer_hz = device.design.load_hz};
  test::DelayedMass mass(plant.mass, 2);
  Vec3 sent = Vec3::Zero();
  const Vec3 target(0.01, 0, 0);
  for (std::size_t tick = 0; tick < 4000; ++tick) {
    State state = state_at(mass.x, tick);
    state.force_applied = sent;
    if (tick == 0) law.start(state);
    const Reference reference{.position = target, .velocity = Vec3::Zero(), .acceleration = Vec3::Zero(), .time = 0};
    sent = law.force({state, reference, tuning}) - Vec3(kStiffness * depth_at(mass.x), 0, 0);
    mass.advance(sent);
  }
  const double kp = device.design.gains.kp.x();
  EXPECT_NEAR(mass.x.x(), kp * 0.01 / (kp + kStiffness), 1e-6) << "the springs alone are in balance";
}

TEST(PlaybackWithAScene, RefusesToLearnAndUsesWhatWasLearnedWithoutIt) {
  PlayOptions options = through(wall());
  options.identified = identified(known_plant());
  options.learn = 2;
  const DeviceInfo info = SimDevice(test::true_device()).info();
  EXPECT_THAT(error_of([&] { (void)plan_playback(info, through_the_wall(), options); }),
              HasSubstr("use --learn without --scene"));

  PlayOptions lesson = options;
  lesson.session.touch = {};
  lesson.playback.repetitions = 2;
  SimDevice device(test::true_device());
  options.learned = touched_along(device, lesson).learned;
  options.learn = 0;
  const PlayResult result = touched_along(device, options);
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  EXPECT_TRUE(result.plan.composed.learning);
  EXPECT_TRUE(result.lessons.empty());
  ASSERT_EQ(result.learned.force.size(), options.learned.force.size());
  for (std::size_t i = 0; i < result.learned.force.size(); ++i)
    ASSERT_EQ(result.learned.force[i], options.learned.force[i]) << "a wall that the path crosses changes nothing";
}

/// Raises a stop once the tool is in the wall.
class StopsInside final : public SampleSink {
 public:
  StopsInside(StopRequest& stop, int times) : stop_(stop), left_(times) { samples_.reserve(1 << 14); }
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    samples_.push_back(sample);
    if (sample.position.x() < 0.001 || left_ == 0) return;
    at = samples_.size();
    while (left_-- > 0) stop_.raise();
    left_ = 0;
  }
  std::size_t at = 0;
  [[nodiscard]] const std::vector<Sample>& samples() const { return samples_; }

 private:
  StopRequest& stop_;
  int left_;
  std::vector<Sample> samples_;
};

TEST(PlaybackWithAScene, StopsWithZeroForceInTheNextTickAndFadesTheSumInARelease) {
  for (const int stops : {1, 2}) {
    StopRequest stop;
    StopsInside sink(stop, stops);
    PointMass device;
    PlayOptions options = through(wall());
    options.sinks.push_back(&sink);
    const PlayResult result = play(device, plan_playback(device.info(), through_the_wall(), options), options, stop);
    EXPECT_EQ(result.session.servo.cause, StopCause::interrupted);
    ASSERT_GT(sink.at, 0U);
    EXPECT_EQ(device.forces().back(), Vec3::Zero());
    if (stops == 2) {
      ASSERT_EQ(sink.samples().size(), sink.at + 1);
      EXPECT_EQ(sink.samples().back().force, Vec3::Zero());
      continue;
    }
    EXPECT_GT(sink.samples().size(), sink.at + 100);
    EXPECT_LT(sink.samples().back().force.norm(), 0.05);
  }
}

TEST(GuidanceWithAScene, LeavesTheSceneOutOfItsEnergyAndTouchesTheObjects) {
  const TempFolder folder;
  // The hand presses into the wall again and again, within a tunnel so wide that its own wall is never touched. At the
  // end the spring of the scene holds 30 mJ more than at the start.
  Path path = through_the_wall();
  for (Vec3& p : path.position) p.x() = 0.002 + 0.1 * (p.x() + 0.04);
  Path intent = path;
  for (std::size_t i = 0; i < intent.size(); ++i) intent.position[i].x() += 0.005 * std::sin(20 * intent.time[i]);
  save_path(intent, folder / "intent.csv", "intent", true);
  const auto energy = [&](const std::shared_ptr<Scene>& scene) {
    const auto device = open_device("sim:preset=omega3,hand=firm,seed=3,intent=" + (folder / "intent.csv"));
    GuideOptions options{.radius = 0.03};
    options.session.touch.scene = scene;
    options.guidance.time_limit = 3;
    const GuideResult result =
        guide(*device, plan_guidance(device->info(), source_of(Path(path)), options), options, StopRequest{});
    EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
    if (scene) {
      EXPECT_GT(result.session.touches.at(0).max_force, 1);
      EXPECT_EQ(to_json(result)["touches"][0]["object"], "fence");
    }
    return result.energy_given;
  };
  const double without = energy(nullptr), with = energy(wall());
  EXPECT_NEAR(with, without, 1e-4) << "no wall of the tunnel is touched, so guidance gives nothing";
}

TEST(GuidanceWithAScene, DoesNotReplayForcesThatHoldContacts) {
  const TempFolder folder;
  PointMass device;
  device.place({-0.01, 0, 0});
  device.throw_at({0.1, 0, 0});
  RecordOptions recording{.duration = 0.4};
  recording.session.touch.scene = wall();
  recording.session.recording = SessionOptions::Recording{.file = folder / "expert.h5"};
  (void)record(device, recording, StopRequest{});
  const auto expert = open_path(folder / "expert.h5");
  ASSERT_TRUE(expert->facts().contacts);

  GuideOptions options;
  const GuidePlan alone = plan_guidance(device.info(), expert, options);
  EXPECT_TRUE(alone.has_forces) << "without a scene, the trainee feels the contacts in the recorded force";
  options.session.touch.scene = wall();
  const GuidePlan touching = plan_guidance(device.info(), expert, options);
  EXPECT_FALSE(touching.has_forces);
  EXPECT_THAT(touching.notes, testing::Contains(HasSubstr("was recorded with a scene")));
  EXPECT_THAT(touching.notes, testing::Not(testing::Contains(HasSubstr("contains no forces"))));
}

}  // namespace
}  // namespace haptrace
