#include "tests/cli/command.h"

#include "formats/recording/recording.h"
#include "tests/cli/live_recording.h"

#include <csignal>
#include <filesystem>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

namespace haptrace {
namespace {

std::string square(const TempFolder& folder) {
  const std::string file = folder / "square.h5";
  EXPECT_EQ(haptrace("shape", "square", "--size", "0.04", "--duration", "1", "-o", file).exit_code, 0);
  return file;
}

/// Expects a valid recording of any session: it opens, is complete, and its last force is zero.
void expect_sound(const std::string& file) {
  const RecordingReader reader(file);
  ASSERT_GT(reader.rows(), 0U);
  EXPECT_TRUE(reader.header().complete);
  EXPECT_EQ(reader.read(reader.rows() - 1, 1).front().force, Vec3::Zero());
  for (const Finding& finding : check_recording(file))
    EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
}

TEST(TheCommand, ShowsItsVersionAndHelpWithEveryVerb) {
  EXPECT_THAT(haptrace("--version").out, HasSubstr("haptrace "));
  const Answer help = haptrace("--help");
  EXPECT_EQ(help.exit_code, 0);
  for (const char* verb : {"devices", "shape", "record", "play", "info", "check", "plot"}) {
    EXPECT_THAT(help.out, HasSubstr(verb));
    const Answer own = haptrace(verb, "--help");
    EXPECT_EQ(own.exit_code, 0) << verb;
    EXPECT_THAT(own.out, HasSubstr("--json")) << verb;
  }
}

TEST(TheCommand, PrintsNoDeviceOfAFileWithoutOne) {
  const TempFolder folder;
  const Answer info = haptrace("info", square(folder));
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_THAT(info.out, AllOf(HasSubstr("samples"), Not(HasSubstr("\n  device "))));
}

TEST(TheCommand, RecordsASimulatedHandAndPlaysItBackOnAnotherDevice) {
  const TempFolder folder;
  const std::string path = square(folder);
  const Answer recorded =
      haptrace("record", folder / "r.h5", "--device", "sim:preset=omega3,hand=firm,seed=1,intent=" + path, "--json");
  ASSERT_EQ(recorded.exit_code, 0) << recorded.err;
  expect_sound(folder / "r.h5");

  const Answer played =
      haptrace("play", folder / "r.h5", "--device", kFalcon, "--record", folder / "p.h5", "--fit", "--json");
  ASSERT_EQ(played.exit_code, 0) << played.err;
  const nlohmann::json json = played.json();
  EXPECT_EQ(json["stopped_by"], "finished");
  EXPECT_GT(json["rms_error_m"], 1e-4);
  EXPECT_LT(json["rms_error_m"], 1.5e-2);
  EXPECT_EQ(json["lost"], 0);
  expect_sound(folder / "p.h5");

  const nlohmann::json info = haptrace("info", folder / "p.h5", "--json").json();
  EXPECT_EQ(info["samples"], json["samples"]);
  EXPECT_NEAR(info["rms_error_m"].get<double>(), json["rms_error_m"].get<double>(), 1e-12);
  EXPECT_EQ(info["config"]["verb"], "play");

  EXPECT_EQ(haptrace("check", folder / "p.h5").exit_code, 0);
  EXPECT_EQ(haptrace("plot", folder / "p.h5", "-o", folder / "p.png").exit_code, 0);
  EXPECT_EQ(test::read_bytes(folder / "p.png").substr(1, 3), "PNG");
}

TEST(TheCommand, RepeatsASessionBitForBitFromTheSameSeed) {
  const TempFolder folder;
  const std::string path = square(folder);
  for (const char* name : {"a.h5", "b.h5"})
    ASSERT_EQ(haptrace("play", path, "--device", kFalcon, "--record", folder / name).exit_code, 0);
  const RecordingReader a(folder / "a.h5"), b(folder / "b.h5");
  ASSERT_EQ(a.rows(), b.rows());
  const auto one = a.read(0, a.rows()), other = b.read(0, b.rows());
  for (std::size_t i = 0; i < one.size(); ++i) {
    ASSERT_EQ(one[i].position, other[i].position) << i;
    ASSERT_EQ(one[i].force, other[i].force) << i;
  }
}

TEST(TheCommand, TakesAnyOptionFromAConfigurationAndPrefersTheCommandLine) {
  const TempFolder folder;
  const std::string path = square(folder);
  const std::string config =
      folder.write("play.json", R"({"device": ")" + kFalcon + R"(", "kp": 700, "kd": 7, "repeat": 2, "fit": true})");
  const nlohmann::json json = haptrace("play", path, "--config", config, "--repeat", "1", "--json").json();
  EXPECT_EQ(json["gains"]["kp"][0], 700);
  EXPECT_EQ(json["repetitions"].size(), 1U);

  const Answer wrong = haptrace("play", path, "--config", folder.write("bad.json", R"({"repaet": 2})"));
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, AllOf(HasSubstr("bad.json: unknown key 'repaet'"), HasSubstr("did you mean 'repeat'")));
}

TEST(TheCommand, PlaysTheConfigurationOfARecording) {
  const TempFolder folder;
  const std::string path = square(folder);
  ASSERT_EQ(
      haptrace("play", path, "--device", kFalcon, "--kp", "900", "--kd", "9", "--record", folder / "a.h5").exit_code,
      0);
  nlohmann::json config = haptrace("info", folder / "a.h5", "--json").json()["config"];
  config["record"] = folder / "b.h5";
  const Answer again = haptrace("play", "--config", folder.write("again.json", config.dump()), "--json");
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(again.json()["gains"]["kp"][0], 900);
}

TEST(TheCommand, TakesTheWholeOutputOfInfoAsAConfiguration) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("play", square(folder), "--device", kFalcon, "--kp", "900", "--kd", "9", "--record",
                     folder / "a.h5", "--fit")
                .exit_code,
            0);
  nlohmann::json told = haptrace("info", folder / "a.h5", "--json").json();
  told["config"]["overwrite"] = true;
  const std::string config = folder.write("a.json", told.dump());
  EXPECT_THAT(haptrace("play", "--config", config).err, HasSubstr("exists")) << "it does not replace its origin";
  const Answer again = haptrace("play", "--config", config, "--record", folder / "b.h5", "--json");
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(again.json()["gains"]["kp"][0], 900);
}

