// Tests of the expert's force: recorded with a force sensor on the simulated device, replayed to a trainee.
#include "formats/documents/expert_recording.h"

#include "base/rfc3339.h"
#include "control/path/arc_path.h"
#include "control/path/shapes.h"
#include "control/zero_phase.h"
#include "devices/registry.h"
#include "formats/path/expert_force.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "player/guidance/guide.h"
#include "player/record.h"
#include "scene/scene_file.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/errors.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <optional>

namespace haptrace {
namespace {

using test::error_of;
using test::Log;
using test::TempFolder;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

/// The dynamics of the preset omega3.
PlantModel omega3() {
  PlantModel plant;
  plant.mass = Vec3::Constant(0.22);
  plant.viscous = Vec3::Constant(0.8);
  plant.coulomb = Vec3::Constant(0.15);
  plant.delay = 0.5e-3;
  return plant;
}

/// Returns a movement to and fro along y and z, 60 mm wide, four times in 8 s. It dips to x = `depth` [m].
Path strokes(double depth) {
  Path path;
  path.name = "strokes";
  for (int i = 0; i <= 1600; ++i) {
    const double t = 0.005 * i, turn = std::numbers::pi * t;
    path.time.push_back(t);
    path.position.emplace_back(depth * std::pow(std::sin(0.5 * turn), 2), 0.03 * (1 - std::cos(turn)),
                               0.01 * std::sin(turn));
  }
  return path;
}

/// Records experts, and provides the profile of their device.
class ExpertForces : public testing::Test {
 protected:
  ExpertForces() {
    // Profiles of this machine's user must not matter.
    setenv("HAPTRACE_PROFILES", (folder_ / "none").c_str(), 1);
    std::ofstream(folder_ / "sensor.json") << R"({"force_sensor": true, "noise": {"force": 0.01}})";
  }
  ~ExpertForces() override { unsetenv("HAPTRACE_PROFILES"); }

  /// Records a firm hand that follows the strokes, with or without a surface at x = 0.
  std::string recorded(bool surface) {
    const std::string intent = folder_ / "intent.csv", file = folder_ / (surface ? "task.h5" : "free.h5");
    save_path(strokes(surface ? 0.006 : 0.0), intent, "intent", true);
    const auto device = open_device(
        fmt::format("sim:preset=omega3,hand=firm,seed=5,intent={},spec={}", intent, folder_ / "sensor.json"));
    RecordOptions options{.duration = 8};
    if (surface)
      options.session.touch.scene = read_scene(nlohmann::json::parse(
                                                   R"({"objects": [{"kind": "wall", "name": "table", "point": [0, 0, 0],
                                                       "normal": [-1, 0, 0], "stiffness": 400}]})"),
                                               "table");
    options.session.recording = SessionOptions::Recording{.file = file};
    options.session.recording->options.overwrite = true;
    if (dynamics_) options.session.recording->meta[kDynamicsKey] = to_json(*dynamics_).dump();
    (void)record(*device, options, StopRequest{});
    return file;
  }

  /// Stores the profile of the expert's device beside its recordings.
  void calibrate(const std::string& file, const std::string& name = "profile.json") {
    const RecordingHeader header = RecordingReader(file).header();
    DeviceProfile profile;
    profile.device = {header.device_backend, header.device_model, header.device_serial};
    profile.facts = {12, 1e-5, {Vec3::Constant(-0.05), Vec3::Constant(0.05)}};
    profile.created = rfc3339(std::chrono::system_clock::now());
    profile.software = "haptrace";
    profile.plant = omega3();
    profile.design = test::identified(omega3()).design;
    save_profile(profile, folder_ / name, true);
  }

  TempFolder folder_;
  std::optional<DeviceDynamics> dynamics_;  ///< that the recordings hold
};

/// Returns the forces of a path, low-passed as task_force() does.
std::vector<Vec3> smooth_forces(const PathSource& path) {
  std::vector<Vec3> forces = path.read(0, path.facts().rows).force;
  zero_phase_low_pass(forces, kExpertForceCutoff, static_cast<double>(path.facts().rows - 1) / path.facts().duration());
  return forces;
}

/// Returns the rms difference of two columns over the rms of the second one.
double relative_error(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < b.size(); ++i) {
    difference += (a[i] - b[i]).squaredNorm();
    size += b[i].squaredNorm();
  }
  return std::sqrt(difference / size);
}

