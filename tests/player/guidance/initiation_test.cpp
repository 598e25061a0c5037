// Tests of help for trainees who do not start, and of partial repetitions, on the simulated device.
#include "control/path/arc_path.h"
#include "control/path/shapes.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/guidance/guide.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <algorithm>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::TempFolder;
using testing::HasSubstr;

/// Returns a reach of 50 mm in 3 s.
Path reach() {
  Path path = make_shape("reach", {.size = 0.05, .duration = 3});
  path.name = "reach";
  return path;
}

struct Reached {
  GuideResult result;
  double push = 0;  ///< largest force along the path after the approach's force has faded [N]
  Log log;
};

/// Guides a simulated hand with this option of the device along the reach.
Reached reached(const std::string& hand, GuideOptions options) {
  const auto device = open_device("sim:preset=omega3,seed=3," + hand);
  Reached reached;
  options.sinks.push_back(&reached.log);
  options.radius = 0.02;
  reached.result = guide(*device, plan_guidance(device->info(), source_of(reach()), options), options, StopRequest{});
  const Path path = reach();
  const Vec3 along = (path.position.back() - path.position.front()).normalized();
  double begun = -1;
  for (const Sample& sample : reached.log.samples) {
    if (sample.phase != Phase::run) continue;
    const double time = 1e-9 * static_cast<double>(sample.time_ns);
    if (begun < 0) begun = time;
    if (time > begun + 0.4) reached.push = std::max(reached.push, sample.force.dot(along));
  }
  return reached;
}

GuideOptions initiating(double time_limit = 12) {
  GuideOptions options{.initiate = BackWallOptions{}};
  options.guidance.time_limit = time_limit;
  return options;
}

/// Returns the option of a hand that intends to reach after `wait` [s]. The approach takes 0.5 to 2 s of it.
std::string intent_after(const TempFolder& folder, double wait) {
  Path path = reach();
  path.velocity.clear();
  for (double& t : path.time) t += wait;
  path.time.insert(path.time.begin(), 0);
  path.position.insert(path.position.begin(), path.position.front());
  const std::string file = folder / fmt::format("intent-{}.csv", wait);
  save_path(path, file, "intent", true);
  return "hand=firm,intent=" + file;
}

TEST(Initiation, BringsAHandThatNeverStartsToTheEndOfThePath) {
  // Without tremor and drift, which would start the movement.
  const TempFolder folder;
  std::ofstream(folder / "calm.json") << R"({"hand": {"preset": "relaxed", "tremor": 0, "drift": 0}})";
  const std::string hand = "spec=" + (folder / "calm.json");
  const Reached helped = reached(hand, initiating(20)), alone = reached(hand, [] {
                                                          GuideOptions options{.pace = PaceHelpOptions{}};
                                                          options.guidance.time_limit = 20;
                                                          return options;
                                                        }());
  EXPECT_EQ(helped.result.session.servo.cause, StopCause::finished) << helped.result.session.servo.detail;
  ASSERT_TRUE(helped.result.last.initiation);
  EXPECT_EQ(helped.result.last.initiation->initiator, Initiator::helped);
  EXPECT_GT(helped.result.last.initiation->waited, 2);
  EXPECT_GT(helped.result.last.initiation->work, 1e-3);
  EXPECT_FALSE(helped.result.last.partial);
  EXPECT_GT(helped.result.last.completion, 0.95);
  EXPECT_LE(helped.result.energy_given, helped.result.energy_budget);
  // Help that depends on the expert's speed is zero at the start.
  EXPECT_TRUE(alone.result.last.partial);
  EXPECT_LT(alone.result.last.completion, 0.3);
  EXPECT_FALSE(alone.result.last.initiation);
}

TEST(Initiation, DoesNotTakeThePassiveArmOfAnyDeviceForOneThatStarts) {
  for (const char* preset : {"omega3", "falcon", "touch", "sigma7", "inverse3"})
    for (const char* hand : {"relaxed", "firm"}) {
      const auto device = open_device(fmt::format("sim:preset={},hand={},seed=3", preset, hand));
      GuideOptions options = initiating(8);
      options.fit = true;
      const GuideResult result =
          guide(*device, plan_guidance(device->info(), source_of(reach()), options), options, StopRequest{});
      ASSERT_TRUE(result.last.initiation) << preset << " " << hand;
      EXPECT_NE(result.last.initiation->initiator, Initiator::self)
          << preset << " " << hand << " after " << result.last.initiation->waited;
    }
}