TEST(TheCommand, SaysInPlainWordsWhatAnOptionMustBe) {
  const TempFolder folder;
  const std::string path = square(folder);
  const auto error = [&](const std::vector<std::string>& options) {
    std::vector<std::string> words{"play", path, "--device", kFalcon};
    words.insert(words.end(), options.begin(), options.end());
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2);
    return answer.err;
  };
  EXPECT_THAT(error({"--speed", "2mm"}), HasSubstr("--speed is '2mm'; it must be a number without a unit"));
  EXPECT_THAT(error({"--support", "abc"}), HasSubstr("'abc': expected a number, with or without a unit of N"));
  EXPECT_THAT(error({"--support", "500MN"}), HasSubstr("'MN' is not a known unit of this quantity"));
  EXPECT_THAT(error({"--rate", "1MHz"}), HasSubstr("'MHz' is not a known unit of this quantity; its SI unit is Hz"));
  EXPECT_THAT(error({"--max-force", "-3"}), HasSubstr("it must be 0 (the device's limit) or above"));
  EXPECT_THAT(error({"--kp", "1000"}), HasSubstr("give both, as in --kp 2000 --kd 24"));
  EXPECT_THAT(error({"--without", "inertai"}), HasSubstr("unknown force term 'inertai'"));
  EXPECT_THAT(error({"--from", "50"}), HasSubstr("has no sample from 50 s on"));
  EXPECT_THAT(error({"--compress", "3"}), HasSubstr("--compress has no effect without --record"));
  EXPECT_THAT(error({"--record", folder / "a.h5", "--mark-texts", "1,2,3,4,5,6,7,8,9,10"}),
              HasSubstr("there are 9 keys"));
  EXPECT_THAT(haptrace("devices", "sim", "--watch").err, HasSubstr("exclude each other"));
  EXPECT_THAT(haptrace("view").err, HasSubstr("haptrace view needs FILE"));
  EXPECT_THAT(haptrace("stability", "--json").err, testing::Not(HasSubstr("known:")));
}

