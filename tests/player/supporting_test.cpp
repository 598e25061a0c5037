// Tests of sessions in which the device carries a part of the arm's weight.
#include "control/path/shapes.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/calibration/calibration.h"
#include "player/guidance/guide.h"
#include "player/guidance/live_guidance.h"
#include "player/playback/playback.h"
#include "player/record.h"
#include "player/supporting_controller.h"
#include "player/tuning/live_recording.h"
#include "tests/player/timed_commands.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/scripted.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::PointMass;
using test::TempFolder;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kCautious = 3;  // continuous force of a point mass [N]

/// Records `seconds` of a device whose arm is supported.
SessionResult recorded(Device& device, SessionOptions session, double seconds, Log& log) {
  StopRequest stop;
  int ticks = 0;
  test::Scripted nothing([&](const State&) {
    if (++ticks == 1000 * seconds) stop.raise();
    return Command{.phase = Phase::run};
  });
  SampleSink* const sinks[] = {&log};
  return run_session(device, nothing, {}, sinks, session, stop);
}

TEST(SupportingController, AddsAForceThatTheLoopDoesNotSoftenAndThatIsNoLoad) {
  std::vector<Vec3> applied;
  applied.reserve(4000);
  test::Scripted inner([&](const State& state) {
    applied.push_back(state.force_applied);
    Command command;
    command.wrench.force = Vec3(1, 0, 0);
    command.phase = Phase::run;
    return command;
  });
  SupportingController both(inner, {.force = 2, .up = Vec3::UnitY(), .top = 1, .stiffness = 100}, {});
  Command last;
  for (int tick = 0; tick < 3000; ++tick) {
    State state{.tick = static_cast<std::uint64_t>(tick), .dt = tick == 0 ? 0 : 1e-3};
    state.force_applied = last.wrench.force;
    if (tick == 0) both.start(state);
    const std::size_t before = test::allocations();
    last = both.update(state);
    ASSERT_EQ(test::allocations(), before);
  }
  EXPECT_TRUE(last.wrench.force.isApprox(Vec3(1, 2, 0), 1e-9));
  EXPECT_TRUE(last.feedforward.isApprox(Vec3(0, 2, 0), 1e-9));
  EXPECT_EQ(last.support, last.feedforward);
  EXPECT_EQ(last.phase, Phase::run);
  EXPECT_TRUE(applied.back().isApprox(Vec3(1, 0, 0), 1e-9)) << "for the controller, the arm is that much lighter";
}

TEST(Support, ReachesTheDeviceTheResultAndTheRecording) {
  const TempFolder folder;
  PointMass device(1, 40);
  Log log;
  SessionOptions session{.recording = SessionOptions::Recording{.file = folder / "supported.h5"}};
  session.support = {.force = 2, .up = Vec3(0, 0, 1)};
  const SessionResult result = recorded(device, session, 4, log);
  EXPECT_EQ(result.servo.cause, StopCause::interrupted);
  EXPECT_EQ(result.support, 2);
  EXPECT_NEAR(log.samples.at(500).force.z(), 0.5, 0.02) << "it rises over two seconds";
  EXPECT_NEAR(log.samples.at(3900).force.z(), 2, 0.02);
  EXPECT_EQ(log.samples.at(3900).force.x(), 0);
  EXPECT_NEAR(log.samples.at(4500).force.z(), 1, 0.1) << "an arm must not drop: it goes over a second";
  EXPECT_TRUE(device.forces().back().isZero(0)) << "every way out sends zero";
  const RecordingReader reader(folder / "supported.h5");
  EXPECT_EQ(reader.header().config["support"], 2);
  for (const Sample& sample : reader.read(0, reader.rows())) ASSERT_EQ(sample.support, sample.force) << sample.tick;
  EXPECT_EQ(to_json(result)["support_n"], 2);
}

