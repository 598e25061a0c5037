// Reaching exercises of programmes: what they mean, and how errors name their keys.
#include "formats/documents/reach_task.h"

#include "base/json_reader.h"
#include "formats/documents/programme.h"
#include "tests/support/errors.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

Programme reaching_programme(const std::string& reach, const std::string& keys = "") {
  return programme_from_json(
      parse_json(fmt::format(R"({{"haptrace_programme": 1, "exercises": [{{"mode": "reach", {} "reach": {{{}}}}}]}})",
                             keys, reach),
                 "p.json"),
      "p.json");
}

const char* const kOneTarget = R"("targets": [[0.08, 0, 0]])";

TEST(ReachTask, HasTargetsFieldAndBlocks) {
  const Programme programme = reaching_programme(
      R"("targets": {"kind": "centre-out", "count": 4, "distance": 0.1}, "plane": "yz", "field": {"curl": 13},
         "start_hold": 0.7, "blocks": [{"name": "a", "reaches": 6}, {"reaches": 9, "field": true, "catches": 0.1}])");
  const Exercise& exercise = programme.exercises.at(0);
  EXPECT_EQ(exercise.repetitions, 15) << "the blocks state the number";
  const ReachTask& task = *exercise.reach;
  ASSERT_EQ(task.targets.size(), 4U);
  EXPECT_TRUE(task.targets[1].isApprox(Vec3(0, 0, 0.1)));
  EXPECT_TRUE(task.field->isApprox(curl_field(13, Vec3::UnitX())));
  EXPECT_EQ(task.least_start_hold, 0.7);
  EXPECT_EQ(task.most_start_hold, 0.7);
  EXPECT_EQ(task.blocks[1].name, "block 2");
  EXPECT_TRUE(programme.is_random()) << "a seed draws the targets, also in the order of the file";
  EXPECT_FALSE(has_tunnel(exercise));
  const Path places = path_of(programme, exercise, ".");
  ASSERT_EQ(places.size(), 8U);
  EXPECT_TRUE(places.position[3].isApprox(task.targets[1])) << "sample 2 k + 1 is target k";
}

TEST(ReachTask, HasOneBlockWithoutAFieldUnlessItStatesBlocks) {
  const Programme programme = reaching_programme(kOneTarget, R"("repetitions": 7,)");
  const ReachTask& task = *programme.exercises.at(0).reach;
  ASSERT_EQ(task.blocks.size(), 1U);
  EXPECT_EQ(task.blocks[0].reaches, 7);
  EXPECT_FALSE(task.blocks[0].field);
  EXPECT_EQ(describe(task, {.target = 0}), "target 1 of 1");
}

TEST(ReachTask, NamesTheKeyThatIsWrong) {
  const auto error = [](const std::string& reach, const std::string& keys = "") {
    return error_of([&] { (void)reaching_programme(reach, keys); });
  };
  EXPECT_THAT(error(""), HasSubstr("exercises[0].reach: 'targets' is missing"));
  EXPECT_THAT(error(R"("targets": [[1, 2]])"), HasSubstr("reach.targets: must be a list of rows of 3 numbers"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "field": {"curl": 1, "matrix": [[0, 1], [1, 0]]})"),
              HasSubstr("reach.field: needs either curl"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "blocks": [{"reaches": 5, "field": true}])"),
              HasSubstr("blocks[0].field: the exercise has no force field; add the key field to reach"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "blocks": [{"reaches": 5, "catches": 0.1}])"),
              HasSubstr("blocks[0].catches: a catch trial turns the field off, and this block has none"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "blocks": [{"reaches": 5}])", R"("repetitions": 5,)"),
              HasSubstr("exercises[0].repetitions: the blocks state the number of reaches"));
  EXPECT_THAT(error(kOneTarget, R"("path": "a.h5",)"), HasSubstr("mode reach has targets and no path"));
  EXPECT_THAT(error(R"("targets": [[0.08, 0, 0], [0.013, 0, 0]])"),
              HasSubstr("reach.targets[1]: is 13.0 mm from the start, within start_radius and target_radius"));
  EXPECT_THAT(error(R"("targets": [[0, 0.01, 0.08]])"), HasSubstr("reach.targets[0]: leads out of the plane xy"));
  EXPECT_NO_THROW((void)reaching_programme(R"("targets": [[0, 0.01, 0.08]], "plane": "yz")", ""));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "start_hold": {"least": 1, "most": 0.5})"),
              HasSubstr("start_hold: least is 1 s, but most is 0.5 s"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "target_hold": 3)"),
              HasSubstr("no reach can end within time_limit (3 s) with a target_hold of 3 s"));
  EXPECT_NO_THROW((void)reaching_programme(std::string(kOneTarget) + R"(, "target_hold": 3)", R"("time_limit": 5,)"));
  EXPECT_THAT(error(std::string(kOneTarget) + R"(, "blocks": [{"reaches": 4, "clamps": 0.1}])"),
              HasSubstr("blocks[0].clamps: 0.1 of 4 reaches is none; raise the share"));
  EXPECT_THAT(error(kOneTarget, R"("radius": 0.01,)"), HasSubstr("exercises[0].radius: does not apply in mode reach"));
  EXPECT_THAT(error_of([] {
                (void)programme_from_json(
                    parse_json(R"({"haptrace_programme": 1, "exercises": [{"mode": "reach"}]})", "p.json"), "p.json");
              }),
              HasSubstr("mode reach needs the key reach"));
}

TEST(ReachTask, KeepsASignWhenItIsMirrored) {
  const Programme programme = reaching_programme(
      std::string(kOneTarget) + R"(, "field": {"curl": 13}, "blocks": [{"reaches": 1, "field": true}])");
  const ReachTask& task = *programme.exercises.at(0).reach;
  const Eigen::Matrix3d mirror = Vec3(-1, 1, 1).asDiagonal();
  const ReachTrial plain = reach_trial(task, {}, Eigen::Matrix3d::Identity(), Vec3::Zero(), Vec3(0.08, 0.03, 0));
  const ReachTrial other = reach_trial(task, {}, mirror, Vec3::Zero(), Vec3(-0.08, 0.03, 0));
  const auto push = [](const ReachTrial& trial) {
    return trial.geometry.lateral.dot(trial.field * trial.geometry.along());
  };
  EXPECT_NEAR(push(plain), -13, 1e-12) << "to the right";
  EXPECT_NEAR(push(other), -13, 1e-12);
}

TEST(ReachTask, ReadsWhatALogAndARecordingKeep) {
  const PlannedReach planned{.target = 3, .block = 1, .kind = ReachKind::catch_trial, .start_hold = 0.625};
  EXPECT_EQ(planned_reach_from(JsonReader(json_of(planned), "log")), planned);
  ReachTrial trial{.geometry = {.start = Vec3(1, 2, 3), .target = Vec3(2, 2, 3), .lateral = Vec3::UnitY()},
                   .kind = ReachKind::clamp,
                   .field = curl_field(-7, Vec3::UnitZ()),
                   .field_block = true};
  const nlohmann::json kept = json_of(trial);
  const ReachTrial read = reach_trial_from(JsonReader(kept, "recording"));
  EXPECT_EQ(json_of(read), kept);
  EXPECT_EQ(read.kind, ReachKind::clamp);
  EXPECT_TRUE(read.field.isApprox(trial.field));
  nlohmann::json damaged = kept;
  damaged["kind"] = "clamps";
  EXPECT_THAT(error_of([&] { (void)reach_trial_from(JsonReader(damaged, "recording")); }),
              HasSubstr("unknown kind of reach 'clamps'"));
}

}  // namespace
}  // namespace haptrace