TEST(TheCommand, WarnsOfALimitThatIsOffOrAboveTheDevices) {
  const TempFolder folder;
  const auto warnings = [&](const char* option, const char* value) {
    const Answer answer = haptrace("play", square(folder), "--fit", "--device", kFalcon, option, value, "--record",
                                   folder / "a.h5", "--overwrite", "--json");
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    EXPECT_NE(answer.json()["warnings"].dump().find("limits"), std::string::npos);
    std::filesystem::remove(folder / "square.h5");
    return answer.err;
  };
  EXPECT_THAT(warnings("--max-velocity", "0"), HasSubstr("there is no speed limit"));
  EXPECT_THAT(warnings("--max-force", "50"), HasSubstr("--max-force 50 N is above the largest force of"));
}

TEST(TheCommand, FitsThePathOfAHandOnlyOnRequestAndReportsHow) {
  const TempFolder folder;
  const std::string far = folder.write("far.csv", "t,x,y,z\n0,1,0,0\n0.2,1.05,0,0\n0.5,1.1,0.05,0\n");
  const std::string device = "sim:preset=omega3,hand=firm,intent=" + far;
  const Answer refused = haptrace("record", folder / "r.h5", "--device", device);
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("leaves the workspace"), HasSubstr("mm; --fit")));
  const Answer fitted = haptrace("record", folder / "r.h5", "--device", device, "--fit", "--json");
  ASSERT_EQ(fitted.exit_code, 0) << fitted.err;
  EXPECT_THAT(fitted.err, HasSubstr("far.csv: fitted into the workspace of the Force Dimension omega.3: scaled by"));
  EXPECT_FALSE(fitted.json()["notes"].empty());
  EXPECT_NEAR(fitted.json()["duration_s"].get<double>(), 0.5, 0.01);
}

// ---------------------------------------------------------------------------------------------- bad usage and input

struct Mistake {
  const char* name;
  std::vector<std::string> words;  ///< SQUARE and FOLDER stand for a good path and the test's folder
  int exit_code;
  std::vector<std::string> says;
};

const std::vector<std::pair<std::string, std::string>> kBadFiles{
    {"empty.csv", ""},
    {"text.csv", "t,x,y,z\n0,0,0,0\n0.1,0,nought,0\n"},
    {"wide.csv", "t,x,y,z\n0,0,0,0\n1,400,0,0\n"},
    {"something.h5", "this is not HDF5"},
    {"negative.json", R"({"kp": -5, "kd": 1})"},
    {"absurd.json", R"({"kp": 1e12, "kd": 1})"},
    {"there.h5", "of another session"},
};

class Mistakes : public testing::TestWithParam<Mistake> {};

TEST_P(Mistakes, AreReportedWithCausePlaceAndRemedy) {
  const TempFolder folder;
  const std::string path = square(folder);
  for (const auto& [name, content] : kBadFiles) std::ofstream(folder / name) << content;
  std::vector<std::string> words;
  for (std::string word : GetParam().words) {
    for (const auto& [placeholder, value] :
         {std::pair<std::string, std::string>{"SQUARE", path}, {"FOLDER", folder.path()}})
      if (const auto at = word.find(placeholder); at != std::string::npos) word.replace(at, placeholder.size(), value);
    words.push_back(word);
  }
  const Answer answer = test::Command(words).wait();
  EXPECT_EQ(answer.exit_code, GetParam().exit_code) << answer.err;
  for (const std::string& part : GetParam().says) EXPECT_THAT(answer.err, HasSubstr(part));
  EXPECT_FALSE(std::filesystem::exists(folder / "out.h5")) << "nothing is left behind";
}