TEST(Support, StaysWhereALimitReducesTheForceAndGoesWithAFault) {
  PointMass device(1, 40);
  StopRequest stop;
  Log log;
  test::Scripted strong([](const State& state) {
    Command command{.phase = Phase::run};
    command.wrench.force = Vec3(9, 0, 0);
    if (state.tick == 3000) command.status = Command::Status::deviation;
    return command;
  });
  SessionOptions session;
  session.loop.limits.max_force = 4;
  session.loop.limits.max_continuous_force = 4;
  session.support = {.force = 2, .up = Vec3::UnitY()};
  SampleSink* const sinks[] = {&log};
  (void)run_session(device, strong, {}, sinks, session, stop);
  ASSERT_GT(log.samples.size(), 3040U);
  for (const Sample& sample : log.samples) {
    if (sample.force.x() > 0) {
      ASSERT_NEAR(sample.support.y(), sample.force.y(), 1e-9) << "only the support acts along y; " << sample.tick;
    }
  }
  EXPECT_NEAR(log.samples.at(2900).support.y(), 2, 1e-6) << "the limit reduces what is no support";
  EXPECT_NEAR(log.samples.at(2900).force.norm(), 4, 1e-9);
  EXPECT_LT(log.samples.at(3030).support.y(), log.samples.at(2990).support.y());
  EXPECT_EQ(log.samples.back().support.norm(), 0);

  session.support.force = 0;
  Log without;
  SampleSink* const others[] = {&without};
  (void)run_session(device, strong, {}, others, session, stop);
  EXPECT_TRUE(without.samples.at(100).support.array().isNaN().all()) << "nothing could carry the arm";
}

TEST(Support, FollowsACommandAndIsRecordedAsItWasSent) {
  const TempFolder folder;
  PointMass device(1, 400);
  StopRequest stop;
  const auto annotations = std::make_shared<Annotations>();
  LiveRecording live(annotations, stop);
  test::TimedCommands commands(live, {{3, "support 1"}, {4, "support"}, {4, "support * 40"}, {5, "reset"}, {6, "get"}});
  Log log;
  SessionOptions session;
  SessionOptions::Recording& recording = session.recording.emplace();
  recording.file = folder / "s.h5";
  recording.options.annotations = annotations;
  session.support = {.force = 2, .up = Vec3::UnitY()};
  std::vector<SampleSink*> sinks{&log, &commands};
  attach(live, device.info(), session, sinks);
  int ticks = 0;
  test::Scripted nothing([&](const State&) {
    if (++ticks == 7000) stop.raise();
    return Command{.phase = Phase::run};
  });
  const SessionResult result = run_session(device, nothing, {}, sinks, session, stop);
  EXPECT_NEAR(log.samples.at(2900).force.y(), 2, 1e-6);
  EXPECT_NEAR(log.samples.at(3250).force.y(), 1.5, 0.01) << "at 2 N/s";
  EXPECT_NEAR(log.samples.at(3990).force.y(), 1, 1e-6);
  EXPECT_NEAR(log.samples.at(4990).force.y(), kSupportShare * kCautious, 1e-6) << "no more than the motors can hold";
  EXPECT_NEAR(log.samples.at(6500).force.y(), 2, 1e-6);
  EXPECT_EQ(result.support, 2);
  ASSERT_EQ(commands.answers.size(), 5U);
  EXPECT_EQ(commands.answers[0], "ok support 1");
  EXPECT_EQ(commands.answers[1], "ok support 1");
  EXPECT_EQ(commands.answers[2], "ok support 2.1 clamped from 40: 2.1 is the force that this device can hold for long");
  EXPECT_EQ(commands.answers[3], "ok reset to support 2");
  EXPECT_EQ(nlohmann::json::parse(commands.answers[4])["support"], 2);
  const RecordingReader reader(folder / "s.h5");
  for (const Sample& sample : reader.read(0, reader.rows())) ASSERT_EQ(sample.support, sample.force) << sample.tick;
  std::vector<std::string> texts;
  for (const StoredEvent& event : reader.events()) texts.push_back(event.text);
  EXPECT_THAT(texts, testing::IsSupersetOf({"tuned: support 1", "tuned: support 2.1", "tuned: support 2"}));
}

