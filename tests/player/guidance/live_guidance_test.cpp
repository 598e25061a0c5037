// Tests of the commands that change running guidance, and of the energy that they may give to a hand.
#include "player/guidance/live_guidance.h"

#include "control/path/shapes.h"
#include "control/pd.h"
#include "formats/path/path_source.h"
#include "player/guidance/guidance_controller.h"
#include "player/guidance/guide.h"
#include "tests/player/timed_commands.h"
#include "tests/support/allocations.h"
#include "tests/support/point_mass.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using test::Log;
using test::PointMass;
using test::TimedCommands;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

LiveGuidance::Scope live_scope() {
  const GuidanceValues values{.radius = 5e-3, .stiffness = 400, .force = 1, .assist = 1, .damping = 3};
  return {.start = values,
          .composed = values,
          .largest_radius = 0.1,
          .largest_stiffness = 800,
          .because = "stability limit of this device",
          .expert_force = true,
          .help = true};
}

std::shared_ptr<const PathSource> live_line() {
  Path path = make_shape("line", {.size = 0.1, .duration = 4});
  path.name = "line";
  return source_of(std::move(path));
}

TEST(LiveGuidance, AnswersWithTheValueInForceAndItsLimit) {
  LiveGuidance live({});
  live.begin(live_scope());
  const std::pair<const char*, const char*> dialogue[] = {
      {"radius 6mm", "ok radius 6mm"},
      {"radius 0.008", "ok radius 8mm"},
      {"radius 1 m", "ok radius 100mm clamped from 1000mm: 100mm is the distance at which the session stops"},
      {"radius 0", "ok radius 0.1mm clamped from 0mm: 0.1mm is the least value"},
      {"stiffness 500", "ok stiffness 500"},
      {"stiffness * 1.1", "ok stiffness 550"},
      {"stiffness 5000", "ok stiffness 800 clamped from 5000: 800 is the stability limit of this device"},
      {"force 2", "ok force 1.5 clamped from 2: 1.5 is the limit for the expert's force"},
      {"assist 0.25", "ok assist 0.25"},
      {"damping 1", "ok damping 1"},
      {"get stiffness", "ok stiffness 800"},
      {"radius nan", "error radius takes a length, such as 6mm or 0.006"},
      {"radius -3mm", "error radius is negative; it must be at least 0"},
      {"assist lots", "error assist: 'lots' is not a number"},
      {"stifness 3", "error unknown command 'stifness'; did you mean 'stiffness'?"},
      {"reset", "ok reset to radius 5mm stiffness 400 force 1 assist 1 damping 3"}};
  for (const auto& [command, answer] : dialogue) EXPECT_EQ(live.obey(command), answer) << command;
}

TEST(LiveGuidance, PostsValuesRelativeToThoseWithWhichTheTermsWereComposed) {
  LiveGuidance live({});
  LiveGuidance::Scope assisted = live_scope();
  assisted.start.assist = assisted.composed.assist = 0.8;
  assisted.walls_help = true;
  live.begin(assisted);
  (void)live.obey("radius 7mm");
  (void)live.obey("stiffness 200");
  (void)live.obey("assist 0.4");
  (void)live.obey("force 0.5");
  const GuideTuning& tuning = live.mailbox().latest();
  EXPECT_NEAR(tuning.radius(5e-3), 7e-3, 1e-12);
  EXPECT_NEAR(tuning.stiffness, 0.5 * 0.5, 1e-12) << "half the stiffness, and half the help that scales it";
  EXPECT_NEAR(tuning.assist, 0.5, 1e-12);
  EXPECT_NEAR(tuning.force, 0.5, 1e-12);
}

TEST(LiveGuidance, ScalesARadiusThatVariesAlongThePath) {
  LiveGuidance live({});
  LiveGuidance::Scope varying = live_scope();
  varying.varies = true;
  varying.start.radius = varying.composed.radius = 1;
  live.begin(varying);
  EXPECT_EQ(live.obey("radius 1.5"), "ok radius 1.5");
  EXPECT_NEAR(live.mailbox().latest().radius(4e-3), 6e-3, 1e-12);
  EXPECT_THAT(live.obey("radius 6mm"), StartsWith("error"));
}

TEST(LiveGuidance, SaysWhyASessionHasNoSuchQuantity) {
  LiveGuidance live({});
  EXPECT_EQ(live.obey("radius 6mm"), "error radius: no repetition has begun yet");
  LiveGuidance::Scope bare = live_scope();
  bare.help = bare.expert_force = false;
  live.begin(bare);
  EXPECT_EQ(live.obey("assist 0.5"), "error assist: this session has no help along the path");
  EXPECT_EQ(live.obey("force 0.5"), "error force: this session has no force of the expert");
  live.begin_unguided("the device moves the participant in this exercise");
  EXPECT_EQ(live.obey("radius 6mm"), "error radius: the device moves the participant in this exercise");
}

