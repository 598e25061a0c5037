#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Writes an expert's recording with forces: a circle played on a device that a hand holds.
std::string expert(const TempFolder& folder) {
  const std::string path = folder / "circle.csv", file = folder / "expert.h5";
  EXPECT_EQ(haptrace("shape", "circle", "--duration", "2", "-o", path).exit_code, 0);
  const Answer answer = haptrace("play", path, "--device", kFalcon, "--no-profile", "--record", file);
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  return file;
}

TEST(GuideCommand, GuidesATraineeAndReportsTheResult) {
  const TempFolder folder;
  const std::string path = expert(folder);
  for (const char* mode : {"tunnel", "cursor"}) {
    const std::string out = folder / (std::string(mode) + ".h5");
    const Answer answer = haptrace("guide", path, "--mode", mode, "--radius", "5mm", "--device",
                                   "sim:preset=falcon,hand=firm,seed=4,intent=" + path, "--record", out, "--json");
    ASSERT_EQ(answer.exit_code, 0) << answer.err;
    const nlohmann::json json = answer.json();
    EXPECT_EQ(json["stopped_by"], "finished");
    EXPECT_EQ(json["mode"], mode);
    EXPECT_EQ(json["file"], out);
    const double length = json["path_length_m"];
    EXPECT_NEAR(length, 0.25, 0.02) << "a cautious playback cuts the corners of the path";
    EXPECT_GT(json["progress_m"].get<double>(), 0.98 * length);
    EXPECT_GE(json["time_in_tunnel"].get<double>(), 0);
    EXPECT_LE(json["energy_given_j"], json["energy_budget_j"]);
    EXPECT_EQ(haptrace("check", out).exit_code, 0);
  }
}

TEST(GuideCommand, HelpsATraineeWhoDoesNotStartAndCountsWhatIsDoneInPart) {
  const TempFolder folder;
  const std::string path = expert(folder);
  const std::vector<std::string> words{"guide",
                                       path,
                                       "--device",
                                       "sim:preset=falcon,hand=tense,seed=4",
                                       "--force-scale",
                                       "0",
                                       "--initiate",
                                       "--initiate-wait",
                                       "1",
                                       "--initiate-force",
                                       "0.5",
                                       "--time-limit",
                                       "3"};
  const Answer answer = Command(words).wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.out, HasSubstr("partial ("));
  EXPECT_THAT(answer.out, HasSubstr("did not start within 3.0"));
  std::vector<std::string> for_programs = words;
  for_programs.emplace_back("--json");
  const nlohmann::json json = Command(for_programs).wait().json();
  EXPECT_EQ(json["partial"], true);
  EXPECT_EQ(json["initiation"]["initiator"], "none");
  EXPECT_EQ(json["expert_force"], "sent");
}

TEST(GuideCommand, WarnsOfAForceThatHardlyChangesAlongThePath) {
  const TempFolder folder;
  const auto errors = [&](bool steady) {
    std::string csv = "t,x,y,z,fx,fy,fz\n";
    for (int i = 0; i <= 100; ++i)
      csv += fmt::format("{},{},0,0,{},0,{}\n", 0.02 * i, 0.0005 * i - 0.025, steady ? 0 : std::sin(0.1 * i),
                         steady ? (i < 15 ? -0.09 * i : -1.35) : 0.1);
    return haptrace("guide", folder.write(steady ? "weight.csv" : "task.csv", csv), "--device",
                    "sim:preset=falcon,hand=firm", "--time-limit", "1")
        .err;
  };
  EXPECT_THAT(errors(true), AllOf(HasSubstr("weight.csv: the force hardly changes, 1.4 N in one direction"),
                                  HasSubstr("--force-scale 0")));
  EXPECT_THAT(errors(false), Not(HasSubstr("hardly changes")));
}

TEST(GuideCommand, TakesATunnelThatChangesAlongThePath) {
  const TempFolder folder;
  const std::string path = expert(folder), out = folder / "out.h5", csv = folder / "out.csv";
  const std::string profile = folder.write("r.json", R"({"s": [0.05, 0.15], "radius": [0.008, 0.002]})");
  const Answer answer = haptrace("guide", path, "--radius", profile, "--device",
                                 "sim:preset=falcon,hand=firm,seed=4,intent=" + path, "--record", out);
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  int rows = 0;
  const RecordingReader reader(out);
  for (const Sample& sample : reader.read(0, reader.rows())) {
    if (sample.phase != Phase::run) continue;
    ++rows;
    const double share = std::clamp((sample.progress - 0.05) / 0.1, 0.0, 1.0);
    ASSERT_NEAR(sample.tunnel_radius, 0.008 - share * 0.006, 3e-5);
  }
  EXPECT_GT(rows, 500);
}

