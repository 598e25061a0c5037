// Tests of guidance on the simulated device, held by hands with their own intent.
#include "player/guidance/guide.h"

#include "control/guidance.h"
#include "control/guide_terms.h"
#include "control/path/arc_path.h"
#include "control/path/shapes.h"
#include "control/pd.h"
#include "control/tunnel_wall.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/guidance/guidance_controller.h"
#include "player/passivity_defaults.h"
#include "studies/guidance_draw.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::TempFolder;
using testing::HasSubstr;

/// Returns an expert's path: twice round a circle of 80 mm in 16 s, with a varying force.
Path expert() {
  Path path = make_shape("circle", {.duration = 8, .turns = 2});
  path.name = "expert";
  for (const double t : path.time) path.force.emplace_back(std::cos(2 * t), 1.2, 0.5 * std::sin(t));
  return path;
}

std::shared_ptr<const PathSource> source(Path path = expert()) {
  return source_of(std::move(path));
}

/// Opens a device with a hand that intends to follow `path` at `speed` times its pace.
std::unique_ptr<Device> trainee(const TempFolder& folder, Path path, double speed, const std::string& hand = "firm",
                                const std::string& preset = "omega3") {
  for (double& t : path.time) t = t / speed;
  for (Vec3& v : path.velocity) v *= speed;
  const std::string file = folder / fmt::format("intent-{}.csv", speed);
  save_path(path, file, "intent", true);
  return open_device(fmt::format("sim:preset={},hand={},seed=3,intent={}", preset, hand, file));
}

GuideResult guided(Device& device, const GuideOptions& options, Log* log = nullptr,
                   const std::shared_ptr<const PathSource>& path = source()) {
  GuideOptions all = options;
  if (log != nullptr) all.sinks.push_back(log);
  return guide(device, plan_guidance(device.info(), path, all), all, StopRequest{});
}

/// Returns the expert's recorded force at arc length `s` of the path [N].
Vec3 recorded_force(const Path& recording, const ArcPath& path, double s) {
  const double t = recording.time.front() + path.time_at(s);
  const auto after = std::upper_bound(recording.time.begin() + 1, recording.time.end() - 1, t);
  const auto i = static_cast<std::size_t>(after - recording.time.begin());
  const double share = (t - recording.time[i - 1]) / (recording.time[i] - recording.time[i - 1]);
  return recording.force[i - 1] + share * (recording.force[i] - recording.force[i - 1]);
}

