// Tests of --scene: a hand touches the objects of a scene file while it records, plays or is guided.
#include "base/json_reader.h"
#include "formats/recording/recording.h"
#include "metrics/touches.h"
#include "report/recording_figure.h"
#include "tests/cli/command.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <sys/stat.h>

namespace haptrace {
namespace {

TEST(SceneCommand, ShowsOnATerminalThatItReadsAFile) {
  const TempFolder folder;
  const std::string slow = folder / "slow.json";  // a pipe, whose text comes late
  ASSERT_EQ(mkfifo(slow.c_str(), 0600), 0);
  Command command({"scene", slow}, Command::Input::terminal);
  ASSERT_TRUE(command.says("reading "));
  std::ofstream(slow) << load_text(std::string(HAPTRACE_SAMPLES) + "/scenes/sphere.json");
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.out, HasSubstr("valid"));
}

TEST(RecordScene, LetsAHandTouchTheObjectsOfAFileAndReportsTheTouches) {
  const TempFolder folder;
  const std::string scenes = std::string(HAPTRACE_SAMPLES) + "/scenes/";
  const std::string device = "sim:preset=omega3,hand=firm,seed=1,intent=" +
                             folder.write("press.csv", "t,x,y,z\n0,0,0,0.04\n1,0,0,0.024\n2,0.01,0,0.024\n");
  const Answer felt =
      haptrace("record", folder / "a.h5", "--device", device, "--scene", scenes + "sphere.json", "--json");
  ASSERT_EQ(felt.exit_code, 0) << felt.err;
  const nlohmann::json touch = felt.json()["touches"][0];
  EXPECT_EQ(touch["object"], "ball");
  EXPECT_EQ(touch["times"], 1);
  EXPECT_NEAR(touch["max_force_n"].get<double>(), 800 * touch["max_depth_m"].get<double>(), 1e-9);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().config["scene"], scenes + "sphere.json");
  for (const Sample& row : reader.read(1000, 900)) EXPECT_GT(row.force.norm(), 1);
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);

  // The recording gives the same figures as the session.
  const std::vector<TouchFigures> recorded = touch_figures(reader);
  ASSERT_EQ(recorded.size(), felt.json()["touches"].size());
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    const nlohmann::json told = felt.json()["touches"][i];
    EXPECT_EQ(recorded[i].name, told["object"]);
    EXPECT_EQ(recorded[i].times, told["times"]);
    EXPECT_NEAR(recorded[i].seconds, told["seconds"], 0.002 * (1 + recorded[i].times));
    EXPECT_DOUBLE_EQ(recorded[i].max_force, told["max_force_n"]);
    EXPECT_DOUBLE_EQ(recorded[i].max_depth, told["max_depth_m"]);
  }
  const Figure figure = figure_of(reader, "felt");
  EXPECT_EQ(figure.rows.size(), 4U);
  EXPECT_EQ(figure.rows.back()[0].title, "depth in touched objects");
  double deepest = 0;
  for (const Series& line : figure.rows.back()[0].series)
    for (const double depth : line.y) deepest = std::max(deepest, depth);
  EXPECT_DOUBLE_EQ(deepest, 1e3 * recorded[0].max_depth);
  EXPECT_EQ(figure.rows[0][0].series.back().label, "proxy");
  ASSERT_EQ(haptrace("report", folder / "a.h5", "-o", folder / "a.html").exit_code, 0);
  EXPECT_THAT(load_text(folder / "a.html"), HasSubstr("Touched objects"));
  EXPECT_THAT(load_text(folder / "a.html"), testing::Not(HasSubstr("the disk has room"))) << "a note is no warning";

  const Answer slow = haptrace("record", folder / "b.h5", "--device", device, "--scene", scenes + "sphere_on_wall.json",
                               "--scene-rate", "300", "--json");
  ASSERT_EQ(slow.exit_code, 0) << slow.err;
  EXPECT_THAT(slow.err, AllOf(HasSubstr("the last force is held"), HasSubstr("333.3 Hz, every 3 ticks")));
  EXPECT_EQ(slow.json()["touches"].size(), 2U);
  EXPECT_EQ(slow.json()["notes"].size(), 2U);
}