TEST(LiveGuidance, KeepsAChangeForLaterRepetitionsOfTheSameExerciseOnly) {
  LiveGuidance live({.programme = true});
  live.begin(live_scope(), 0);
  (void)live.obey("radius 9mm");
  live.begin(live_scope(), 1);
  EXPECT_EQ(live.obey("radius"), "ok radius 5mm");
  live.begin(live_scope(), 0);
  EXPECT_EQ(live.obey("radius"), "ok radius 9mm");
  EXPECT_NEAR(live.mailbox().latest().radius(5e-3), 9e-3, 1e-12) << "in force from the first tick";
  (void)live.obey("reset");
  live.begin(live_scope(), 0);
  EXPECT_EQ(live.obey("radius"), "ok radius 5mm");
}

TEST(LiveGuidance, ListsWhatAPageShows) {
  LiveGuidance live({});
  live.begin(live_scope());
  std::vector<std::string> names;
  for (const LiveControl& control : live.controls()) {
    names.push_back(control.name);
    EXPECT_LE(control.least, control.value) << control.name;
    EXPECT_LE(control.value, control.largest) << control.name;
    EXPECT_FALSE(control.label.empty() || control.because.empty()) << control.name;
    EXPECT_GT(control.step, 0) << control.name;
  }
  EXPECT_THAT(names, ElementsAre("radius", "stiffness", "force", "assist", "damping"));
  EXPECT_THAT(live.actions(), ElementsAre("pause", "skip", "repeat", "mark", "note"));
  EXPECT_EQ(live.controls()[1].because, "stability limit of this device");
  EXPECT_NEAR(live.controls()[1].ratio, 1.1, 1e-12) << "a button for the stiffness does as the key in the terminal";
}

struct LiveRun {
  GuideResult result;
  std::vector<std::string> answers;
  Log log;
  nlohmann::json history;
};

/// Guides a point mass that starts beside the path and gets `push` [N] sideways.
void live_guided(LiveRun& run, std::vector<std::pair<double, std::string>> commands, GuideOptions options = {}) {
  PointMass device;
  StopRequest stop;
  const GuidePlan plan = plan_guidance(device.info(), live_line(), options);
  LiveGuidance live({.stop = &stop});
  live.begin(guide_scope(plan, options));
  TimedCommands script(live, std::move(commands));
  options.live = &live;
  options.sinks = {&script, &run.log};
  run.result = guide(device, plan, options, stop);
  run.answers = script.answers;
  run.history = live.history();
}

TEST(LiveGuidance, ChangesTheTunnelOfARunningSessionWithoutAStep) {
  LiveRun run;
  live_guided(run, {{1.0, "radius 9mm"}}, {.guidance = {.time_limit = 3}});
  double before = 0, after = 0, step = 0, previous = kNaN;
  for (const Sample& sample : run.log.samples) {
    if (std::isnan(sample.tunnel_radius)) continue;
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    if (t < 1.0) before = sample.tunnel_radius;
    if (t < 1.3) after = sample.tunnel_radius;
    if (!std::isnan(previous)) step = std::max(step, std::abs(sample.tunnel_radius - previous));
    previous = sample.tunnel_radius;
  }
  EXPECT_NEAR(before, 5e-3, 1e-9);
  EXPECT_NEAR(after, 9e-3, 1e-4) << "98 % of the change after 0.2 s";
  EXPECT_LT(step, 1e-4);
  EXPECT_EQ(run.history["changes"][0]["text"], "radius 9mm");
}

TEST(LiveGuidance, FadesTheForceWhileItIsPausedAndContinuesAfterwards) {
  LiveRun run;
  // The cursor moves on and pulls the mass along with it.
  live_guided(run, {{2.0, "pause"}, {4.0, "resume"}}, {.guidance = {.cursor = true}, .radius = 1e-3});
  EXPECT_EQ(run.result.session.servo.cause, StopCause::finished) << run.result.session.servo.detail;
  double most = 0, progress_before = kNaN, progress_after = kNaN, before = 0;
  for (const Sample& sample : run.log.samples) {
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    if (t > 1 && t < 2) before = std::max(before, sample.force.norm());
    if (t > 2.5 && t < 4) {
      most = std::max(most, sample.force.norm());
      if (std::isnan(progress_before)) progress_before = sample.progress;
      progress_after = sample.progress;
    }
  }
  EXPECT_GT(before, 0.05) << "the test has a force to fade";
  EXPECT_LT(most, 1e-3);
  EXPECT_NEAR(progress_after, progress_before, 1e-6) << "the cursor stands still";
  EXPECT_THAT(run.answers, ElementsAre("ok pause", "ok resume"));
}

