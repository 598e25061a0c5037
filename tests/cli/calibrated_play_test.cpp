// Tests from calibration to learned playback, through the command.
#include "tests/cli/command.h"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

namespace haptrace {
namespace {

using testing::Each;
using testing::ElementsAre;

const std::string kFalcon = "sim:preset=falcon,hand=relaxed,seed=2";

/// Provides a path and a calibrated Falcon.
class CalibratedPlay : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(haptrace("shape", "circle", "--size", "0.06", "--duration", "2", "-o", path_).exit_code, 0);
    ASSERT_EQ(run({"calibrate", "--device", "sim:preset=falcon,hand=relaxed", "--quick", "-q"}).exit_code, 0);
  }

  Answer run(const std::vector<std::string>& words) {
    return Command(words, Command::Input::none, {"HAPTRACE_PROFILES=" + folder_.path() + "/profiles"}).wait();
  }
  Answer play(std::vector<std::string> words, const std::string& device = kFalcon) {
    words.insert(words.begin(), {"play", path_, "--device", device, "--json"});
    return run(words);
  }

  /// Changes the only profile in the folder.
  void change_profile(const std::function<void(nlohmann::json&)>& change) {
    const std::filesystem::path file = std::filesystem::directory_iterator(folder_.path() + "/profiles")->path();
    std::ifstream in(file);
    nlohmann::json profile = nlohmann::json::parse(in);
    profile.erase("digest");
    change(profile);
    std::ofstream(file) << profile.dump();
  }

  TempFolder folder_;
  const std::string path_ = folder_ / "circle.h5";
};

TEST_F(CalibratedPlay, FindsTheProfileAndFollowsThreeTimesAsWellAsStiffPd) {
  const nlohmann::json stiff = play({"--no-profile", "--kp", "3000", "--kd", "25"}).json();
  EXPECT_TRUE(stiff["compensations"].empty());
  const nlohmann::json calibrated = play({}).json();
  EXPECT_THAT(calibrated["compensations"], ElementsAre("inertia", "gravity", "friction", "observer"));
  EXPECT_LT(3 * calibrated["rms_error_m"].get<double>(), stiff["rms_error_m"].get<double>());
  EXPECT_THAT(play({"--without", "all"}).json()["compensations"], testing::IsEmpty());
  EXPECT_THAT(play({"--without", "frction"}).err, HasSubstr("did you mean 'friction'"));
}

TEST_F(CalibratedPlay, KeepsInTheProfileThatALawVibratedAndUsesItNoMore) {
  change_profile([](nlohmann::json& profile) {  // its laws are too stiff for the device
    profile["design"]["plain_calm"] = true;
    for (nlohmann::json& mass : profile["held"]["model"]["device"]["mass_kg"]) mass = 8 * mass.get<double>();
  });
  const Answer first = play({"--repeat", "3"});
  EXPECT_THAT(first.err, HasSubstr("the profile refuses it from now on"));
  EXPECT_EQ(first.json()["law"], "lqg");
  EXPECT_EQ(first.json()["pd_after_repetitions"], 1);
  EXPECT_GT(first.json()["gains_in_force"]["kp"][0], 1000) << "those of the PD control that stood in for it";
  EXPECT_LT(3 * first.json()["repetitions"][2]["rms_error_m"].get<double>(),
            first.json()["repetitions"][0]["rms_error_m"].get<double>());
  EXPECT_THAT(first.json()["warnings"].dump(), HasSubstr("law_refused"));

  const Answer second = play({});
  EXPECT_THAT(second.err, testing::AllOf(HasSubstr("in a playback at "), HasSubstr("it vibrated at "),
                                         HasSubstr("plain PD control")));
  EXPECT_EQ(second.json()["law"], "pd");
  EXPECT_EQ(second.json()["vibration"]["share"], 1);
  EXPECT_EQ(play({"--firmness", "normal"}).json()["law"], "lqg") << "what was asked for";

  ASSERT_EQ(run({"calibrate", "--device", "sim:preset=falcon,hand=relaxed", "--quick", "-q"}).exit_code, 0);
  EXPECT_EQ(play({}).json()["law"], "lqg");
}