TEST(Support, IsNotSoftenedByACommandButGoesInAPauseThatTakesAllForces) {
  PointMass device(1, 400);
  StopRequest stop;
  LiveRecording live(nullptr, stop);
  test::TimedCommands commands(live, {{3, "soften"}});
  Log log;
  SessionOptions session;
  session.support = {.force = 2, .up = Vec3::UnitY()};
  std::vector<SampleSink*> sinks{&log, &commands};
  attach(live, device.info(), session, sinks);
  int ticks = 0;
  test::Scripted nothing([&](const State&) {
    if (++ticks == 4000) stop.raise();
    return Command{.phase = Phase::run};
  });
  (void)run_session(device, nothing, {}, sinks, session, stop);
  EXPECT_NEAR(log.samples.at(3900).force.y(), 2, 1e-6) << "an arm must not drop because a page is silent";

  Mailbox<SessionRequests> requests;
  test::Scripted inner([](const State&) { return Command{}; });
  SupportingController both(inner, {.force = 2, .up = Vec3::UnitY(), .top = 1, .stiffness = 100},
                            {.requests = &requests, .rests_in_pause = true});
  State state{.dt = 1e-3};
  both.start(state);
  for (int tick = 0; tick < 3000; ++tick) (void)both.update(state);
  requests.post({.paused = true});
  for (int tick = 0; tick < 250; ++tick) (void)both.update(state);
  EXPECT_NEAR(both.update(state).support.y(), 1, 0.05) << "in half a second";
}