INSTANTIATE_TEST_SUITE_P(
    Usage, Mistakes,
    testing::Values(
        Mistake{"UnknownVerb", {"recrod"}, 2, {"unknown verb 'recrod'", "did you mean 'record'"}},
        Mistake{"UnknownOptionBeforeTheVerb",
                {"--nonsense"},
                2,
                {"unknown option '--nonsense'", "--version", "see haptrace --help"}},
        Mistake{"UnknownOption", {"play", "SQUARE", "--spede", "2"}, 2, {"unknown option '--spede'", "'--speed'"}},
        Mistake{"UnknownDevice", {"play", "SQUARE", "--device", "smi"}, 2, {"smi", "did you mean 'sim'"}},
        Mistake{"UnknownPreset", {"play", "SQUARE", "--device", "sim:preset=falkon"}, 2, {"falkon", "'falcon'"}},
        Mistake{"UnknownDeviceKey", {"play", "SQUARE", "--device", "sim:presset=falcon"}, 2, {"presset", "'preset'"}},
        Mistake{"UnknownShape", {"shape", "sqare", "-o", "FOLDER/out.h5"}, 2, {"sqare"}},
        Mistake{"NoDevice", {"play", "SQUARE"}, 2, {"needs --device"}},
        Mistake{"NoPath", {"play", "--device", "sim"}, 2, {"needs PATH"}},
        Mistake{"NotANumber", {"play", "SQUARE", "--device", "sim", "--speed", "fast"}, 2, {"--speed"}},
        Mistake{"MissingPath", {"play", "FOLDER/nothing.h5", "--device", "sim"}, 2, {"nothing.h5"}},
        Mistake{"EmptyPath", {"play", "FOLDER/empty.csv", "--device", "sim"}, 2, {"empty.csv"}},
        Mistake{"TextInAPath", {"play", "FOLDER/text.csv", "--device", "sim"}, 2, {"text.csv:3", "nought"}},
        Mistake{"MillimetresInAPath", {"play", "FOLDER/wide.csv", "--device", "sim"}, 2, {"millimetres"}},
        Mistake{"SomethingElse", {"info", "FOLDER/something.h5"}, 2, {"something.h5"}},
        Mistake{"NegativeGain", {"play", "SQUARE", "--device", "sim", "--kp", "-1", "--kd", "1"}, 2, {"kp", "-1"}},
        Mistake{"GainIsNotANumber", {"play", "SQUARE", "--device", "sim", "--kp", "nan", "--kd", "1"}, 2, {"kp"}},
        Mistake{"NegativeGainInAFile",
                {"play", "SQUARE", "--device", "sim", "--gains", "FOLDER/negative.json"},
                2,
                {"negative.json", "kp"}},
        Mistake{"AbsurdGainInAFile",
                {"play", "SQUARE", "--device", "sim", "--gains", "FOLDER/absurd.json"},
                2,
                {"absurd.json", "kp"}},
        Mistake{"OneGainOfTwo", {"play", "SQUARE", "--device", "sim", "--kp", "100"}, 2, {"--kp and --kd go together"}},
        Mistake{"RateTooLow",
                {"play", "SQUARE", "--device", "sim", "--rate", "9", "--record", "FOLDER/out.h5"},
                2,
                {"the rate is 9 Hz", "10 to 20000"}},
        Mistake{"RateTooHigh",
                {"play", "SQUARE", "--device", "sim", "--rate", "20001", "--record", "FOLDER/out.h5"},
                2,
                {"the rate is 20001 Hz"}},
        Mistake{"UnknownClock", {"play", "SQUARE", "--device", "sim", "--clock", "vrtual"}, 2, {"'virtual'"}},
        Mistake{"UnknownPolicy", {"play", "SQUARE", "--device", "sim", "--on-deviation", "stpo"}, 2, {"'stop'"}},
        Mistake{"OutputExists",
                {"play", "SQUARE", "--device", "sim", "--record", "FOLDER/there.h5"},
                2,
                {"there.h5", "--overwrite"}},
        Mistake{"OutputIsInput",
                {"play", "SQUARE", "--device", "sim", "--record", "SQUARE"},
                2,
                {"square.h5", "choose another name"}},
        Mistake{
            "OutputFolderMissing", {"record", "FOLDER/no/out.h5", "--device", "sim", "--duration", "1"}, 2, {"out.h5"}},
        Mistake{"EndlessRecording", {"record", "FOLDER/out.h5", "--device", "sim"}, 2, {"--duration"}},
        Mistake{"MissingPlugin", {"play", "SQUARE", "--device", "plugin:path=/no/such.so"}, 3, {"/no/such.so"}},
        Mistake{"PluginOfAnotherAbi", {"play", "SQUARE", "--device", "plugin:path=" WRONG_ABI_PLUGIN}, 3, {"ABI"}},
        Mistake{"ConfigIsNotJson", {"play", "SQUARE", "--config", "FOLDER/text.csv"}, 2, {"text.csv"}},
        Mistake{"UnknownPictureKind", {"plot", "SQUARE", "-o", "FOLDER/out.bmp"}, 2, {".png"}}),
    [](const auto& instance) { return instance.param.name; });