/// Runs guidance for a trainee who waits at the start; calls `visit(sample)` while guidance alone acts.
template <class Visit>
GuideResult felt(const TempFolder& folder, const Path& recording, double speed, const GuideOptions& options,
                 const Visit& visit) {
  Path waiting = recording;
  waiting.velocity.clear();
  waiting.force.clear();
  for (double& t : waiting.time) t += 1.5 * speed;
  waiting.time.insert(waiting.time.begin(), 0);
  waiting.position.insert(waiting.position.begin(), waiting.position.front());
  const auto device = trainee(folder, waiting, speed, "firm", "reference");
  Log log;
  const GuideResult result = guided(*device, options, &log, source(recording));
  EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
  for (const Sample& sample : log.samples)
    if (sample.phase == Phase::run && sample.time_ns > 1'300'000'000) visit(sample);
  return result;
}

TEST(Guide, ReplaysTheExpertsForceAtItsPlaceWhateverTheTraineesSpeed) {
  const TempFolder folder;
  for (const Path& recording : guidance_paths())
    for (const double speed : {0.25, 1.0, 4.0}) {
      SCOPED_TRACE(fmt::format("{} {} times as fast", recording.name, speed));
      const ArcPath path = *plan_guidance(test::PointMass().info(), source(recording), {}).path;
      double error = 0, expected = 0;
      int samples = 0;
      const GuideResult result = felt(folder, recording, speed, {.radius = 0.02}, [&](const Sample& sample) {
        // Where the expert rested, one position has many recorded forces; guidance replays their mean.
        if (std::min(sample.progress, path.length() - sample.progress) < 1e-3) return;
        const Vec3 force = recorded_force(recording, path, sample.progress);
        error += (sample.force - force).squaredNorm();
        expected += force.squaredNorm();
        ++samples;
      });
      EXPECT_GT(samples, 500);
      // A slow trainee, held by friction, turns early on the line: the force fades until the leg is certain.
      EXPECT_LT(std::sqrt(error / expected), recording.name == "line" && speed < 1 ? 0.1 : 0.05);
      EXPECT_EQ(result.last.time_in_tunnel, 1);
      EXPECT_LE(result.energy_given, result.energy_budget);
    }
}

TEST(Guide, ReplaysTheExpertsForceWithinANarrowTunnelThatAFastTraineeLeavesAtBends) {
  const TempFolder folder;
  constexpr double kNarrow = 5e-3;
  for (const Path& recording : guidance_paths()) {
    SCOPED_TRACE(recording.name);
    const ArcPath path = *plan_guidance(test::PointMass().info(), source(recording), {}).path;
    double error = 0, expected = 0;
    felt(folder, recording, 4, {.radius = kNarrow}, [&](const Sample& sample) {
      if (std::min(sample.progress, path.length() - sample.progress) < 1e-3) return;
      if ((sample.position - sample.reference_position).norm() > kNarrow) return;
      // Against the nearest point to the hand, not the place that guidance states.
      const double near = path.nearest_between(std::max(sample.progress - 0.01, 0.0),
                                               std::min(sample.progress + 0.01, path.length()), sample.position)
                              .s;
      const Vec3 force = recorded_force(recording, path, near);
      error += (sample.force - force).squaredNorm();
      expected += force.squaredNorm();
    });
    EXPECT_LT(std::sqrt(error / expected), 0.05);
  }
}

TEST(Guide, LetsATraineeWhoFollowsAtTheExpertsPaceFeelNoWallAndNoHelp) {
  const TempFolder folder;
  // The smoothest paths only: a trainee who cuts a bend leaves the expert's pace.
  for (const Path& recording : {guidance_paths()[0], guidance_paths()[5]}) {
    const double length = plan_guidance(test::PointMass().info(), source(recording), {}).path->length();
    double most = 0;
    int samples = 0;
    felt(folder, recording, 1, {.radius = 0.02, .force_scale = 0, .pace = PaceHelpOptions{}},
         [&](const Sample& sample) {
           // Friction makes the trainee start and arrive more slowly than the expert.
           if (std::abs(sample.progress / length - 0.5) > 0.45) return;
           most = std::max(most, sample.force.norm());
           ++samples;
         });
    EXPECT_GT(samples, 2000);
    EXPECT_EQ(most, 0) << recording.name;
  }
}

TEST(Guide, ShowsItsPathAndTunnelToAnObserver) {
  GuideOptions options;
  options.radius_profile = RadiusProfile{.s = {0, 0.3}, .radius = {8e-3, 2e-3}};
  const auto device = open_device("sim:preset=omega3,hand=firm");
  const GuidePlan plan = plan_guidance(device->info(), source(), options);
  const FollowedPath followed = followed_path(plan, options);
  EXPECT_EQ(followed.mode, "tunnel");
  ASSERT_EQ(followed.position.size(), followed.radius.size());
  ASSERT_EQ(followed.position.size(), followed.time.size());
  EXPECT_LE((followed.position.front() - plan.path->position_at(0)).norm(), 1e-12);
  EXPECT_LE((followed.position.back() - plan.path->position_at(plan.path->length())).norm(), 1e-12);
  EXPECT_NEAR(followed.radius.front(), 8e-3, 1e-9);
  EXPECT_LT(followed.radius.back(), followed.radius.front());
  EXPECT_TRUE(std::is_sorted(followed.time.begin(), followed.time.end()));

  options.free = true;
  EXPECT_EQ(followed_path(plan, options).mode, "free");
  EXPECT_TRUE(followed_path(plan, options).radius.empty());
  options.tunnel_without_walls = true;
  EXPECT_EQ(followed_path(plan, options).radius.size(), followed.radius.size()) << "asked for";
}

TEST(Guide, HasNoTunnelInModeFreeUnlessAskedForOne) {
  const TempFolder folder;
  for (const bool asked : {false, true}) {
    const auto device = trainee(folder, expert(), 2);
    GuideOptions options{.free = true, .tunnel_without_walls = asked};
    options.guidance.led = false;
    options.guidance.time_limit = 3;
    options.session.recording = SessionOptions::Recording{.file = folder / fmt::format("{}.h5", asked)};
    Log log;
    const GuideResult result = guided(*device, options, &log);
    EXPECT_EQ(std::isfinite(result.last.time_in_tunnel), asked);
    EXPECT_EQ(to_json(result)["time_in_tunnel"].is_number(), asked);
    EXPECT_EQ(RecordingReader(folder / fmt::format("{}.h5", asked)).columns().tunnel, asked);
    for (const Sample& sample : log.samples) {
      if (sample.phase != Phase::run) continue;
      ASSERT_EQ(std::isfinite(sample.tunnel_radius), asked);
      ASSERT_TRUE(std::isfinite(sample.progress)) << "the path is still followed";
      ASSERT_EQ(sample.force.norm(), 0);
    }
  }
}

TEST(Guide, LetsTheTraineeOvercomeTheExpertsForceWhenItIsToResist) {
  const TempFolder folder;
  const auto active_device = trainee(folder, expert(), 1), resisting_device = trainee(folder, expert(), 1);
  Log active, resisting;
  guided(*active_device, {}, &active);
  guided(*resisting_device, {.force_scale = 0.5, .feel = Feel::resist}, &resisting);
  const auto mean_y = [](const Log& log) {
    double sum = 0;
    int n = 0;
    for (const Sample& sample : log.samples)
      if (sample.phase == Phase::run && sample.progress > 0.1) sum += sample.force.y(), ++n;
    return sum / n;
  };
  EXPECT_NEAR(mean_y(active), 1.2, 0.15);
  EXPECT_NEAR(mean_y(resisting), -0.6, 0.15);
}

TEST(Guide, KeepsAWanderingTraineeCloserToThePath) {
  const TempFolder folder;
  Path wandering = expert();
  wandering.velocity.clear();
  for (std::size_t i = 0; i < wandering.size(); ++i)
    wandering.position[i] += 0.012 * Vec3(0, 0, std::sin(3 * wandering.time[i]));
  const auto peak = [&](GuideOptions options) {
    options.identified = test::identified(test::known_plant());
    const auto device = trainee(folder, wandering, 1, "relaxed");
    const GuideResult result = guided(*device, options);
    EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
    return result.last.tracking.peak_error;
  };
  EXPECT_LT(peak({.radius = 0.002, .force_scale = 0}), 0.75 * peak({.radius = 0.05, .force_scale = 0}));
}

TEST(Guide, RecordsWhereTheTraineeWasAndWhatTheExpertFeltThere) {
  const TempFolder folder;
  const auto device = trainee(folder, expert(), 2);
  GuideOptions options;
  options.guidance.repetitions = 2;  // the hand stays at rest in the second one
  options.session.recording = SessionOptions::Recording{.file = folder / "guided.h5"};
  const GuideResult result = guided(*device, options);
  ASSERT_EQ(result.repetitions.size(), 2U);
  EXPECT_TRUE(check_recording(folder / "guided.h5").empty());
  const RecordingReader reader(folder / "guided.h5");
  EXPECT_TRUE(reader.columns().reference);
  EXPECT_TRUE(reader.columns().guidance);
  double farthest = 0;
  for (const Sample& row : reader.read(0, reader.rows())) {
    if (row.phase == Phase::approach) {
      ASSERT_TRUE(std::isnan(row.progress));
      ASSERT_FALSE(is_finite(row.reference_force));
    }
    if (row.phase != Phase::run) continue;
    ASSERT_TRUE(is_finite(row.reference_force));
    ASSERT_LT((row.reference_position - result.plan.path->at(row.progress).position).norm(), 1e-12);
    farthest = std::max(farthest, row.progress);
  }
  EXPECT_NEAR(farthest, result.plan.path->length(), 3e-3);
  EXPECT_NEAR(result.last.tracking.duration, 10 * 16 + 10, 0.01) << "virtual time has a time limit";
  const nlohmann::json json = to_json(result);
  for (const char* key : {"samples", "duration_s", "rms_error_m", "peak_error_m", "force_ripple_n", "max_force_n",
                          "overruns", "latency_s", "tick_s", "stopped_by", "repetitions", "time_in_tunnel"})
    EXPECT_TRUE(json.contains(key)) << key;
}

TEST(Guide, DoesNotDragTheTraineeAlongWithACursorThatWaits) {
  const TempFolder folder;
  Path staying = expert();
  staying.velocity.clear();
  std::fill(staying.position.begin(), staying.position.end(), expert().position.front());
  for (const double wait : {0.0, 0.01}) {
    const auto device = trainee(folder, staying, 1, "tense");
    GuideOptions options{.force_scale = 0};
    options.guidance.cursor = true;
    options.guidance.wait = wait;
    options.guidance.time_limit = 3;
    options.guidance.max_deviation = 1;
    Log log;
    const GuideResult result = guided(*device, options, &log);
    EXPECT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
    EXPECT_EQ(result.last.progress > 0.02, wait == 0) << result.last.progress;
    const bool told = std::any_of(log.events.begin(), log.events.end(),
                                  [](const Event& event) { return event.code == EventCode::time_over; });
    EXPECT_TRUE(told);
  }
}

TEST(Guide, EndsFarFromThePath) {
  const TempFolder folder;
  Path away = expert();
  away.velocity.clear();
  for (std::size_t i = 0; i < away.size(); ++i) away.position[i].z() += 0.003 * away.time[i];
  const auto device = trainee(folder, away, 1);
  GuideOptions options;
  options.guidance.max_deviation = 0.02;
  const GuideResult result = guided(*device, options);
  EXPECT_EQ(result.session.servo.cause, StopCause::deviation);
  EXPECT_THAT(result.session.servo.detail, HasSubstr("off the path"));
}

TEST(PlanGuidance, WidensTheTunnelWhereExpertsDiffer) {
  const test::PointMass device;
  Path other = expert();
  other.velocity.clear();
  for (std::size_t i = 0; i < other.size(); ++i)
    other.position[i].z() += 0.008 * std::exp(-std::pow((other.time[i] - 4) / 0.5, 2));
  GuideOptions options{.radius = 1e-3, .spread = {source(other)}};
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  const double middle = plan.path->place_at(4);
  EXPECT_NEAR(plan.path->at(middle).radius, 0.008, 1e-3);
  EXPECT_NEAR(plan.path->at(0.5 * plan.path->length()).radius, 1e-3, 2e-4);
}

TEST(PlanGuidance, RefusesASpreadOfAnotherMovement) {
  const test::PointMass device;
  const auto error = [&](Path other) {
    other.name = "other";
    return error_of([&] { (void)plan_guidance(device.info(), source(), {.radius = 1e-3, .spread = {source(other)}}); });
  };
  EXPECT_EQ(error(expert()), "no error");
  Path backwards = expert();
  backwards.velocity.clear();
  std::reverse(backwards.position.begin(), backwards.position.end());
  EXPECT_THAT(error(backwards), HasSubstr("other: shows another movement"));
  EXPECT_THAT(error(make_shape("circle", {.duration = 8, .turns = 1})), HasSubstr("another number of laps"));
  EXPECT_THAT(error(make_shape("square", {.size = 0.12})), HasSubstr("other: shows another movement"));
}

TEST(PlanGuidance, ScalesARadiusThatCameWithThePath) {
  const test::PointMass device;
  // The path is half as long as its profile: it was scaled after the profile was made.
  const double length = plan_guidance(device.info(), source(), {}).path->length();
  GuideOptions options{.radius = 1e-3, .radius_profile = RadiusProfile{.s = {0, 2 * length}, .radius = {8e-3, 1e-3}}};
  EXPECT_NEAR(plan_guidance(device.info(), source(), options).path->at(length).radius, 4.5e-3, 1e-4);
  options.radius_of_path = true;
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  EXPECT_NEAR(plan.path->at(0).radius, 4e-3, 1e-5);
  EXPECT_NEAR(plan.path->at(length).radius, 1e-3, 1e-5) << "at least `radius`";
}

TEST(PlanGuidance, NamesTheInvalidSetting) {
  const test::PointMass device;
  const auto error = [&](const GuideOptions& options, const Path& path = expert()) {
    return error_of([&] { (void)plan_guidance(device.info(), source(path), options); });
  };
  EXPECT_THAT(error({.radius = -1}), HasSubstr("the radius of the tunnel is -1"));
  EXPECT_THAT(error({.stiffness = 0}), HasSubstr("the stiffness of the walls is 0"));
  EXPECT_THAT(error({.force_scale = -2}), HasSubstr("the scale of the expert's forces"));
  GuideOptions options;
  options.guidance.speed = 0;
  EXPECT_THAT(error(options), HasSubstr("the speed factor is 0"));
  EXPECT_THAT(error({}, make_shape("circle", {.size = 0.9})), HasSubstr("leaves the workspace"));
  EXPECT_THAT(error_of([] { (void)parse_feel("activ"); }), HasSubstr("active"));
  test::PointMass motorless;
  motorless.mutable_info().force_axes = {false, false, false};
  EXPECT_THAT(error_of([&] { (void)plan_guidance(motorless.info(), source(), {}); }), HasSubstr("has no motors"));
}

TEST(PlanGuidance, LimitsWallsToAStableStiffnessUnlessExpertIsSet) {
  const test::PointMass device;
  GuideOptions options{.stiffness = 50000};
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  EXPECT_LT(plan.stiffness, 1000);
  ASSERT_FALSE(plan.notes.empty());
  EXPECT_THAT(plan.notes.front(), HasSubstr(" N/m at 1000 Hz; the stiffness of the walls is limited to"));
  options.expert = true;
  EXPECT_EQ(plan_guidance(device.info(), source(), options).stiffness, 50000);
}

TEST(PlanGuidance, AccountsForTheDelayAndTheDampingOfACalibratedDevice) {
  const test::PointMass device;
  const auto plan = [&](double delay, double viscous) {
    PlantModel plant = test::known_plant();
    plant.delay = delay;
    plant.viscous = Vec3::Constant(viscous);
    GuideOptions options;
    options.identified = test::identified(plant);
    return plan_guidance(device.info(), source(), options);
  };
  const GuidePlan known = plan(2e-3, 1.8);
  EXPECT_EQ(known.delay, 2e-3);
  EXPECT_NEAR(known.stiffness, 1 / (0.5e-3 + 2e-3), 1e-9) << "1 N s/m is all that is counted on";
  EXPECT_TRUE(known.notes.empty());
  EXPECT_NEAR(plan(4e-3, 1.8).stiffness, 1 / (0.5e-3 + 4e-3), 1e-9);
  EXPECT_NEAR(plan(2e-3, 0.5).stiffness, 0.5 / (0.5e-3 + 2e-3), 1e-9);

  const GuidePlan unknown = plan_guidance(device.info(), source(), {});
  EXPECT_EQ(unknown.delay, kUnknownDelay);
  EXPECT_LT(unknown.stiffness, known.stiffness);
  ASSERT_FALSE(unknown.notes.empty());
  EXPECT_THAT(unknown.notes.back(), HasSubstr("haptrace calibrate"));
}

TEST(PlanGuidance, SaysWhenTheExpertsForcesAreMissing) {
  const test::PointMass device;
  const GuidePlan plan = plan_guidance(device.info(), source(make_shape("circle", {})), {});
  ASSERT_FALSE(plan.notes.empty());
  EXPECT_THAT(plan.notes.front(), HasSubstr("contains no forces"));
}

TEST(Guide, StaysAtAPathOfOnePoint) {
  Path place;
  place.name = "place";
  place.time = {0};
  place.position = {Vec3(0.01, 0, 0)};
  test::PointMass device;
  GuideOptions options;
  options.guidance.hold = 0.2;
  const GuideResult result = guided(device, options, nullptr, source(place));
  EXPECT_EQ(result.session.servo.cause, StopCause::finished);
}

/// Returns a controller of guidance with walls and the expert's force along a line of 0.1 m and back.
GuidanceController along_a_line_and_back() {
  ArcPath::Builder builder(2.5e-4);
  for (int i = 0; i <= 2000; ++i)
    builder.add(1e-3 * i, Vec3(i <= 1000 ? 1e-4 * i : 0.2 - 1e-4 * i, 0, 0), Vec3(0, i <= 1000 ? 1 : -1, 0));
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
  terms.push_back(std::make_unique<ExpertForce>(1));
  GuidanceOptions options;
  options.approach_speed = 2;
  return {std::make_shared<const ArcPath>(builder.finish(5e-3)), Guidance(std::move(terms), {}),
          cautious_gains(8, 1000), options};
}

/// Updates a controller in its run with the hand at `position`, and returns the events of a kind.
int count_events(GuidanceController& controller, State& state, const Vec3& position, EventCode code) {
  state.position = position;
  state.dt = 1e-3;
  const Command command = controller.update(state);
  return command.event && command.event->code == code ? 1 : 0;
}

TEST(GuidanceController, ReportsAnEmptyTankOnceAndItsShareOfTheTime) {
  GuidanceController controller = along_a_line_and_back();
  State state;
  controller.start(state);
  int events = 0;
  // A force that acts with the movement gives 1 mJ at every tick of the first two seconds.
  for (int i = 0; i < 6000; ++i) {
    state.force_applied = i < 2000 ? Vec3(0, i % 100 < 50 ? 10 : -10, 0) : Vec3(Vec3::Zero());
    const double y = 1e-4 * (i % 100 < 50 ? i % 100 : 100 - i % 100);
    events += count_events(controller, state, Vec3(0, i < 2000 ? y : 0, 0), EventCode::tank_empty);
  }
  EXPECT_LT(controller.guidance().tank().share(), 0.5);
  EXPECT_EQ(events, 1);
  EXPECT_GT(controller.share_empty(), 0.5);
  EXPECT_EQ(controller.share_in_doubt(), 0);
}

TEST(GuidanceController, ReportsAPlaceThatStaysInDoubt) {
  GuidanceController controller = along_a_line_and_back();
  State state;
  controller.start(state);
  int events = 0;
  const auto move = [&](double x) {
    events += count_events(controller, state, Vec3(x, 0, 0), EventCode::place_in_doubt);
  };
  for (int i = 0; i < 500; ++i) move(0);
  double x = 0;
  while (x < 0.09) move(x += 1e-4);
  while (x > 0.04 && controller.guidance().certainty() > 0.4) move(x -= 1e-4);
  ASSERT_GT(x, 0.04) << "it turned 10 mm early, which may be a return";
  for (int i = 0; i < 3000; ++i) move(x);
  EXPECT_EQ(events, 1);
  EXPECT_GT(controller.share_in_doubt(), 0.3);
}

TEST(GuidanceController, AllocatesNothing) {
  test::PointMass device;
  const GuideOptions options;
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
  terms.push_back(std::make_unique<ExpertForce>(1));
  GuidanceController controller(plan.path, Guidance(std::move(terms), {}), cautious_gains(8, 1000), {});
  State state;
  state.position = plan.path->at(0).position;
  controller.start(state);
  state.dt = 1e-3;
  const std::size_t before = test::allocations();
  for (int i = 0; i < 5000; ++i) {
    state.position = plan.path->position_at(1e-4 * i);
    (void)controller.update(state);
  }
  EXPECT_EQ(test::allocations(), before);
}

/// Returns the result of a trainee who trembles by `tremor` [m] at the start of a path and never leaves it.
GuideResult trembling(const std::string& shape, double tremor, GuideOptions options) {
  const TempFolder folder;
  Path path = make_shape(shape, {.size = 0.08, .duration = 6});
  path.name = shape;
  Path intent{.name = "tremor"};
  for (int i = 0; i < 1000; ++i) {
    const double t = 0.02 * i;
    intent.time.push_back(t);
    intent.position.push_back(path.position.front() +
                              tremor * Vec3(std::sin(19 * t) + std::sin(31 * t + 1), std::sin(23 * t + 2), 0));
  }
  save_path(intent, folder / "tremor.csv", "tremor", true);
  const auto device = open_device("sim:preset=omega3,hand=relaxed,seed=3,intent=" + (folder / "tremor.csv"));
  options.guidance.time_limit = 15;
  return guide(*device, plan_guidance(device->info(), source_of(path), options), options, StopRequest{});
}

TEST(Guide, DoesNotFinishAPathThatEndsNearItsStartForAHandThatOnlyTremblesThere) {
  for (const char* shape : {"square", "circle", "line"})
    for (const double tremor : {1e-3, 3e-3})
      for (const bool free : {false, true}) {
        GuideOptions options;
        options.free = free;
        options.guidance.led = !free;
        const GuideResult result = trembling(shape, tremor, options);
        EXPECT_TRUE(result.last.partial) << shape << " " << tremor << " " << free;
        EXPECT_LT(result.last.completion, 0.35) << shape << " " << tremor << " " << free;
      }
}

}  // namespace
}  // namespace haptrace
