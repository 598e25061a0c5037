// Guidance on the simulated device, held by hands that mean to go their own way.
#include "player/guide.h"

#include "control/shapes.h"
#include "devices/registry.h"
#include "formats/path_file.h"
#include "formats/recording.h"
#include "tests/support/allocations.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

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

/// Twice round a circle of 80 mm in 16 s, pushed to and fro.
Path expert() {
  Path path = make_shape("circle", {.duration = 8, .turns = 2});
  path.name = "expert";
  for (const double t : path.time) path.force.emplace_back(std::cos(2 * t), 1.2, 0.5 * std::sin(t));
  return path;
}

std::shared_ptr<const PathSource> source(Path path = expert()) {
  return source_of(std::move(path));
}

/// A hand that means to go along `path`, so many times as fast.
std::unique_ptr<Device> trainee(const TempFolder& folder, Path path, double speed, const std::string& hand = "firm") {
  for (double& t : path.time) t = t / speed;
  for (Vec3& v : path.velocity) v *= speed;
  const std::string file = folder / fmt::format("intent-{}.csv", speed);
  save_path(path, file, "intent", true);
  return open_device(fmt::format("sim:preset=omega3,hand={},seed=3,intent={}", hand, file));
}

GuideResult guided(Device& device, const GuideOptions& options, Log* log = nullptr,
                   const std::shared_ptr<const PathSource>& path = source()) {
  GuideOptions all = options;
  if (log != nullptr) all.sinks.push_back(log);
  return guide(device, plan_guidance(device.info(), path, all), all, StopRequest{});
}

TEST(Guide, ReplaysTheExpertsForceAtItsPlaceWhateverTheTraineesSpeed) {
  const TempFolder folder;
  for (const double speed : {0.25, 1.0, 4.0}) {
    const auto device = trainee(folder, expert(), speed);
    Log log;
    const GuideResult result = guided(*device, {}, &log);
    ASSERT_EQ(result.session.servo.cause, StopCause::finished) << result.session.servo.detail;
    double error = 0, expected = 0;
    const std::shared_ptr<const ArcPath>& path = result.plan.path;
    for (const Sample& sample : log.samples) {
      // It fades in over the first moments, and nothing is asked of a trainee who left the tunnel.
      if (sample.phase != Phase::run || sample.progress < 0.1 * path->length()) continue;
      if ((sample.position - sample.reference_position).norm() > path->at(sample.progress).radius) continue;
      error += (sample.force - path->at(sample.progress).force).squaredNorm();
      expected += path->at(sample.progress).force.squaredNorm();
    }
    EXPECT_GT(expected, 0);
    EXPECT_LT(std::sqrt(error / expected), 0.05) << speed;
    EXPECT_GT(result.last.time_in_tunnel, 0.95) << speed;
    EXPECT_LE(result.energy_given, result.energy_budget) << speed;
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

TEST(Guide, KeepsAWanderingTraineeNearerThePathThanHeWouldBe) {
  const TempFolder folder;
  Path wandering = expert();
  wandering.velocity.clear();
  for (std::size_t i = 0; i < wandering.size(); ++i)
    wandering.position[i] += 0.012 * Vec3(0, 0, std::sin(3 * wandering.time[i]));
  const auto peak = [&](const GuideOptions& options) {
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
  options.guidance.repetitions = 2;  // in the second of which the hand stays where it is
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
  EXPECT_NEAR(result.last.tracking.duration, 10 * 16 + 10, 0.01) << "in virtual time nobody is waited for without end";
  const nlohmann::json json = to_json(result);
  for (const char* key : {"samples", "duration_s", "rms_error_m", "peak_error_m", "force_ripple_n", "max_force_n",
                          "overruns", "latency_s", "tick_s", "stopped_by", "repetitions", "time_in_tunnel"})
    EXPECT_TRUE(json.contains(key)) << key;
}

TEST(Guide, DragsNobodyAlongWithACursorThatWaits) {
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

TEST(PlanGuidance, NamesWhatIsWrong) {
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

TEST(PlanGuidance, ClampsWallsToWhatDeviceAndRateBearUnlessAnExpertAsks) {
  const test::PointMass device;
  GuideOptions options{.stiffness = 50000};
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  EXPECT_LT(plan.stiffness, 1000);
  ASSERT_FALSE(plan.notes.empty());
  EXPECT_THAT(plan.notes.front(), HasSubstr("more than the device bears at 1000 Hz"));
  options.expert = true;
  EXPECT_EQ(plan_guidance(device.info(), source(), options).stiffness, 50000);
}

TEST(PlanGuidance, SaysWhenTheExpertsForcesAreMissing) {
  const test::PointMass device;
  const GuidePlan plan = plan_guidance(device.info(), source(make_shape("circle", {})), {});
  ASSERT_FALSE(plan.notes.empty());
  EXPECT_THAT(plan.notes.front(), HasSubstr("holds no forces"));
}

TEST(Guide, StaysAtAPathOfOnePlace) {
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

TEST(GuidanceController, AllocatesNothing) {
  test::PointMass device;
  const GuideOptions options;
  const GuidePlan plan = plan_guidance(device.info(), source(), options);
  GuideTerms terms;
  terms.push_back(std::make_unique<TunnelWall>(TunnelWall::Options{}));
  terms.push_back(std::make_unique<ExpertForce>(1));
  GuidanceController controller(plan.path, Guidance(std::move(terms), {}), cautious_gains(8, 1000), {});
  controller.guard({.max_force = 8});
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

}  // namespace
}  // namespace haptrace