TEST(TheCommand, ReportsErrorsAsJsonToo) {
  const Answer answer = haptrace("info", "/no/such.h5", "--json");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("/no/such.h5"));
}

TEST(TheCommand, ReplacesAFileOnlyOnRequest) {
  const TempFolder folder;
  const std::string path = square(folder);
  ASSERT_EQ(haptrace("play", path, "--device", kFalcon, "--record", folder / "a.h5").exit_code, 0);
  const std::string before = test::read_bytes(folder / "a.h5");
  EXPECT_EQ(haptrace("play", path, "--device", kFalcon, "--record", folder / "a.h5").exit_code, 2);
  EXPECT_EQ(test::read_bytes(folder / "a.h5"), before);
  EXPECT_EQ(haptrace("play", path, "--device", kFalcon, "--record", folder / "a.h5", "--overwrite").exit_code, 0);
  expect_sound(folder / "a.h5");
}

// ------------------------------------------------------------------------------------------------------ interruptions

struct Interruption {
  const char* name;
  int signal;
  Phase phase;
};

class Interruptions : public testing::TestWithParam<Interruption> {};

TEST_P(Interruptions, KeepEverySampleAndEndWithZeroForce) {
  const TempFolder folder;
  const std::string path = square(folder);
  test::Command command(
      {"play", path, "--device", kFalcon, "--clock", "real", "--hold", "60", "--record", folder / "out.h5", "--json"});
  ASSERT_TRUE(test::wait_for_phase(folder / "out.h5", GetParam().phase));
  kill(command.pid(), GetParam().signal);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  EXPECT_EQ(answer.json()["stopped_by"], "interrupted");
  expect_sound(folder / "out.h5");
  EXPECT_EQ(RecordingReader(folder / "out.h5").rows(), answer.json()["samples"]);
}

INSTANTIATE_TEST_SUITE_P(InEveryPhase, Interruptions,
                         testing::Values(Interruption{"SigintWhileApproaching", SIGINT, Phase::approach},
                                         Interruption{"SigintWhileRunning", SIGINT, Phase::run},
                                         Interruption{"SigtermWhileRunning", SIGTERM, Phase::run},
                                         Interruption{"SigtermWhileHolding", SIGTERM, Phase::hold},
                                         Interruption{"HangupWhileRunning", SIGHUP, Phase::run}),
                         [](const auto& instance) { return instance.param.name; });

TEST(TheCommand, EndsAnEndlessRecordingOnAnInterrupt) {
  const TempFolder folder;
  test::Command command({"record", folder / "out.h5", "--device", kFalcon, "--clock", "real", "--json"});
  ASSERT_TRUE(test::wait_for_rows(folder / "out.h5", 200));
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  expect_sound(folder / "out.h5");
}

