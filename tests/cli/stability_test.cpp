#include "tests/cli/command.h"

#include <fstream>

namespace haptrace {
namespace {

TEST(StabilityCommand, RunsAnEnsembleAndPrintsTheContentsOfItsFile) {
  const TempFolder folder;
  const std::string path = folder / "reach.csv";
  ASSERT_EQ(haptrace("shape", "reach", "--size", "0.05", "--duration", "1", "-o", path).exit_code, 0);
  const Answer answer = haptrace("stability", "ensemble", "--draws", "1", "--learn", "1", "--seed", "3", "--paths",
                                 path, "-o", folder / "s.json", "--figure", folder / "s.svg", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json, nlohmann::json::parse(std::ifstream(folder / "s.json")));
  const nlohmann::json& ensemble = json["ensemble"];
  EXPECT_EQ(ensemble["draws"], 1);
  EXPECT_EQ(ensemble["seed"], 3);
  ASSERT_EQ(ensemble["paths"].size(), 4U);
  EXPECT_EQ(ensemble["paths"][0]["path"], "circle");
  EXPECT_EQ(ensemble["paths"][3]["path"], path);
  for (const char* controller : {"stiff", "cautious", "calibrated"})
    EXPECT_TRUE(ensemble["paths"][3]["controllers"].contains(controller)) << controller;
  EXPECT_EQ(ensemble["kinds"][0]["kind"], "small");
  EXPECT_EQ(json["hard_ensemble"]["kinds"][0]["kind"], "late");
  EXPECT_THAT(test::read_bytes(folder / "s.svg"), HasSubstr("</svg>"));
}

TEST(StabilityCommand, RunsOneKindOfDeviceUnderOneLaw) {
  const Answer answer = haptrace("stability", "ensemble", "--draws", "1", "--learn", "1", "--kinds", "delay-2ms",
                                 "--law", "observer", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["ensemble"]["kinds"][0]["kind"], "delay-2ms");
  EXPECT_FALSE(answer.json().contains("hard_ensemble"));
  EXPECT_THAT(haptrace("stability", "ensemble", "--kinds", "delay-2").err, HasSubstr("delay-2ms"));
}

TEST(StabilityCommand, MeasuresGuidanceOnAnEnsemble) {
  const Answer answer = haptrace("stability", "guidance", "--draws", "1", "--seed", "3", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json guidance = answer.json()["guidance"];
  EXPECT_EQ(guidance["draws"], 1);
  EXPECT_EQ(guidance["failed"], 0);
  EXPECT_EQ(guidance["paths"].size(), 7U);
  EXPECT_LT(guidance["energy_excess_j"]["max"], guidance["criteria"]["excess_j"]);
}

TEST(StabilityCommand, RunsTheStaircase) {
  const TempFolder folder;
  const std::string wall = folder.write("wall.json", R"({"objects": [{"kind": "wall", "point": [0, 0, -0.01],
      "normal": [0, 0, 1], "stiffness": 2500}]})");
  const Answer answer = haptrace("stability", "staircase", "--scene", wall, "--device", "sim:preset=omega3", "--figure",
                                 folder / "s.svg", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json staircase = answer.json()["staircase"], first = staircase["press"]["runs"][0];
  EXPECT_EQ(first["stiffness"], 2500);
  EXPECT_NEAR(first["created_j"]["mean"], first["expected_j"], 0.01 * first["expected_j"].get<double>());
  EXPECT_EQ(staircase["tap"]["runs"].size(), 8U * 4);
  EXPECT_THAT(test::read_bytes(folder / "s.svg"), HasSubstr("</svg>"));
  EXPECT_THAT(haptrace("stability", "staircase", "--device", "falcon").err, HasSubstr("give sim, or no device"));
}

TEST(StabilityCommand, RejectsInvalidOptionsBeforeItStarts) {
  const TempFolder folder;
  EXPECT_THAT(haptrace("stability", "map").err, HasSubstr("haptrace stability map needs --device"));
  const std::string kept = folder.write("kept.json", "{}");
  const Answer answer = haptrace("stability", "ensemble", "--draws", "1000000", "-o", kept);
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, AllOf(HasSubstr("kept.json"), HasSubstr("--overwrite")));
  EXPECT_EQ(test::read_bytes(kept), "{}");
  EXPECT_THAT(haptrace("stability", "ensemble", "--draws", "1000000", "--figure", folder / "f.jpg").err,
              HasSubstr(".png"));
  EXPECT_THAT(haptrace("stability", "ensemble", "--draws", "1000000", "-o", folder / "none/s.json").err,
              HasSubstr("none does not exist; create it first"));
}

TEST(StabilityCommand, AnswersItsOldOptionsWithTheNewForm) {
  const std::pair<std::vector<std::string>, const char*> old[] = {
      {{"--staircase"}, "haptrace stability staircase"},
      {{"--ensemble", "200"}, "haptrace stability ensemble --draws N"},
      {{"--guidance", "--ensemble=3"}, "haptrace stability guidance"},
      {{"--device", "falcon"}, "haptrace stability map --device NAME"}};
  for (const auto& [options, form] : old) {
    std::vector<std::string> words{"stability"};
    words.insert(words.end(), options.begin(), options.end());
    const Answer answer = test::Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2);
    EXPECT_THAT(answer.err, HasSubstr(form));
  }
  const Answer none = haptrace("stability");
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.err, HasSubstr("needs one of: map, ensemble, guidance, staircase"));
  EXPECT_THAT(haptrace("stability", "mapp").err, HasSubstr("map"));
}

}  // namespace
}  // namespace haptrace