TEST(LiveGuidance, SkipsRepeatsAndStops) {
  const GuideOptions options{.guidance = {.cursor = true, .repetitions = 3, .hold = 0.1}};
  const auto repetitions = [&](std::vector<std::pair<double, std::string>> commands, LiveRun& run) {
    live_guided(run, std::move(commands), options);
    std::size_t count = 0;
    for (const Event& event : run.log.events) count += event.code == EventCode::repetition ? 1 : 0;
    return count;
  };
  LiveRun all, skipped, repeated, stopped;
  EXPECT_EQ(repetitions({}, all), 3U);
  EXPECT_EQ(repetitions({{2, "skip"}}, skipped), 3U);
  EXPECT_LT(skipped.result.session.servo.duration, all.result.session.servo.duration - 1.5);
  EXPECT_EQ(repetitions({{2, "repeat"}, {3, "repeat"}}, repeated), 5U);
  EXPECT_EQ(repeated.result.repetitions.size(), 5U);
  EXPECT_EQ(repetitions({{2, "stop"}}, stopped), 1U);
  EXPECT_EQ(stopped.result.session.servo.cause, StopCause::interrupted);
  EXPECT_LT(stopped.result.session.servo.duration, 3);
}

TEST(LiveGuidance, SoftensAllForcesToThirtyPercentAndRestoresThem) {
  // A hand rests 1 mm deep in the wall.
  const ArcPath path = *plan_guidance(PointMass().info(), live_line(), {}).path;
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{.stiffness = 500}));
  GuidanceController controller(std::make_shared<const ArcPath>(path), Guidance(std::move(terms), {}),
                                cautious_gains(10, 1000), {.max_deviation = 0.5});
  Mailbox<SessionRequests> requests;
  Mailbox<GuideTuning> tunings;
  controller.obey(requests, tunings);
  State state;
  state.position = path.position_at(0) + Vec3(0, 0, 7e-3);
  controller.start(state);
  state.dt = 1e-3;
  const auto settle = [&](double seconds) {
    Command command;
    for (int i = 0; i < static_cast<int>(1e3 * seconds); ++i) {
      command = controller.update(state);
      state.force_applied = command.wrench.force;
    }
    return command.wrench.force.norm();
  };
  const double full = settle(3);
  ASSERT_GT(full, 0.1);
  requests.post({.share = LiveSession::kSoftened});
  const std::size_t before = test::allocations();
  EXPECT_NEAR(settle(0.4), 0.3 * full, 0.01 * full);
  EXPECT_EQ(test::allocations(), before) << "a tick allocates nothing";
  requests.post({});
  EXPECT_NEAR(settle(0.4), full, 0.01 * full);
}

/// A hand that moves by itself at a wall whose radius, stiffness and share change at random.
TEST(LiveGuidance, GivesNoMoreEnergyThanItsBudgetWhateverTheCommands) {
  const ArcPath path = *plan_guidance(PointMass().info(), live_line(), {}).path;
  const Vec3 middle = path.position_at(0.5 * path.length());
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> number(0, 1);
    GuideTerms terms;
    terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{.stiffness = 500, .max_force = 8}));
    const double capacity = 0.02;
    Guidance guidance(std::move(terms), {.energy = capacity, .delay = 0});
    PathProjection projection(path, {});
    projection.start(0.5 * path.length());
    State state;
    state.dt = 1e-3;
    double given = 0, most = 0, z = 0;
    Vec3 sent = Vec3::Zero();
    for (int tick = 0; tick < 20000; ++tick) {
      if (tick % 150 == 0)
        guidance.tune({.radius_offset = 8e-3 * number(random) - 5e-3,
                       .stiffness = 3 * number(random),
                       .share = number(random) < 0.3 ? 0.3 : 1});
      // The worst hand: it leaves while the tunnel is wide or soft, and lets itself be pushed back.
      const double before = z;
      z = sent.norm() > 0.3 ? z - 2e-5 : z + 1e-5;
      z = std::clamp(z, 0.0, 0.012);
      given += -sent.norm() * (z - before);
      state.position = middle + Vec3(0, 0, z);
      state.velocity = Vec3(0, 0, (z - before) / state.dt);
      state.force_applied = sent;
      const auto& foot = projection.move_to(0.5 * path.length(), state.position, state.dt);
      sent = guidance.update(state, foot, false);
      most = std::max(most, given);
    }
    // A sampled spring gives a little more than it held before the damping takes that back.
    EXPECT_LE(most, guidance.budget() + 0.1 * capacity) << "seed " << seed;
    EXPECT_GT(most, 0.1 * capacity) << "seed " << seed << ": the hand got something, so the test tests something";
  }
}

}  // namespace
}  // namespace haptrace