TEST(TheCommand, ContinuesInAnotherFileAtTheFileSizeLimitAndReportsIt) {
  const TempFolder folder;
  const std::string path = square(folder);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  rlimit small = before;
  small.rlim_cur = 6'000'000;
  setrlimit(RLIMIT_FSIZE, &small);
  const Answer answer =
      haptrace("play", path, "--device", kFalcon, "--rate", "20000", "--record", folder / "out.h5", "--json");
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err, AllOf(HasSubstr("out.h5"), HasSubstr("ulimit -f"), HasSubstr("out.part002.h5")));
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json["stopped_by"], "finished");
  EXPECT_EQ(json["samples"], json["session_samples"]);
  const RecordingReader reader(folder / "out.h5");
  EXPECT_EQ(reader.rows(), json["samples"]);
  EXPECT_GE(reader.files().size(), 2U);
  EXPECT_TRUE(reader.header().complete);
}

// ------------------------------------------------------------------------------------------------- misbehaving devices

struct Misbehaviour {
  const char* name;
  const char* options;
  int exit_code;
  const char* stopped_by;
};

class MisbehavingPlugins : public testing::TestWithParam<Misbehaviour> {};

TEST_P(MisbehavingPlugins, StopTheSessionWithZeroForceAndAReason) {
  const TempFolder folder;
  const std::string path = square(folder);
  const Answer answer = haptrace("play", path, "--fit", "--record", folder / "out.h5", "--json", "--device",
                                 std::string("plugin:path=" FAULTY_PLUGIN ",options=") + GetParam().options);
  EXPECT_EQ(answer.exit_code, GetParam().exit_code) << answer.err << answer.out;
  EXPECT_EQ(answer.json()["stopped_by"], GetParam().stopped_by);
  EXPECT_FALSE(answer.err.empty());
  const RecordingReader reader(folder / "out.h5");
  EXPECT_TRUE(reader.header().complete);
  EXPECT_GT(reader.rows(), 0U);
  EXPECT_FALSE(reader.events().empty());
}

INSTANTIATE_TEST_SUITE_P(MidSession, MisbehavingPlugins,
                         testing::Values(Misbehaviour{"ReturnsNaN", R"({"fault":"nan","tick":900})", 1, "not_finite"},
                                         Misbehaviour{"Jumps", R"({"fault":"jump","tick":900})", 1, "velocity"},
                                         Misbehaviour{"GoesBackwards", R"({"fault":"backwards"})", 1, "velocity"},
                                         Misbehaviour{"Leaps", R"({"fault":"leaps","tick":900})", 1,
                                                      "outside_workspace"},
                                         Misbehaviour{"FallsMute", R"({"fault":"mute","tick":900})", 3, "device_lost"},
                                         Misbehaviour{"HangsUp", R"({"fault":"lost","tick":900})", 3, "device_lost"}),
                         [](const auto& instance) { return instance.param.name; });

// -------------------------------------------------------------------------------------------- a device lost and found

TEST(ALostDevice, ResumesTheSessionWhenItReturns) {
  const TempFolder folder;
  const std::string path = square(folder);
  const Answer answer = haptrace("play", path, "--fit", "--record", folder / "out.h5", "--json", "--wait-for-device",
                                 "2", "--device", kFalcon + ",lost_at=1,lost_for=0.5");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["stopped_by"], "finished");
  EXPECT_EQ(answer.json()["returns"], 1);
  EXPECT_NEAR(answer.json()["away_s"].get<double>(), 0.5, 2e-3);
  EXPECT_NEAR(answer.json()["achieved_rate_hz"].get<double>(), 1000, 1);
  ASSERT_EQ(answer.json()["repetitions"].size(), 1U);
  EXPECT_NEAR(answer.json()["repetitions"][0]["duration_s"].get<double>(), 1.05, 0.02)
      << "the path takes a second, and the device has to accelerate again";
  expect_sound(folder / "out.h5");
  EXPECT_EQ(haptrace("check", folder / "out.h5").exit_code, 0);
  EXPECT_THAT(haptrace("check", folder / "out.h5").out, testing::Not(HasSubstr("no event reports them")));

  std::vector<std::string> told;
  const RecordingReader reader(folder / "out.h5");
  for (const StoredEvent& event : reader.events())
    if (event.text.find("device") != std::string::npos) told.push_back(event.text);
  EXPECT_EQ(told, (std::vector<std::string>{"the device was lost", "the device is back after 0.500 s"}));
}