/// Checks that a verb with a scene reports its errors. `start` holds the verb and options that make it run; it writes
/// a.h5.
void report_errors(const std::vector<std::string>& start, const TempFolder& folder) {
  const auto refused = [&](const std::vector<std::string>& words) {
    std::vector<std::string> all = start;
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = Command(all).wait();
    EXPECT_EQ(answer.exit_code, 2);
    EXPECT_FALSE(std::filesystem::exists(folder / "a.h5"));
    return answer.err;
  };
  const std::string far =
      folder.write("far.json", R"({"objects": [{"kind": "sphere", "name": "moon", "centre": [1, 0, 0], "radius": 0.1,
                                   "stiffness": 100}]})");
  EXPECT_THAT(refused({"--prediction", "model"}), HasSubstr("give a --scene as well"));
  EXPECT_THAT(refused({"--scene", far, "--prediction", "model"}), HasSubstr("give its --scene-rate as well"));
  EXPECT_THAT(refused({"--scene", far, "--scene-rate", "2000"}), HasSubstr("from 0.1 to 1000 Hz"));
  EXPECT_THAT(refused({"--scene", far, "--scene-rate", "100", "--prediction", "lines"}), HasSubstr("'linear'"));
  EXPECT_THAT(refused({"--scene", folder.write("bad.json", R"({"objects": [{"kind": "bal"}]})")}),
              AllOf(HasSubstr("bad.json: objects[0].kind"), HasSubstr("known: box, cone")));

  std::vector<std::string> all = start;
  all.insert(all.end(), {"--scene", far});
  const Answer moon = Command(all).wait();
  EXPECT_EQ(moon.exit_code, 0) << moon.err;
  EXPECT_THAT(moon.err, HasSubstr("'moon' lies outside the workspace"));
  EXPECT_THAT(moon.out, HasSubstr("moon: not touched"));
  std::string moons;
  for (int i = 0; i < 9; ++i)
    moons +=
        fmt::format(R"({}{{"kind": "sphere", "name": "m{}", "centre": [1, 0, 0], "radius": 0.1, "stiffness": 100}})",
                    i > 0 ? ", " : "", i);
  all.back() = folder.write("moons.json", R"({"objects": [)" + moons + "]}");
  std::replace(all.begin(), all.end(), folder / "a.h5", folder / "b.h5");
  const Answer many = Command(all).wait();
  EXPECT_THAT(many.err, HasSubstr("9 of 9 objects lie outside the workspace"));
  EXPECT_THAT(many.err, HasSubstr("'m0', 'm1', 'm2', 'm3', ... cannot be touched"));
}

TEST(RecordScene, ReportsErrorsBeforeItWritesAFile) {
  const TempFolder folder;
  report_errors({"record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1"}, folder);
}

TEST(PlayScene, ReportsErrorsBeforeItWritesAFile) {
  const TempFolder folder;
  const std::string path = folder.write("short.csv", "t,x,y,z\n0,0,0,0\n0.1,0.001,0,0\n");
  report_errors({"play", path, "--device", kFalcon, "--no-profile", "--record", folder / "a.h5"}, folder);
}

TEST(GuideScene, ReportsErrorsBeforeItWritesAFile) {
  const TempFolder folder;
  const std::string path = folder.write("short.csv", "t,x,y,z\n0,0,0,0\n0.1,0.001,0,0\n");
  report_errors({"guide", path, "--device", kFalcon, "--no-profile", "--record", folder / "a.h5"}, folder);
}

/// Runs `play` or `guide` with a scene along a path that crosses its ball, and checks everything that keeps contacts.
void touch_along_a_path(const std::vector<std::string>& verb, const TempFolder& folder) {
  const std::string scene = std::string(HAPTRACE_SAMPLES) + "/scenes/sphere.json";
  const std::string path =
      folder.write("press.csv", "t,x,y,z\n0,0,0,0.04\n1,0,0,0.024\n2,0.01,0,0.024\n3,0.01,0,0.04\n");
  std::vector<std::string> words{
      verb[0],         path,      "--device", "sim:preset=omega3,hand=relaxed,seed=1,intent=" + path,
      "--no-profile",  "--scene", scene,      "--record",
      folder / "a.h5", "--json"};
  words.insert(words.end(), verb.begin() + 1, verb.end());
  const Answer felt = Command(words).wait();
  ASSERT_EQ(felt.exit_code, 0) << felt.err;
  const nlohmann::json touch = felt.json()["touches"][0];
  EXPECT_EQ(touch["object"], "ball");
  EXPECT_GE(touch["times"].get<int>(), 1);

  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().config["scene"], scene);
  EXPECT_EQ(reader.header().scene.objects, std::vector<std::string>{"ball"});
  const std::vector<TouchFigures> recorded = touch_figures(reader);
  ASSERT_EQ(recorded.size(), 1U);
  EXPECT_EQ(recorded[0].times, touch["times"]);
  EXPECT_DOUBLE_EQ(recorded[0].max_force, touch["max_force_n"]);
  EXPECT_DOUBLE_EQ(recorded[0].max_depth, touch["max_depth_m"]);
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
  EXPECT_EQ(figure_of(reader, "felt").rows.back()[0].title, "depth in touched objects");
  ASSERT_EQ(haptrace("report", folder / "a.h5", "-o", folder / "a.html").exit_code, 0);
  EXPECT_THAT(load_text(folder / "a.html"), HasSubstr("Touched objects"));
}

TEST(PlayScene, TouchesTheObjectsThatThePathCrossesAndReportsTheTouches) {
  const TempFolder folder;
  touch_along_a_path({"play"}, folder);
}

TEST(GuideScene, TouchesTheObjectsThatThePathCrossesAndReportsTheTouches) {
  const TempFolder folder;
  touch_along_a_path({"guide", "--radius", "20mm", "--time-limit", "10"}, folder);

  // The trial becomes the expert's: its forces hold the contacts.
  const std::string scene = std::string(HAPTRACE_SAMPLES) + "/scenes/sphere.json";
  const std::vector<std::string> again{"guide",        folder / "a.h5", "--device", "sim:preset=omega3",
                                       "--no-profile", "--time-limit",  "1"};
  EXPECT_THAT(Command(again).wait().err, testing::Not(HasSubstr("was recorded with a scene")));
  std::vector<std::string> touching = again;
  touching.insert(touching.end(), {"--scene", scene});
  EXPECT_THAT(Command(touching).wait().err, HasSubstr("was recorded with a scene, so its forces hold the contacts"));
}

}  // namespace
}  // namespace haptrace
