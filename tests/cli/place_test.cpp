// Tests of the options that place a path, and of gains along it.
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <algorithm>
#include <fmt/format.h>
#include <fstream>

namespace haptrace {
namespace {

std::string circle(const TempFolder& folder) {
  const std::string file = folder / "circle.csv";
  EXPECT_EQ(haptrace("shape", "circle", "--size", "40mm", "--duration", "1", "-o", file).exit_code, 0);
  return file;
}

/// Expects that two paths have the same positions.
void expect_same(const std::string& one, const std::string& other, double tolerance = 1e-9) {
  const Path a = load_path(one), b = load_path(other);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) ASSERT_LT((a.position[i] - b.position[i]).norm(), tolerance) << i;
}

TEST(Place, OfAPlaybackIsInTheRecordingAndInfoPrintsIt) {
  const TempFolder folder;
  const std::string path = circle(folder), out = folder / "played.h5";
  const Answer answer = haptrace("play", path, "-d", kFalcon, "--no-profile", "--rotate", "x=90deg", "--mirror", "y",
                                 "--scale", "0.5", "--about", "centre", "--offset", "10mm,0,0", "--record", out);
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const std::string what =
      "mirrored in y, rotated by 90 degrees about x, scaled by 0.5 about its centre, moved by 10, 0, 0 mm";
  EXPECT_THAT(answer.out, HasSubstr("path: " + what));
  const nlohmann::json info = haptrace("info", out, "--json").json();
  EXPECT_EQ(info["meta"]["path_change"], what);
  EXPECT_THAT(haptrace("info", out).out, HasSubstr(what));
  Box reference;
  const RecordingReader reader(out);
  for (const Sample& sample : reader.read(0, reader.rows()))
    if (sample.phase == Phase::run) reference.include(sample.reference_position);
  EXPECT_NEAR(reference.size().x(), 0.02, 1e-4);
  EXPECT_NEAR(reference.size().z(), 0.02, 1e-4);
  EXPECT_NEAR(reference.size().y(), 0, 1e-6);
}

TEST(Place, OfAPathCanBeWhereTheToolIs) {
  const TempFolder folder;
  const std::string path = circle(folder), out = folder / "played.h5";
  const Answer answer = haptrace("play", path, "-d", kFalcon, "--no-profile", "--start-here", "--record", out);
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const RecordingReader reader(out);
  const std::vector<Sample> samples = reader.read(0, reader.rows());
  const auto run = std::find_if(samples.begin(), samples.end(), [](const Sample& s) { return s.phase == Phase::run; });
  ASSERT_NE(run, samples.end());
  EXPECT_LT((run->reference_position - samples.front().position).norm(), 5e-4);
  for (const char* other : {"--fit", "--offset=1mm,0,0"}) {
    const Answer both = haptrace("play", path, "-d", kFalcon, "--start-here", other);
    EXPECT_EQ(both.exit_code, 2);
    EXPECT_THAT(both.err, HasSubstr("both decide where the path lies"));
  }
  EXPECT_THAT(haptrace("play", path, "-d", kFalcon, "--start-here", "--learn", "2").err, HasSubstr("needs --learned"));
}

TEST(Place, IsTheSameInPlayShapeAndConvert) {
  const TempFolder folder;
  const std::string path = circle(folder), placed = folder / "placed.csv", converted = folder / "converted.csv";
  const std::vector<std::string> options{"--mirror", "x",   "--rotate", "1,2,3=50deg",
                                         "--scale",  "1.5", "--about",  "start"};
  const auto run = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Answer answer = Command(arguments).wait();
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
  };
  run({"shape", "circle", "--size", "40mm", "--duration", "1", "-o", placed});
  run({"convert", path, "-o", converted});
  expect_same(placed, converted);
}

TEST(Place, InTheWorldIsUndoneByPlayingWithTheSameFrame) {
  const TempFolder folder;
  const std::string path = circle(folder), world = folder / "world.csv", out = folder / "played.h5";
  const std::string frame =
      folder.write("frame.json", R"({"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation": [1, 2, 0.5]})");
  ASSERT_EQ(haptrace("convert", path, "-o", world, "--frame", frame).exit_code, 0);
  const Path there = load_path(world), here = load_path(path);
  EXPECT_LT(
      (there.position[7] - Vec3(1 - here.position[7].y(), 2 + here.position[7].x(), 0.5 + here.position[7].z())).norm(),
      1e-9);
  const Answer outside = haptrace("play", world, "-d", kFalcon, "--no-profile");
  EXPECT_EQ(outside.exit_code, 2);
  EXPECT_THAT(outside.err, AllOf(HasSubstr("leaves the workspace"), HasSubstr("the workspace from")));
  const Answer answer = haptrace("play", world, "-d", kFalcon, "--no-profile", "--frame", frame, "--record", out);
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(haptrace("info", out).out, HasSubstr("brought from the world's to the device's coordinates"));
}