TEST(ALostDevice, EndsTheSessionWhenItDoesNotComeBackInTime) {
  const TempFolder folder;
  const std::string path = square(folder);
  for (const char* patience : {"0.2", "0"}) {
    const Answer answer = haptrace("play", path, "--fit", "--record", folder / "out.h5", "--overwrite", "--json",
                                   "--wait-for-device", patience, "--device", kFalcon + ",lost_at=1,lost_for=0.5");
    EXPECT_EQ(answer.exit_code, 3) << answer.err;
    EXPECT_EQ(answer.json()["stopped_by"], "device_lost");
    const std::string why = answer.json()["stopped_because"];
    EXPECT_THAT(why, HasSubstr("the device was lost: its simulated cable was unplugged"));
    EXPECT_EQ(why.find("the session waited 0.2 s for it") != std::string::npos, std::string(patience) == "0.2") << why;
    EXPECT_NEAR(answer.json()["samples"].get<double>(), 1000, 2);
  }
}

TEST(ALostDevice, IsReopenedByItsPlugInEveryTimeItIsLost) {
  const TempFolder folder;
  const std::string path = square(folder);
  const Answer answer =
      haptrace("play", path, "--fit", "--record", folder / "out.h5", "--json", "--wait-for-device", "30", "--device",
               std::string("plugin:path=" FAULTY_PLUGIN R"(,options={"fault":"lost","tick":900})"));
  ASSERT_EQ(answer.exit_code, 0) << answer.err << answer.out;
  EXPECT_GE(answer.json()["returns"], 2) << "every reopened device is lost again after 900 ticks";
  EXPECT_EQ(haptrace("check", folder / "out.h5").exit_code, 0);
  // Forces start at zero and grow in small steps, wherever the new device stands.
  const RecordingReader reader(folder / "out.h5");
  const auto rows = reader.read(0, reader.rows());
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (rows[i].tick != rows[i - 1].tick + 1) {
      EXPECT_EQ(rows[i].force, Vec3::Zero()) << "row " << i;
    }
    if (rows[i].tick == rows[i - 1].tick + 1 && rows[i].phase != Phase::release) {
      ASSERT_LE((rows[i].force - rows[i - 1].force).norm(), 0.5) << "row " << i;
    }
  }
}

TEST(ALostDevice, IsNotReplacedByAnother) {
  const TempFolder folder;
  const std::string path = square(folder);
  const Answer answer =
      haptrace("play", path, "--fit", "--json", "--wait-for-device", "30", "--device",
               std::string("plugin:path=" FAULTY_PLUGIN R"(,options={"fault":"swapped","tick":900})"));
  EXPECT_EQ(answer.exit_code, 3) << answer.err;
  EXPECT_THAT(answer.json()["stopped_because"].get<std::string>(),
              AllOf(HasSubstr("another device answers in its place"), HasSubstr("is rejected")));
}

TEST(ALostDevice, IsWaitedForByRecordToo) {
  const TempFolder folder;
  const Answer answer = haptrace("record", folder / "out.h5", "--duration", "1.5", "--json", "--wait-for-device", "30",
                                 "--device", kFalcon + ",lost_at=0.5,lost_for=0.5");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["returns"], 1);
  EXPECT_NEAR(answer.json()["samples"].get<double>(), 1001, 2) << "no samples while the device was away";
  EXPECT_NEAR(answer.json()["duration_s"].get<double>(), 1.5, 2e-3);
  EXPECT_EQ(haptrace("check", folder / "out.h5").exit_code, 0);
}

}  // namespace
}  // namespace haptrace