TEST_F(CalibratedPlay, BoundsARecordingWithASceneByTheMotorsAndSaysSo) {
  change_profile([](nlohmann::json& profile) { profile["plant"]["motor_limit_n"] = 2; });
  const std::string wall = folder_.write(
      "wall.json", R"({"objects": [{"kind": "wall", "point": [0, 0, -0.02], "normal": [0, 0, 1], "stiffness": 500}]})");
  const Answer recorded =
      run({"record", folder_ / "felt.h5", "--device", kFalcon, "--scene", wall, "--duration", "0.5", "--json"});
  ASSERT_EQ(recorded.exit_code, 0) << recorded.err;
  EXPECT_THAT(recorded.err, HasSubstr("at most 2.0 N in its calibration"));
  EXPECT_THAT(recorded.json()["warnings"].dump(), HasSubstr("motor_limit"));
  EXPECT_THAT(run({"info", folder_ / "felt.h5"}).out, HasSubstr("at most 2.0 N"));
}

TEST_F(CalibratedPlay, WarnsOfGainsBeyondTheStabilityLimitBeforeItStarts) {
  const Answer shaky = play({"--kp", "99999", "--kd", "10"});
  EXPECT_THAT(shaky.err, HasSubstr("the gains are above the stability limit of this device (kp "));
  EXPECT_THAT(shaky.json()["notes"].dump(), HasSubstr("it may vibrate"));
  EXPECT_THAT(play({"--kp", "99999", "--kd", "10", "--expert"}).err,
              testing::Not(HasSubstr("stability limit of this")));
  EXPECT_THAT(play({"--kp", "1000", "--kd", "10"}).err, testing::Not(HasSubstr("stability limit of this")));
}

TEST_F(CalibratedPlay, ChoosesAmongTheLawsOfTheProfile) {
  const nlohmann::json normal = play({}).json(), exact = play({"--firmness", "exact"}).json();
  EXPECT_EQ(normal["law"], "lqg");
  EXPECT_EQ(normal["firmness"], "normal");
  EXPECT_LT(exact["rms_error_m"].get<double>(), normal["rms_error_m"].get<double>());
  EXPECT_GT(exact["force_ripple_n"].get<double>(), normal["force_ripple_n"].get<double>());
  EXPECT_EQ(play({"--law", "observer"}).json()["law"], "observer");
  EXPECT_EQ(play({"--kp", "2000", "--kd", "20"}).json()["law"], "observer") << "gains are those of a PD law";
  EXPECT_EQ(play({"--without", "observer"}).json()["law"], "pd");
  EXPECT_THAT(play({"--firmness", "exact", "--kp", "2000", "--kd", "20"}).err, HasSubstr("exclude each other"));
  EXPECT_THAT(play({"--firmness", "exact", "--law", "observer"}).err, HasSubstr("leave out"));
  EXPECT_THAT(play({"--firmness", "exact", "--without", "observer"}).err, HasSubstr("exclude each other"));
  EXPECT_THAT(play({"--firmness", "firm"}).err, HasSubstr("unknown firmness 'firm'"));
  EXPECT_THAT(play({"--law", "lqr"}).err, HasSubstr("did you mean 'lqg'"));
  EXPECT_THAT(play({"--law", "lqg", "--no-profile"}).err, HasSubstr("needs a calibrated device"));
}

TEST_F(CalibratedPlay, StoresTheLearnedForceForThisDeviceAndPathAndForgetsItOnRequest) {
  const nlohmann::json learning = play({"--learn", "3"}).json();
  EXPECT_EQ(learning["repetitions"].size(), 3U);
  EXPECT_EQ(learning["learning"].size(), 3U);
  const std::string file = learning["learned_file"];
  EXPECT_TRUE(std::filesystem::exists(file));
  EXPECT_THAT(file, HasSubstr("circle.h5.learned/"));

  const nlohmann::json again = play({}).json();
  EXPECT_THAT(again["compensations"], Each(Not("friction"))) << "the learned force contains the friction";
  EXPECT_LT(again["rms_error_m"].get<double>(), learning["repetitions"][0]["rms_error_m"].get<double>());
  EXPECT_THAT(play({"--forget"}).json()["compensations"], testing::Contains("friction"));

  const Answer faster = play({"--speed", "1.5"});
  EXPECT_EQ(faster.exit_code, 0);
  EXPECT_THAT(faster.err, AllOf(HasSubstr("is not used"), HasSubstr("1 times the path's speed")));
  ASSERT_EQ(haptrace("shape", "circle", "--size", "0.05", "--duration", "2", "--overwrite", "-o", path_).exit_code, 0);
  EXPECT_THAT(play({}).err, HasSubstr("it was learned on another path"));

  const Answer broken = play({"--learned", folder_.write("broken.json", "{\"format\": 1")});
  EXPECT_EQ(broken.exit_code, 0) << "playback works without the learned force";
  EXPECT_THAT(broken.err, HasSubstr("are not used"));
}