TEST(GuideCommand, NamesTheInvalidOption) {
  const TempFolder folder;
  const std::string path = expert(folder);
  const auto error = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{"guide", path, "--device", kFalcon};
    words.insert(words.end(), more.begin(), more.end());
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2) << answer.err;
    return answer.err;
  };
  EXPECT_THAT(error({"--mode", "tunel"}), HasSubstr("tunnel"));
  EXPECT_THAT(error({"--radius", "wide"}), HasSubstr("--radius is 'wide'"));
  EXPECT_THAT(error({"--radius", "auto"}), HasSubstr("--spread"));
  EXPECT_THAT(error({"--radius", "none.json"}), HasSubstr("none.json: cannot be read"));
  EXPECT_THAT(error({"--radius", "-1"}), HasSubstr("the radius of the tunnel is -1"));
  EXPECT_THAT(error({"--feel", "passive"}), HasSubstr("active"));
  EXPECT_THAT(error({"--repeat", "0"}), HasSubstr("--repeat is 0"));
  EXPECT_THAT(error({"--smoothing", "-1"}), HasSubstr("the smoothing is -1 s"));
  EXPECT_THAT(error({"--no-profile", "--profile", "x.json"}), HasSubstr("exclude each other"));
  EXPECT_THAT(haptrace("guide", folder / "none.h5", "--device", kFalcon).err, HasSubstr("none.h5"));
}

TEST(AverageCommand, MakesAnExpertWhoseSpreadBecomesTheTunnel) {
  const TempFolder folder;
  std::vector<std::string> words{"average"};
  for (const char* size : {"78mm", "80mm", "82mm"}) {
    words.push_back(folder / fmt::format("{}.h5", size));
    ASSERT_EQ(haptrace("shape", "circle", "--size", size, "--duration", "2", "-o", words.back()).exit_code, 0);
  }
  const std::string averaged = folder / "expert.h5", out = folder / "trainee.h5";
  words.insert(words.end(), {"-o", averaged, "--json"});
  const Answer answer = Command(words).wait();
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json["copies"].size(), 3U);
  EXPECT_NEAR(json["spread_m"].get<double>(), 1e-3, 0.05e-3) << "radii of 39, 40 and 41 mm";
  EXPECT_NEAR(json["radius_m"].get<double>(), 5e-3, 0.25e-3);
  EXPECT_THAT(answer.err, HasSubstr("the spread of 3 recordings is uncertain"));
  EXPECT_EQ(haptrace("check", averaged).exit_code, 0);

  const Answer guided = haptrace("guide", averaged, "--radius", "auto", "--device",
                                 "sim:preset=falcon,hand=firm,seed=4,intent=" + averaged, "--record", out);
  ASSERT_EQ(guided.exit_code, 0) << guided.err;
  const RecordingReader reader(out);
  for (const Sample& sample : reader.read(0, reader.rows()))
    if (sample.phase == Phase::run) {
      ASSERT_NEAR(sample.tunnel_radius, 5e-3, 0.6e-3);
    }
}

TEST(AverageCommand, SaysWhatCannotBeAveragedAndGuideWhatHasNoSpread) {
  const TempFolder folder;
  const std::string circle = folder / "circle.h5", again = folder / "again.h5", square = folder / "square.h5",
                    out = folder / "out.h5", link = folder / "link.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--duration", "1", "-o", circle).exit_code, 0);
  ASSERT_EQ(haptrace("shape", "circle", "--duration", "2", "-o", again).exit_code, 0);
  ASSERT_EQ(haptrace("shape", "square", "--size", "65mm", "--duration", "1", "-o", square).exit_code, 0);
  std::filesystem::create_symlink(circle, link);
  EXPECT_THAT(haptrace("average", circle, again, square, "-o", out).err, HasSubstr("square.h5: shows another"));
  EXPECT_THAT(haptrace("average", circle, again, link, "-o", out).err, HasSubstr("link.h5 is given twice"));
  EXPECT_THAT(haptrace("average", circle, "-o", out).err, HasSubstr("holds one repetition"));
  EXPECT_THAT(haptrace("average", circle, square, "-o", circle).err, HasSubstr("circle.h5"));
  EXPECT_FALSE(std::filesystem::exists(out));
  EXPECT_THAT(haptrace("guide", circle, "--radius", "auto", "--device", kFalcon).err,
              HasSubstr("haptrace average A.h5 B.h5 C.h5 -o expert.h5"));
  EXPECT_THAT(haptrace("guide", circle, "--radius", "auto", "--spread", square, "--device", kFalcon).err,
              HasSubstr("square.h5: shows another movement"));
}

