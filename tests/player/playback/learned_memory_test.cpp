#include "player/playback/learned_memory.h"

#include "control/path/shapes.h"
#include "formats/path/path_changing.h"
#include "formats/path/path_stretching.h"
#include "player/playback/reference_stream.h"
#include "tests/player/calibration/identified_device.h"
#include "tests/support/temp_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;

const DeviceIdentity kDevice{"sim", "a device", "7"};
const Vec3 kMass(0.4, 0.4, 0.3);

PlayResult learned_session(const ForceTable& known = {}, double size = 0.04) {
  SimDevice device(test::true_device());
  PlayOptions options = test::everything();
  options.learned = known;
  const Path circle = make_shape("circle", {.size = size, .duration = 1});
  return play(device, plan_playback(device.info(), circle, options), options, StopRequest{});
}

TEST(LearnedMemory, PassesLearnedForcesToTheNextSession) {
  const TempFolder folder;
  const std::string file = folder / "learned.json";
  const PlayResult first = learned_session();
  ASSERT_EQ(first.lessons.size(), 2U);
  const PathSource& path = first.plan.path->source();
  LearnedMemory memory(file, kDevice, 1, kMass);
  EXPECT_TRUE(memory.recall(path).table.force.empty()) << "nothing was kept yet";
  EXPECT_EQ(memory.recall(path).refused, "");
  memory.keep(first);
  EXPECT_EQ(load_learned(file)->repetitions, 2);

  LearnedMemory later(file, kDevice, 1, kMass);
  const LearnedMemory::Recalled recalled = later.recall(path);
  EXPECT_EQ(recalled.refused, "");
  ASSERT_EQ(recalled.table.force.size(), first.learned.force.size());
  const PlayResult second = learned_session(recalled.table);
  EXPECT_LT(second.repetitions.front().rms_error, 0.8 * first.repetitions.front().rms_error);
  later.keep(second);
  EXPECT_GT(load_learned(file)->repetitions, 2) << "on top of those before";
}

TEST(LearnedMemory, PlansAgainWithTheForcesThatItRecalls) {
  const TempFolder folder;
  SimDevice device(test::true_device());
  PlayOptions options = test::everything();
  const std::shared_ptr<const PathSource> path = source_of(make_shape("circle", {.size = 0.04, .duration = 1}));
  PlayPlan plan = plan_playback(device.info(), path, options);
  EXPECT_FALSE(learned_memory_of(device.info(), {}, folder / "learned.json")) << "the device is not identified";
  std::optional<LearnedMemory> memory = learned_memory_of(device.info(), options, folder / "learned.json");
  ASSERT_TRUE(memory);
  EXPECT_EQ(memory->apply(device.info(), path, options, plan), "");
  EXPECT_TRUE(options.learned.force.empty()) << "nothing was kept yet";
  const PlayResult result = play(device, plan, options, StopRequest{});
  memory->keep(result);

  options.learn = 0;
  plan = plan_playback(device.info(), path, options);
  EXPECT_FALSE(plan.composed.learning);
  EXPECT_EQ(memory->apply(device.info(), path, options, plan), "");
  EXPECT_EQ(options.learned.force.size(), result.learned.force.size());
  EXPECT_TRUE(plan.composed.learning);
}

TEST(LearnedMemory, CountsOnlyTheRepetitionsThatItRecalled) {
  const TempFolder folder;
  const PlayResult session = learned_session();
  for (int i = 0; i < 2; ++i) LearnedMemory(folder / "learned.json", kDevice, 1, kMass).keep(session);
  EXPECT_EQ(load_learned(folder / "learned.json")->repetitions, 2);
}

TEST(LearnedMemory, RejectsForcesLearnedOnThePathBeforeItWasTurnedMovedOrStretched) {
  const TempFolder folder;
  const PlayResult session = learned_session();
  LearnedMemory memory(folder / "learned.json", kDevice, 1, kMass);
  memory.keep(session);
  const std::shared_ptr<const PathSource> path = source_of(make_shape("circle", {.size = 0.04, .duration = 1}));
  EXPECT_EQ(memory.recall(*path).refused, "");
  std::vector<PathChange> changes(4);
  changes[0].rotation = parse_rotation("z=180deg");
  changes[1].mirror = 0;
  changes[2].offset = Vec3(1e-3, 0, 0);
  changes[3].scale = 0.99;
  for (const PathChange& change : changes) {
    const auto recalled = memory.recall(*changed(path, similarity_of(change, *path)));
    EXPECT_TRUE(recalled.table.force.empty());
    EXPECT_THAT(recalled.refused, HasSubstr("it was learned on another path")) << describe(change);
  }
  EXPECT_THAT(memory.recall(*stretched(path, {0.1, {1, 1.5, 1}})).refused, HasSubstr("another path"));
}

TEST(LearnedMemory, RejectsForcesLearnedUnderOtherConditionsAndRestarts) {
  const TempFolder folder;
  const std::string file = folder / "learned.json";
  const PlayResult session = learned_session(), other = learned_session({}, 0.05);
  LearnedMemory(file, kDevice, 1, kMass).keep(session);
  const auto refused = [&](const DeviceIdentity& device, double speed, const Vec3& mass, const PlayResult& played) {
    LearnedMemory memory(file, device, speed, mass);
    const LearnedMemory::Recalled recalled = memory.recall(played.plan.path->source());
    EXPECT_TRUE(recalled.table.force.empty());
    EXPECT_THAT(recalled.refused, HasSubstr(file));
    return recalled.refused;
  };
  EXPECT_THAT(refused({"sim", "a device", "8"}, 1, kMass, session), HasSubstr("another device"));
  EXPECT_THAT(refused(kDevice, 0.5, kMass, session), HasSubstr("speed"));
  EXPECT_THAT(refused(kDevice, 1, 2 * kMass, session), HasSubstr("a later calibration"));
  EXPECT_THAT(refused(kDevice, 1, kMass, other), HasSubstr("it was learned on another path"));

  LearnedMemory memory(file, kDevice, 0.5, kMass);
  (void)memory.recall(session.plan.path->source());
  memory.keep(session);
  EXPECT_EQ(load_learned(file)->repetitions, 2) << "rejected repetitions do not count";

  (void)folder.write("learned.json", "{\"format\": 1");
  EXPECT_THAT(refused(kDevice, 1, kMass, session), HasSubstr("the learned forces are not used"));
}

}  // namespace
}  // namespace haptrace
