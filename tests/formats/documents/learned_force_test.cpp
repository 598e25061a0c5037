#include "formats/documents/learned_force.h"

#include "control/design/lqg_search.h"
#include "control/path/shapes.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <cmath>
#include <filesystem>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using test::TempFolder;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Matcher;

const DeviceIdentity kDevice{"sim", "Novint Falcon", "1234"};

LearnedPath learned() {
  LearnedPath learned{.device = kDevice,
                      .path_digest = "0123456789abcdef",
                      .speed = 0.5,
                      .mass = Vec3(0.4, 0.5, 0.6),
                      .repetitions = 4,
                      .rms_error = 5e-5,
                      .created = "2026-01-02T03:04:05Z",
                      .software = "haptrace",
                      .table = {.step = 0.002, .force = {}}};
  for (int i = 0; i < 100; ++i) learned.table.force.emplace_back(0.1 * i, -0.0123 * i, 1e-3);
  return learned;
}

TEST(LearnedForceFile, IsReadBackToATenthOfAMillinewton) {
  const TempFolder folder;
  const std::string file = learned_file(folder / "path.h5", kDevice);
  EXPECT_THAT(file, HasSubstr("path.h5.learned/"));
  EXPECT_FALSE(load_learned(file).has_value()) << "nothing was learned yet";
  save_learned(learned(), file);
  save_learned(learned(), file);  // replaces the file
  const std::optional<LearnedPath> back = load_learned(file);
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(back->device.model, kDevice.model);
  EXPECT_EQ(back->path_digest, learned().path_digest);
  EXPECT_EQ(back->repetitions, 4);
  EXPECT_EQ(back->table.step, 0.002);
  ASSERT_EQ(back->table.force.size(), 100U);
  for (std::size_t i = 0; i < 100; ++i) EXPECT_LT((back->table.force[i] - learned().table.force[i]).norm(), 1e-4);
}

TEST(LearnedForceFile, IsAnotherOneForAPathThatIsChangedBeforeItIsPlayed) {
  const std::string plain = learned_file("path.h5", kDevice), turned = learned_file("path.h5", kDevice, "rotated");
  EXPECT_EQ(learned_file("path.h5", kDevice, ""), plain);
  EXPECT_NE(turned, plain);
  EXPECT_NE(learned_file("path.h5", kDevice, "mirrored"), turned);
  EXPECT_EQ(learned_file("path.h5", kDevice, "rotated"), turned);
  EXPECT_TRUE(turned.starts_with("path.h5.learned/"));
}

TEST(LearnedForceFile, IsSavedInTheWorkingFolderIfItsNameHasNoFolder) {
  const test::TempFolder folder;
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(folder / "");
  save_learned(learned(), "learned.json");
  std::filesystem::current_path(before);
  EXPECT_TRUE(load_learned(folder / "learned.json").has_value());
}

TEST(LearnedForceFile, IsRefusedWithAReasonWhereItDoesNotApply) {
  const LearnedPath l = learned();
  EXPECT_THAT(check_learned(l, kDevice, l.path_digest, 0.5, l.mass, 9), IsEmpty());
  EXPECT_THAT(check_learned(l, {"sim", "Novint Falcon", "5678"}, l.path_digest, 0.5, l.mass, 9), HasSubstr("device"));
  EXPECT_THAT(check_learned(l, kDevice, "other", 0.5, l.mass, 9), HasSubstr("path"));
  EXPECT_THAT(check_learned(l, kDevice, l.path_digest, 1, l.mass, 9), HasSubstr("0.5 times"));
  EXPECT_THAT(check_learned(l, kDevice, l.path_digest, 0.5, 1.3 * l.mass, 9), HasSubstr("another mass"));
  LearnedPath damaged = l;
  damaged.table.force.back() = Vec3(0, -12, 0);
  EXPECT_THAT(check_learned(damaged, kDevice, l.path_digest, 0.5, l.mass, 9), IsEmpty());
  damaged.table.force.back() = Vec3(0, -20, 0);
  EXPECT_THAT(check_learned(damaged, kDevice, l.path_digest, 0.5, l.mass, 9),
              HasSubstr("a force of 20.0 N, far beyond"));
}

TEST(LearnedForceFile, IsRefusedIfItsForcesShakeFasterThanLearningPasses) {
  const LearnedPath l = learned();
  for (const double speed : {0.5, 1.0, 2.0}) {
    SCOPED_TRACE(speed);
    LearnedPath shaking = l, fast = l;
    shaking.speed = fast.speed = speed;
    shaking.table.step = fast.table.step = 0.004;
    shaking.table.force.clear(), fast.table.force.clear();
    std::mt19937 generator(1);
    std::normal_distribution<double> noise;
    for (int i = 0; i < 1000; ++i) {
      shaking.table.force.emplace_back(noise(generator), 0, 0);
      fast.table.force.emplace_back(std::sin(2 * M_PI * kMostLearning / speed * 0.004 * i), 1, 0);  // as it is played
    }
    EXPECT_THAT(check_learned(fast, kDevice, l.path_digest, speed, l.mass, 9), IsEmpty());
    // Steps of 8 ms are no faster than learning.
    EXPECT_THAT(check_learned(shaking, kDevice, l.path_digest, speed, l.mass, 9),
                speed < 1 ? Matcher<std::string>(IsEmpty()) : HasSubstr("shake"));
  }
}

TEST(LearnedForceFile, NamesTheFileAndTheKeyThatIsWrong) {
  const TempFolder folder;
  const auto error = [&](const char* text) {
    return error_of([&] { (void)load_learned(folder.write("l.json", text)); });
  };
  EXPECT_THAT(error("{}"), HasSubstr("haptrace-learned-force"));
  EXPECT_THAT(error(R"({"format": "haptrace-learned-force", "format_version": "2.0"})"), HasSubstr("2.0"));
  const std::string head =
      R"({"format": "haptrace-learned-force", "format_version": "1.0", "speed": 1, "step_s": 0.004, )";
  EXPECT_THAT(error((head + R"("force_n": []})").c_str()), HasSubstr("force_n"));
  EXPECT_THAT(error((head + R"("force_n": [[1, 2, 3], [1, null, 3]]})").c_str()), HasSubstr("force_n[1]"));
  EXPECT_THAT(error((head + R"("force_n": [[1, 2]]})").c_str()), HasSubstr("force_n[0]"));
  EXPECT_THAT(error(R"({"format": "haptrace-learned-force", "format_version": "1.0", "force_n": [[1, 2, 3]]})"),
              HasSubstr("step_s"));
}

TEST(PathDigest, DependsOnTimesAndPositionsOnly) {
  Path circle = make_shape("circle", {.duration = 1});
  const auto digest = [](const Path& path) { return digest_of(*source_of(path)); };
  const std::string before = digest(circle);
  EXPECT_EQ(before.size(), 16U);
  circle.name = "another";
  EXPECT_EQ(digest(circle), before);
  circle.position[500].y() += 1e-9;
  EXPECT_NE(digest(circle), before);
}

}  // namespace
}  // namespace haptrace