TEST_F(ExpertForces, AreThoseOfTheTaskByTheModelThatTheRecordingHolds) {
  const std::string file = recorded(true);
  calibrate(file);
  const ExpertRecording beside = open_expert(file, {});
  const DeviceProfile profile = load_profile(folder_ / "profile.json");
  std::filesystem::remove(folder_ / "profile.json");
  EXPECT_EQ(open_expert(file, {}).force, ReplayedForce::sent) << "without a model";
  dynamics_ = DeviceDynamics::of(profile);
  const ExpertRecording held = open_expert(recorded(true), {});
  EXPECT_EQ(held.force, ReplayedForce::task);
  EXPECT_THAT(held.warnings, IsEmpty());
  EXPECT_THAT(held.notes, Contains(testing::AllOf(HasSubstr("less the model of Force Dimension omega.3"),
                                                  HasSubstr("(as the recording states)"))));
  const std::vector<Vec3> a = beside.path->read(0, 5000).force, b = held.path->read(0, 5000).force;
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_LT((a[i] - b[i]).norm(), 1e-9);
  dynamics_->in_a_hand = true;
  EXPECT_THAT(open_expert(recorded(true), {}).warnings, Contains(HasSubstr("was calibrated in a hand")));
}

TEST_F(ExpertForces, AreThoseOfTheTaskAndNotTheDragOfTheExpertsDevice) {
  const std::string file = recorded(true);
  calibrate(file);
  // In the simulation the force of the task is known: that of the surface, which the device sent.
  const std::vector<Vec3> truth = smooth_forces(*open_path(file));
  const ExpertRecording task = open_expert(file, {});
  EXPECT_EQ(task.force, ReplayedForce::task);
  EXPECT_THAT(task.warnings, IsEmpty());
  EXPECT_THAT(task.notes, Contains(HasSubstr("less the model of Force Dimension omega.3")));
  EXPECT_LT(relative_error(task.path->read(0, task.path->facts().rows).force, truth), 0.08);

  const ExpertRecording measured = open_expert(file, {.force = ReplayedForce::measured});
  EXPECT_GT(relative_error(measured.path->read(0, measured.path->facts().rows).force, truth), 0.3);
  EXPECT_THAT(measured.warnings, Contains(HasSubstr("the trainee's device adds its own")));

  // Pieces are as the whole.
  const Path whole = task.path->read(0, task.path->facts().rows), piece = task.path->read(3000, 1000);
  ASSERT_EQ(piece.size(), 1000U);
  for (std::size_t i = 0; i < piece.size(); ++i) ASSERT_LT((piece.force[i] - whole.force[3000 + i]).norm(), 2e-3) << i;
}