TEST_F(CalibratedPlay, RejectsAnUnwritableLearnedFileBeforeItMoves) {
  const std::string file = folder_.write("file", "");
  for (const std::string& place : {std::string("/proc/learned.json"), file + "/learned.json", folder_.path()}) {
    const Answer answer = play({"--learn", "2", "--learned", place, "--record", folder_ / "a.h5"});
    EXPECT_EQ(answer.exit_code, 2) << place;
    EXPECT_THAT(answer.err, HasSubstr(place));
    EXPECT_FALSE(std::filesystem::exists(folder_ / "a.h5")) << "nothing moved";
  }
}

TEST_F(CalibratedPlay, ReportsItsResultsIfTheLearnedForceCannotBeSaved) {
  std::filesystem::create_directory(folder_ / "place");
  Command command({"play", path_, "--device", kFalcon, "--json", "--learn", "2", "--clock", "real", "--speed", "2",
                   "--learned", folder_ / "place/learned.json", "--record", folder_ / "a.h5"},
                  Command::Input::none, {"HAPTRACE_PROFILES=" + folder_.path() + "/profiles"});
  while (!std::filesystem::exists(folder_ / "a.h5") && kill(command.pid(), 0) == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  std::filesystem::remove_all(folder_ / "place");
  (void)folder_.write("place", "");
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 1) << answer.err;
  EXPECT_EQ(answer.json()["repetitions"].size(), 2U) << "the measurements are reported";
  EXPECT_THAT(answer.json()["learned_error"].get<std::string>(), HasSubstr("place"));
  EXPECT_THAT(answer.err, HasSubstr("the learned force was not saved"));
}

TEST_F(CalibratedPlay, RejectsARequestedForeignProfileAndIgnoresAStoredOne) {
  const std::string profile = std::filesystem::directory_iterator(folder_.path() + "/profiles")->path().string();
  const Answer foreign = play({"--profile", profile}, "sim:preset=omega3,hand=relaxed");
  EXPECT_EQ(foreign.exit_code, 2);
  EXPECT_THAT(foreign.err, HasSubstr(profile));
  const Answer slower = play({"--rate", "500"});
  EXPECT_EQ(slower.exit_code, 0);
  EXPECT_THAT(slower.err, HasSubstr("is not used"));
  EXPECT_TRUE(slower.json()["compensations"].empty());
  EXPECT_THAT(play({"--learn", "2"}, "sim:preset=omega3").err, HasSubstr("haptrace calibrate --device"));
}

TEST_F(CalibratedPlay, SoftensUnstableGainsAndReportsIt) {
  const Answer answer =
      play({"--no-profile", "--kp", "20000", "--kd", "20", "--max-deviation", "0.2", "--record", folder_ / "over.h5"},
           "sim:preset=falcon,hand=none");
  const Answer events = haptrace("info", folder_ / "over.h5", "--json");
  ASSERT_EQ(events.exit_code, 0) << events.err;
  EXPECT_THAT(events.out + answer.out, HasSubstr("feedback softened to")) << answer.err;
}

TEST_F(CalibratedPlay, MapsTheStableGainsOfADevice) {
  const Answer map = run({"stability", "map", "--device", kFalcon, "--json", "--figure", folder_ / "map.svg"});
  ASSERT_EQ(map.exit_code, 0) << map.err;
  EXPECT_TRUE(map.json()["map"]["present"]["stable"].get<bool>()) << map.json()["map"]["present"];
  EXPECT_THAT(test::read_bytes(folder_ / "map.svg"), HasSubstr("</svg>"));
  const Answer unknown = run({"stability", "map", "--device", "sim:preset=omega3"});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("haptrace calibrate --device sim:preset=omega3"));
}

}  // namespace
}  // namespace haptrace