TEST(Initiation, IsNotFeltByATraineeWhoStarts) {
  const TempFolder folder;
  for (const double wait : {0.6, 1.5}) {
    GuideOptions with = initiating();
    with.stiffness = 100;
    const Reached trainee = reached(intent_after(folder, wait), with);
    ASSERT_TRUE(trainee.result.last.initiation);
    EXPECT_EQ(trainee.result.last.initiation->initiator, Initiator::self) << wait;
    EXPECT_LT(trainee.push, 1e-3) << wait;
    EXPECT_EQ(trainee.result.last.initiation->work, 0) << wait;
    EXPECT_FALSE(trainee.result.last.partial);
  }
}

TEST(Initiation, CountsAHandThatIsTooWeakAsPartialAndSaysSo) {
  const TempFolder folder;
  GuideOptions options = initiating(6);
  options.initiate->max_force = 0.3;
  options.guidance.repetitions = 2;
  options.session.recording = SessionOptions::Recording{.file = folder / "weak.h5"};
  const Reached weak = reached("hand=tense", options);
  ASSERT_EQ(weak.result.repetitions.size(), 2U);
  for (const GuideFigures& figures : weak.result.repetitions) {
    EXPECT_TRUE(figures.partial);
    EXPECT_LT(figures.completion, 0.2);
    ASSERT_TRUE(figures.initiation);
    EXPECT_EQ(figures.initiation->initiator, Initiator::none);
    EXPECT_NEAR(figures.initiation->waited, 6, 0.1);
  }
  EXPECT_NEAR(weak.push, 0.3, 0.02);
  const nlohmann::json json = to_json(weak.result);
  EXPECT_EQ(json["partial"], true);
  EXPECT_LT(json["completion"], 0.2);
  EXPECT_EQ(json["initiation"]["initiator"], "none");
  EXPECT_TRUE(json["repetitions"][0]["initiation"].contains("wall_work_j"));
  const std::vector<StoredEvent> events = RecordingReader(folder / "weak.h5").events();
  const auto told = std::count_if(events.begin(), events.end(), [](const StoredEvent& event) {
    return event.code == static_cast<std::int32_t>(EventCode::initiation) &&
           event.text.find("did not start within 6.0") != std::string::npos;
  });
  EXPECT_EQ(told, 2);
}

TEST(Initiation, StaysWithinTheContinuousForceAndTheStableStiffnessOfTheDevice) {
  const auto device = open_device("sim:preset=touch");
  GuideOptions options{.initiate = BackWallOptions{.stiffness = 5000}};
  const GuidePlan plan = plan_guidance(device->info(), source_of(reach()), options);
  ASSERT_TRUE(plan.initiate);
  EXPECT_EQ(plan.initiate->max_force, 0.88);
  EXPECT_EQ(plan.initiate->stiffness, plan.largest_stiffness);
  EXPECT_THAT(plan.notes, testing::Contains(HasSubstr("the wall behind the hand pushes with at most 0.88 N")));
  options.guidance.cursor = true;
  EXPECT_THAT(error_of([&] { (void)plan_guidance(device->info(), source_of(reach()), options); }),
              HasSubstr("leave out --initiate"));
}

TEST(PartialRepetitions, RankBelowEveryFinishedOne) {
  GuideFigures bad{.tracking = {.rms_error = 0.02}, .completion = 1}, good = bad;
  good.tracking.rms_error = 0.001;
  GuideFigures half{.tracking = {.rms_error = 1e-4}, .completion = 0.5, .partial = true}, most = half;
  most.completion = 0.9;
  EXPECT_TRUE(is_better(good, bad));
  EXPECT_TRUE(is_better(bad, most));
  EXPECT_FALSE(is_better(most, bad));
  EXPECT_TRUE(is_better(most, half));
}

}  // namespace
}  // namespace haptrace