TEST_F(ExpertForces, ReachTheTraineeAsTheTaskAlone) {
  const std::string file = recorded(true);
  calibrate(file);
  const auto device = open_device(fmt::format("sim:preset=omega3,hand=firm,seed=8,intent={}", folder_ / "intent.csv"));
  GuideOptions options{.radius = 0.02};
  options.guidance.time_limit = 14;
  Log log;
  options.sinks.push_back(&log);
  const GuidePlan sent = plan_guidance(device->info(), open_path(file), options);
  const GuidePlan task = plan_guidance(device->info(), open_expert(file, {}).path, options);
  (void)guide(*device, task, options, StopRequest{});
  double difference = 0, size = 0;
  int samples = 0;
  for (const Sample& sample : log.samples) {
    if (sample.phase != Phase::run || sample.time_ns < 2'600'000'000) continue;
    const Vec3 truth = sent.path->at(sample.progress).force;
    difference += (sample.force - truth).squaredNorm();
    size += truth.squaredNorm();
    ++samples;
  }
  EXPECT_GT(samples, 2000);
  EXPECT_LT(std::sqrt(difference / size), 0.10);
}

TEST_F(ExpertForces, AreTheSentOnesWithAWarningIfTheModelOfTheExpertsDeviceIsUnknown) {
  const std::string file = recorded(true);
  const ExpertRecording sent = open_expert(file, {});
  EXPECT_EQ(sent.force, ReplayedForce::sent);
  EXPECT_THAT(sent.warnings, Contains(HasSubstr("its measured force is not replayed, but the sent force")));
  EXPECT_THAT(sent.warnings, Contains(HasSubstr("--expert-profile")));
  EXPECT_EQ(sent.path->read(0, 3000).force, open_path(file)->read(0, 3000).force);
  EXPECT_THAT(open_expert(file, {.force = ReplayedForce::sent}).warnings, IsEmpty()) << "as it was requested";
  EXPECT_THAT(error_of([&] { (void)open_expert(file, {.force = ReplayedForce::task}); }), HasSubstr("is unknown"));

  calibrate(file, "elsewhere.json");
  EXPECT_EQ(open_expert(file, {.profile = folder_ / "elsewhere.json"}).force, ReplayedForce::task);
  EXPECT_EQ(open_expert(file, {}, {}, {}, {}, load_profile(folder_ / "elsewhere.json")).force, ReplayedForce::task);
}

TEST_F(ExpertForces, SayThatAnExpertInFreeMovementFeltNothingButTheDevice) {
  const std::string file = recorded(false);
  calibrate(file);
  const ExpertRecording task = open_expert(file, {});
  EXPECT_THAT(task.warnings, Contains(HasSubstr("felt nothing but the device")));
  // After a surface was touched, it does not.
  EXPECT_THAT(open_expert(recorded(true), {}).warnings, Not(Contains(HasSubstr("felt nothing but the device"))));

  // Without a model the sent force remains, which is zero.
  std::filesystem::remove(folder_ / "profile.json");
  const test::PointMass device;
  const GuidePlan plan = plan_guidance(device.info(), open_expert(file, {}).path, {});
  EXPECT_THAT(plan.warnings, Contains(HasSubstr("all forces are zero")));
}

TEST_F(ExpertForces, WarnOfASensorWhoseSignIsReversed) {
  const std::string file = recorded(false);
  calibrate(file);
  EXPECT_THAT(open_expert(file, {}).warnings, Not(Contains(HasSubstr("drove the hand"))));
  const ExpertRecording reversed = open_expert(file, {.negated = true});
  EXPECT_THAT(reversed.warnings, Contains(HasSubstr("leave out --negate-measured")));
  EXPECT_THAT(open_expert(file, {.force = ReplayedForce::measured, .negated = true}).warnings,
              Contains(HasSubstr("drove the hand in free movement")));
}

TEST_F(ExpertForces, NameWhatARecordingDoesNotHave) {
  save_path(make_shape("circle", {}), folder_ / "circle.csv", "circle", true);
  EXPECT_THAT(error_of([&] { (void)open_expert(folder_ / "circle.csv", {.force = ReplayedForce::task}); }),
              HasSubstr("has no measured force; leave out --expert-force task"));
  EXPECT_THAT(open_expert(folder_ / "circle.csv", {}).warnings, IsEmpty());
  EXPECT_THAT(error_of([] { (void)parse_replayed_force("tsk"); }), HasSubstr("task"));
}

TEST_F(ExpertForces, NoteOptionsWithoutEffectAndReadAProfileInAnyCase) {
  const std::string circle = folder_ / "circle.csv", task = recorded(true);
  save_path(make_shape("circle", {}), circle, "circle", true);
  calibrate(task, "elsewhere.json");
  const std::string profile = folder_ / "elsewhere.json";
  EXPECT_THAT(open_expert(circle, {.negated = true}).notes,
              Contains(HasSubstr("--negate-measured has no effect: the recording has no measured force")));
  EXPECT_THAT(open_expert(circle, {.profile = profile}).notes, Contains(HasSubstr("--expert-profile has no effect")));
  EXPECT_THAT(open_expert(task, {.force = ReplayedForce::sent, .profile = profile}).notes,
              Contains(HasSubstr("--expert-profile has no effect: the sent force is replayed")));
  EXPECT_THAT(open_expert(task, {.profile = profile, .negated = true}).notes, Not(Contains(HasSubstr("no effect"))));
  EXPECT_THAT(error_of([&] { (void)open_expert(circle, {.profile = folder_ / "none.json"}); }), HasSubstr("none.json"));
}

TEST(ForceSurvey, DoesNotCountTheWeightOfTheDeviceAsItsDrag) {
  Path measured = strokes(0.006), sent = measured;
  sent.force.assign(sent.size(), Vec3::Zero());
  measured.force.assign(measured.size(), Vec3(0.4, 0, -2));
  HandleForce handle;
  handle.plant.gravity = Vec3(0, 0, -2);
  const ForceSurvey survey = survey_forces(*source_of(sent), source_of(measured), handle);
  EXPECT_NEAR(survey.task, 0.4, 1e-6);
  EXPECT_NEAR(survey.drag, 0, 1e-6);
  EXPECT_FALSE(survey.only_the_device()) << "0.4 N of the task beside 2 N of weight";
}

TEST(ForceSurvey, JudgesOnlyMovementsToAndFro) {
  ForceSurvey survey{.path_length = 0.4, .displacement = 0.01, .work = 0.05, .effort = 0.06};
  EXPECT_TRUE(survey.drives_the_hand());
  survey.displacement = 0.3;
  EXPECT_FALSE(survey.drives_the_hand()) << "the weight of the device may have driven it";
  survey = {.path_length = 0.4, .displacement = 0.01, .work = -0.05, .effort = 0.06};
  EXPECT_FALSE(survey.drives_the_hand());
}

}  // namespace
}  // namespace haptrace