TEST(Place, NamesTheInvalidOption) {
  const TempFolder folder;
  const std::string path = circle(folder);
  const auto error = [&](const std::string& option, const std::string& value) {
    const Answer answer = haptrace("play", path, "-d", kFalcon, option, value);
    EXPECT_EQ(answer.exit_code, 2) << option << " " << value;
    return answer.err;
  };
  EXPECT_THAT(error("--rotate", "90deg"), AllOf(HasSubstr("--rotate"), HasSubstr("z=90deg")));
  EXPECT_THAT(error("--rotate", "z=nan"), HasSubstr("no valid angle"));
  EXPECT_THAT(error("--mirror", "w"), AllOf(HasSubstr("--mirror"), HasSubstr("'w'")));
  EXPECT_THAT(error("--scale", "0"), HasSubstr("the scale of a path is 0; it must be from 0.01 to 100"));
  EXPECT_THAT(error("--about", "end"), AllOf(HasSubstr("--about"), HasSubstr("centre")));
  EXPECT_THAT(error("--offset", "1,2"), AllOf(HasSubstr("--offset"), HasSubstr("three numbers")));
  EXPECT_THAT(error("--offset", "1kg,0,0"), HasSubstr("unit of m"));
  EXPECT_THAT(error("--offset", "50,0,0"), HasSubstr("20mm"));
  EXPECT_THAT(error("--frame", folder.write("f.json", R"({"rotation": [[2,0,0],[0,1,0],[0,0,1]]})")),
              AllOf(HasSubstr("--frame"), HasSubstr("f.json"), HasSubstr("does not scale")));
  EXPECT_THAT(error("--kp", "1,2"), HasSubstr("--kp"));
  EXPECT_THAT(error("--impedance", folder.write("i.json", R"({"s": [0]})")), HasSubstr("i.json"));
}

TEST(Place, OfAProgrammeHasTheKeysOfPlay) {
  const TempFolder folder;
  const std::string path = circle(folder);
  const std::string programme = folder.write("p.json", R"({"haptrace_programme": 1, "exercises": [
      {"path": "circle.csv", "mode": "passive", "rotate": "x=90deg", "about": "centre", "offset": [0, 0.01, 0]}]})");
  const Answer answer = haptrace("run", programme, "-d", kFalcon, "--no-profile", "--rotate", "z=10deg", "--offset",
                                 "1mm,0,0", "-o", folder / "session");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json log = nlohmann::json::parse(std::ifstream(folder / "session/session.json"));
  EXPECT_EQ(log["programme"]["person"]["rotate"], "z=10deg");
  EXPECT_EQ(log["programme"]["person"]["offset"][0], 0.001);
  EXPECT_THAT(haptrace("run", programme, "--rotate", "up", "--dry-run").err, HasSubstr("--rotate"));
}

TEST(Gains, CanDifferByAxisAndHaveAUnit) {
  const TempFolder folder;
  const std::string path = circle(folder);
  const Answer answer =
      haptrace("play", path, "-d", kFalcon, "--no-profile", "--kp", "1N/mm,800,600", "--kd", "10,8,6", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["gains"]["kp"], nlohmann::json({1000, 800, 600}));
  EXPECT_EQ(answer.json()["gains"]["kd"], nlohmann::json({10, 8, 6}));
}

TEST(Gains, CanBeColumnsOfThePathItself) {
  const TempFolder folder;
  const std::string path = folder.write("line.csv", "t,x,y,z,kp\n5,0,0,0,300\n5.5,0.005,0,0,900\n6,0.01,0,0,300\n");
  const Answer answer = haptrace("play", path, "-d", kFalcon, "--no-profile", "--impedance", path, "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["gains"]["kp"][0], 900);
  EXPECT_NEAR(answer.json()["gains"]["kd"][0], 10.8, 1e-9);
}

}  // namespace
}  // namespace haptrace