TEST(AverageCommand, AveragesTheRepetitionsOfOneRecording) {
  const TempFolder folder;
  const std::string circle = folder / "circle.h5", played = folder / "played.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--duration", "1", "-o", circle).exit_code, 0);
  ASSERT_EQ(
      haptrace("play", circle, "--device", kFalcon, "--no-profile", "--repeat", "3", "--record", played).exit_code, 0);
  const Answer answer = haptrace("average", played, "-o", folder / "out.h5", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["copies"].size(), 3U);
  EXPECT_THAT(answer.json()["copies"][1]["name"].get<std::string>(), HasSubstr("played.h5, repetition 2"));

  const std::string slow = folder / "slow.h5";
  ASSERT_EQ(haptrace("guide", circle, "--device", kFalcon, "--repeat", "2", "--time-limit", "0.3", "--record", slow)
                .exit_code,
            0);
  EXPECT_THAT(haptrace("average", slow, "-o", folder / "none.h5").err,
              testing::AllOf(HasSubstr("slow.h5, repetition 1 is left out: it was cut short"),
                             HasSubstr("holds 0 repetitions that were not cut short")));
}

TEST(GuideCommand, CountsATunnelInModeFreeOnlyIfARadiusIsGiven) {
  const TempFolder folder;
  const std::string path = expert(folder), device = "sim:preset=falcon,hand=firm,seed=4,intent=" + path;
  const Answer free = haptrace("guide", path, "--mode", "free", "--device", device, "--time-limit", "3");
  ASSERT_EQ(free.exit_code, 0) << free.err;
  EXPECT_THAT(free.out, testing::Not(HasSubstr("tunnel")));
  EXPECT_THAT(free.out + free.err, testing::Not(testing::AnyOf(HasSubstr("wall"), HasSubstr("force of the expert"))));
  const Answer asked =
      haptrace("guide", path, "--mode", "free", "--radius", "5mm", "--device", device, "--time-limit", "3");
  EXPECT_THAT(asked.out, HasSubstr("of the time in the tunnel"));
}

TEST(GuideCommand, RefusesOptionsWithoutEffectButNotThoseOfAConfiguration) {
  const TempFolder folder;
  const std::string path = expert(folder);
  const auto error = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{"guide", path, "--device", kFalcon, "--time-limit", "0.2"};
    words.insert(words.end(), more.begin(), more.end());
    return Command(words).wait().err;
  };
  EXPECT_THAT(error({"--speed", "0.5"}), HasSubstr("--speed has no effect without --mode cursor"));
  EXPECT_THAT(error({"--mode", "free", "--pace", "1"}), HasSubstr("--pace has no effect without --mode tunnel"));
  EXPECT_THAT(error({"--mode", "free", "--initiate"}), HasSubstr("--initiate has no effect"));
  EXPECT_THAT(error({"--pace-force", "2"}), HasSubstr("--pace-force has no effect without --pace: leave it out, or"));
  EXPECT_THAT(error({"--amplify-force", "2"}), HasSubstr("--amplify-force has no effect"));
  for (const std::vector<std::string>& fine :
       std::vector<std::vector<std::string>>{{"--config", folder.write("c.json", R"({"speed": 0.5, "pace-force": 2})")},
                                             {"--pace", "1", "--pace-force", "2"},
                                             {"--mode", "cursor", "--speed", "0.5"}})
    EXPECT_THAT(error(fine), testing::Not(HasSubstr("no effect"))) << fine[0];
}

TEST(GuideCommand, ResumesWithADeviceThatIsPluggedInAgain) {
  const TempFolder folder;
  const std::string path = expert(folder);
  const Answer answer = haptrace("guide", path, "--radius", "0.02", "--wait-for-device", "30", "--device",
                                 "sim:preset=falcon,hand=firm,intent=" + path + ",lost_at=1.5,lost_for=0.5",
                                 "--time-limit", "5", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["stopped_by"], "finished");
  EXPECT_EQ(answer.json()["returns"], 1);
  EXPECT_LE(answer.json()["energy_given_j"], answer.json()["energy_budget_j"]);
}

TEST(GuideCommand, EndsARepetitionAtTheTimeLimit) {
  const TempFolder folder;
  const Answer answer = haptrace("guide", expert(folder), "--time-limit", "0.5", "--device", kFalcon, "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_NEAR(answer.json()["repetitions"][0]["duration_s"].get<double>(), 0.5, 0.01);
}

}  // namespace
}  // namespace haptrace