TEST(Support, IsNoLoadForALawThatCancelsTheLoad) {
  // The mean error across the support of a calibrated playback, with the arm's weight on the handle [m].
  const TempFolder folder;
  const std::string spec = folder.write("arm.json", R"({"gravity_bias": [0, -1.5, 0]})");
  const std::string name = fmt::format("sim:preset=omega3,spec={},hand=relaxed", spec);
  const auto device = open_device(name);
  CalibrationOptions quick{.places = false};
  const CalibrationResult calibrated = calibrate(*device, quick, StopRequest{});
  ASSERT_TRUE(calibrated.succeeded()) << calibrated.reason;
  const auto offset = [&](double support) {
    const auto again = open_device(name);
    Log log;
    PlayOptions options{.identified = calibrated.identified(), .playback = {.repetitions = 2}, .sinks = {&log}};
    options.session.support = {.force = support, .up = Vec3::UnitY()};
    (void)play(*again, plan_playback(again->info(), make_shape("circle", {.size = 0.04, .duration = 4}), options),
               options, StopRequest{});
    double sum = 0, count = 0;
    for (const Sample& sample : log.samples) {
      if (sample.phase != Phase::run || sample.time_ns < 4'000'000'000) continue;
      sum += (sample.position - sample.reference_position).y();
      ++count;
    }
    return sum / count;
  };
  EXPECT_NEAR(offset(1.5), offset(0), 2e-5);
}

TEST(Support, IsTakenBeforeTheSessionBegins) {
  PointMass device;
  StopRequest stop;
  LiveRecording live(nullptr, stop);
  EXPECT_EQ(live.obey("support 1"), "ok support 1 from the beginning, if the session carries an arm");
  EXPECT_THAT(live.obey("support * 2"), HasSubstr("support takes a force, such as 2 or 1.5N"));
  SessionOptions session;
  session.support = {.force = 2, .up = Vec3::UnitY()};
  std::vector<SampleSink*> sinks;
  attach(live, device.info(), session, sinks);
  EXPECT_EQ(live.requests().latest().support, 1);
  EXPECT_EQ(live.obey("support"), "ok support 1");
  EXPECT_EQ(live.obey("reset"), "ok reset to support 2");
  LiveGuidance programme({.programme = true});
  EXPECT_THAT(programme.obey("support 1"), HasSubstr("no repetition has begun yet"));
}

TEST(Support, HasACommandOnlyInASessionThatBeganWithIt) {
  PointMass device;
  StopRequest stop;
  LiveRecording live(nullptr, stop);
  SessionOptions session;
  std::vector<SampleSink*> sinks;
  attach(live, device.info(), session, sinks);
  EXPECT_THAT(live.obey("support 2"), HasSubstr("error support: this session began without a support of the arm"));
  EXPECT_THAT(live.controls(), IsEmpty());
  session.support.adjustable = true;
  attach(live, device.info(), session, sinks);
  EXPECT_EQ(live.obey("support 2"), "ok support 2");
  EXPECT_EQ(live.controls().at(0).largest, kSupportShare * kCautious);
  EXPECT_EQ(live.obey("support 1.5 N"), "ok support 1.5");
  EXPECT_EQ(live.obey("support 500mN"), "ok support 0.5");
  EXPECT_THAT(live.obey("support -1"), HasSubstr("support is negative"));
  for (const char* wrong : {"support x", "support 1 x", "support 2mm", "support nan", "support inf"})
    EXPECT_THAT(live.obey(wrong), HasSubstr("support takes a force, such as 2 or 1.5N, or a factor")) << wrong;
  EXPECT_THAT(live.obey("get suport"), HasSubstr("did you mean 'support'"));
}

TEST(Support, OfAnExerciseStaysAsACommandSetIt) {
  StopRequest stop, end;
  LiveGuidance live({.stop = &stop, .programme = true});
  EXPECT_EQ(live.next_support(3, 2), 2);
  LiveSession::Trial trial(&live, end, "a.h5", 3);
  live.begin_support(LiveSession::CarriedArm{.force = 2, .most = 5, .because = "limit"});
  EXPECT_EQ(live.obey("support 0"), "ok support 0");
  EXPECT_EQ(live.next_support(3, 2.5), 0) << "for its next repetition too";
  EXPECT_EQ(live.next_support(4, 2), 2) << "but not for another exercise";
  EXPECT_EQ(live.obey("reset"), "ok reset to support 2.5") << "as the programme now plans it";
  EXPECT_EQ(live.next_support(3, 2.5), 2.5);
  EXPECT_EQ(live.next_support(3, 8), 8);
  EXPECT_EQ(live.obey("reset"), "ok reset to support 5") << "a plan may ask for more than the device can hold";
  EXPECT_EQ(live.requests().latest().support, 5);
}

TEST(Support, IsAtMostWhatTheMotorsCanHoldAndSaysSo) {
  PointMass device(1, 40);
  Log log;
  SessionOptions session;
  session.support = {.force = 8, .up = Vec3::UnitY()};
  const SessionResult result = recorded(device, session, 3, log);
  EXPECT_NEAR(result.support, kSupportShare * kCautious, 1e-9);
  ASSERT_EQ(result.warnings.size(), 1U) << "and no force limit acts";
  EXPECT_EQ(result.warnings[0].code, "support");
  EXPECT_THAT(result.warnings[0].text, HasSubstr("supported with 2.1 N instead of 8 N"));
  session.loop.limits.max_continuous_force = 1;
  EXPECT_NEAR(plan_support(device.info(), session).support.force, 0.7, 1e-9);
  session.loop.limits.max_force = 0.3;
  const SupportPlan limited = plan_support(device.info(), session);
  EXPECT_NEAR(limited.support.force, 0.21, 1e-9) << "the report would state a force that no motor gave";
  EXPECT_THAT(limited.warnings, ElementsAre(HasSubstr("0.21 N instead of 8 N: the session has 0.3 N")));
}

TEST(Support, KeepsTheSpeedLimitOfARecording) {
  PointMass device(0.5, 0);
  device.throw_at(Vec3(2, 0, 0));
  RecordOptions options{.duration = 2};
  options.session.loop.limits.max_velocity = 1.5;
  const TempFolder folder;
  options.session.recording = SessionOptions::Recording{.file = folder / "thrown.h5"};
  options.session.support = {.force = 1, .up = Vec3::UnitY()};
  EXPECT_EQ(record(device, options, StopRequest{}).servo.cause, StopCause::velocity);
}

TEST(Support, NeedsAMotorAgainstGravity) {
  DeviceInfo info = PointMass().info();
  info.force_axes = {true, true, false};
  SessionOptions session;
  session.support = {.force = 1, .up = Vec3::UnitZ()};
  EXPECT_THAT(error_of([&] { (void)plan_support(info, session); }), HasSubstr("no motor along z"));
  session.support.up = Vec3::UnitY();
  EXPECT_THAT(plan_support(info, session).warnings, IsEmpty());
  session.support.force = -1;
  EXPECT_THAT(error_of([&] { (void)plan_support(info, session); }), HasSubstr("--support"));
}

TEST(Support, EndsBelowTheTopOfTheWorkspaceWhereAHandleThatNobodyHoldsStops) {
  for (const double mass : {0.06, 0.2}) {
    PointMass device(mass, 0.5);
    device.place(Vec3(0, -0.1, 0));
    Log log;
    SessionOptions session;
    session.support = {.force = 2, .up = Vec3::UnitY()};
    const SessionResult result = recorded(device, session, 8, log);
    EXPECT_EQ(result.servo.cause, StopCause::interrupted) << "no limit and no guard had to end it";
    double fastest = 0;
    for (const Sample& sample : log.samples) fastest = std::max(fastest, sample.velocity.y());
    EXPECT_LT(fastest, ArmSupport::kFastest) << mass;
    EXPECT_LE(log.samples.back().position.y(), device.info().workspace_max.y() + 0.06) << mass;
    EXPECT_NEAR(log.samples.at(7900).velocity.y(), 0, 0.01) << mass;
  }
}

TEST(Support, OfATraineeIsNotChargedToTheEnergyOfGuidance) {
  const TempFolder folder;
  // A circle in an upright plane: the support gives and takes 0.16 J in every turn.
  Path path = make_shape("circle", {.size = 0.08, .duration = 4, .turns = 3});
  path.name = "circle";
  const std::string intent = folder / "circle.csv";
  save_path(path, intent, "circle", true);
  const auto run = [&](double force) {
    const auto device = open_device(fmt::format("sim:preset=omega3,hand=firm,seed=3,intent={}", intent));
    GuideOptions options{.force_scale = 0, .energy = 0.1};
    options.session.support = {.force = force, .up = Vec3::UnitY()};
    return guide(*device, plan_guidance(device->info(), source_of(path), options), options, StopRequest{});
  };
  const GuideResult without = run(0), with = run(2);
  EXPECT_EQ(with.session.servo.cause, StopCause::finished);
  EXPECT_EQ(with.session.support, 2);
  EXPECT_EQ(with.time_empty, 0);
  EXPECT_LE(with.energy_given, with.energy_budget);
  EXPECT_NEAR(with.energy_given, without.energy_given, 0.02) << "J";
}

TEST(Support, RelievesAHandWhoseArmIsHeavy) {
  const TempFolder folder;
  // Returns the mean height of a hand that keeps its place [m]. The same seed makes the same tremor and drift.
  const auto height = [&](double weight, double force) {
    const std::string spec = folder.write("arm.json", fmt::format(R"({{"gravity_bias": [0, {}, 0]}})", -weight));
    const auto device = open_device(fmt::format("sim:preset=omega3,spec={},hand=firm,seed=3", spec));
    Log log;
    SessionOptions session;
    session.support = {.force = force, .up = Vec3::UnitY()};
    (void)recorded(*device, session, 8, log);
    double sum = 0, count = 0;
    for (const Sample& sample : log.samples) {
      if (sample.time_ns < 4'000'000'000) continue;
      sum += sample.position.y();
      ++count;
    }
    return sum / count;
  };
  const double light = height(0, 0), heavy = height(2, 0), carried = height(2, 2);
  EXPECT_LT(heavy, light - 1e-3) << "the arm sags";
  EXPECT_LT(std::abs(carried - light), 0.3 * (light - heavy));
}

}  // namespace
}  // namespace haptrace
