#include "base/json_reader.h"
#include "formats/documents/session_log.h"
#include "tests/cli/command.h"

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

namespace haptrace {
namespace {

const std::string kTrainee = "sim:preset=omega3,hand=relaxed,intent={path}";

std::string programme(const TempFolder& folder, const std::string& mode = "tunnel", int repetitions = 3) {
  const nlohmann::json json{{"haptrace_programme", 1},
                            {"title", "three circles"},
                            {"exercises",
                             {{{"name", "round & round"},
                               {"shape", {{"kind", "circle"}, {"size", 0.04}, {"duration", 1.5}}},
                               {"mode", mode},
                               {"rest", 0.5},
                               {"repetitions", repetitions}}}}};
  return folder.write("circles.json", json.dump());
}

TEST(RunCommand, PrintsItsPlanWithoutADevice) {
  const TempFolder folder;
  const Answer answer = haptrace("run", programme(folder), "--dry-run", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json["trials"], 3);
  EXPECT_NEAR(json["duration_s"].get<double>(), 3 * 2.5 + 2 * 0.5, 1e-6);
  EXPECT_EQ(json["exercises"][0]["mode"], "tunnel");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1) << "the dry run writes no file";
  EXPECT_THAT(haptrace("run", programme(folder), "--dry-run").out, HasSubstr("3 repetitions, about 8.5 s"));
  EXPECT_THAT(haptrace("run", programme(folder), "--dry-run", "--device", "sim:preset=omega3", "--scale", "9").err,
              HasSubstr("leaves the workspace"));
}

TEST(RunCommand, PrintsNothingWithQuiet) {
  const TempFolder folder;
  const Answer answer = haptrace("run", programme(folder), "--device", kTrainee, "-q");
  EXPECT_EQ(answer.exit_code, 0);
  EXPECT_EQ(answer.out + answer.err, "");
  EXPECT_TRUE(load_session_log(folder / "circles-session").complete)
      << "the session is beside the programme and has its name";
}

TEST(RunCommand, RunsTheSampleProgrammes) {
  const TempFolder folder;
  for (const char* name : {"reaching", "circles", "lesson"}) {
    const std::string session = folder / name;
    const Answer answer =
        haptrace("run", std::string(HAPTRACE_SAMPLES "/programmes/") + name + ".json", "--device",
                 "sim:preset=falcon,hand=relaxed,intent={path}", "-o", session, "--subject", "P07", "--json", "--fit");
    ASSERT_EQ(answer.exit_code, 0) << name << ": " << answer.err;
    EXPECT_TRUE(answer.json()["complete"]) << name;
    const SessionLog log = load_session_log(session);
    EXPECT_EQ(log.subject, "P07");
    EXPECT_GE(log.trials.size(), 17U);
    for (const LoggedTrial& trial : log.trials)
      EXPECT_TRUE(std::filesystem::exists(session + "/" + trial.file)) << trial.file;
  }
}

TEST(RunCommand, RunsReachesInAForceFieldAndReportsThem) {
  const TempFolder folder;
  nlohmann::json sample = load_json(HAPTRACE_SAMPLES "/programmes/field.json");
  sample["exercises"][0]["reach"]["blocks"] = {{{"name", "baseline"}, {"reaches", 2}},
                                               {{"name", "field"}, {"reaches", 8}, {"field", true}, {"clamps", 0.125}}};
  const std::string session = folder / "session";
  const Answer answer = haptrace("run", folder.write("field.json", sample.dump()), "--device",
                                 "sim:preset=falcon,hand=firm,intent={path}", "-o", session, "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err, AllOf(HasSubstr("1 of 10: centre-out, repetition 1 (target "), HasSubstr(", clamp"),
                                HasSubstr("lateral deviation at peak speed")));
  const nlohmann::json json = answer.json();
  ASSERT_EQ(json["trials"].size(), 10U);
  for (const nlohmann::json& trial : json["trials"]) {
    EXPECT_EQ(trial["stopped_by"], "finished") << trial;
    EXPECT_TRUE(trial["figures"]["reaction_time_s"].is_number()) << trial;
  }
  const nlohmann::json blocks = json["reaching"][0]["blocks"];
  EXPECT_EQ(blocks[1]["name"], "field");
  EXPECT_LT(blocks[1]["lateral_deviation_m"].get<double>(), blocks[0]["lateral_deviation_m"].get<double>())
      << "the field pushes to the right";
  const Answer report = haptrace("report", session, "--csv", folder / "trials.csv", "-o", folder / "page.html");
  EXPECT_EQ(report.exit_code, 0) << report.err;
  EXPECT_THAT(test::read_bytes(folder / "trials.csv"), HasSubstr("clamp"));
  EXPECT_THAT(test::read_bytes(folder / "page.html"),
              AllOf(HasSubstr("after-effect"), HasSubstr("Blocks of centre-out")));
}

TEST(RunCommand, AssessesRangeOfMotionTrackingAndForceAndReportsThem) {
  const TempFolder folder;
  nlohmann::json sample = load_json(HAPTRACE_SAMPLES "/programmes/assessments.json");
  for (nlohmann::json& exercise : sample["exercises"]) exercise["rest"] = 0;
  sample["exercises"][0]["range"]["tries"] = 1;
  sample["exercises"][1]["repetitions"] = 3;
  sample["exercises"][2]["repetitions"] = 1;
  sample["exercises"][3]["sense"]["tries"] = 2;
  sample["exercises"][4]["press"]["tries"] = 1;
  const std::string session = folder / "session";
  const Answer answer = haptrace("run", folder.write("assessments.json", sample.dump()), "--device",
                                 "sim:preset=falcon,hand=firm,intent={path}", "-o", session, "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err, AllOf(HasSubstr("1 of 24: range of motion, repetition 1 (direction "),
                                HasSubstr("range of motion"), HasSubstr("rms error of tracking")));
  const nlohmann::json json = answer.json();
  EXPECT_EQ(json["reaching"].size(), 1U);
  EXPECT_TRUE(json["reaching"][0]["blocks"][0]["reaction_time_s"].is_number());
  ASSERT_EQ(json["assessments"].size(), 4U);
  const nlohmann::json range = json["assessments"][0]["result"], track = json["assessments"][1]["result"],
                       sense = json["assessments"][2]["result"], press = json["assessments"][3]["result"];
  for (const nlohmann::json& direction : range["directions"]) {
    EXPECT_NEAR(direction["best_m"].get<double>(), 0.03, 3e-3) << "where the simulated hand wants to be";
    EXPECT_EQ(direction["at_limit"], false);
  }
  EXPECT_NEAR(range["area_m2"].get<double>(), 0.03 * 0.03 * 2 * std::sqrt(2.0), 4e-4) << "an octagon";
  EXPECT_NEAR(track["gain"].get<double>(), 1, 0.1);
  EXPECT_GT(track["rms_m"].get<double>(), 1e-3);
  EXPECT_EQ(sense["unanswered"], 10) << "nobody answers";
  for (const nlohmann::json& trial : json["trials"])
    EXPECT_EQ(trial["figures"]["sense_difference_m"].is_number(), trial["mode"] == "sense") << trial;
  EXPECT_EQ(press["directions"].size(), 2U);
  for (const nlohmann::json& direction : press["directions"]) EXPECT_GT(direction["best_n"].get<double>(), 0.5);
  const Answer report = haptrace("report", session, "--csv", folder / "trials.csv", "-o", folder / "page.html");
  EXPECT_EQ(report.exit_code, 0) << report.err;
  EXPECT_THAT(test::read_bytes(folder / "page.html"),
              AllOf(HasSubstr("Results of range of motion"), HasSubstr("Results of maximum force"),
                    HasSubstr("left the hand to follow a moving target")));
}

TEST(RunCommand, KeepsTheConfigurationOfItsTrialInEveryRecording) {
  const TempFolder folder;
  for (const char* mode : {"passive", "assisted", "tunnel", "cursor", "resist", "free"}) {
    const std::string session = folder / mode;
    ASSERT_EQ(haptrace("run", programme(folder, mode, 1), "--device", "sim:intent={path}", "-o", session).exit_code, 0);
    const std::string trial = session + "/" + load_session_log(session).trials.at(0).file;
    const nlohmann::json config = haptrace("info", trial, "--json").json()["config"];
    const std::string verb = config["verb"];
    const Answer answer = haptrace(verb, "--config", folder.write("again.json", config.dump()), "--record",
                                   folder / (std::string(mode) + ".h5"));
    EXPECT_EQ(answer.exit_code, 0) << mode << ": " << answer.err;
    EXPECT_EQ(haptrace("info", folder / (std::string(mode) + ".h5"), "--json").json()["samples"],
              haptrace("info", trial, "--json").json()["samples"])
        << mode;
  }
}

TEST(RunCommand, KeepsItsDataWhenInterruptedAndResumes) {
  const TempFolder folder;
  const std::string session = folder / "monday";
  Command command({"run", programme(folder, "free", 3), "--device", kTrainee, "-o", session, "--clock", "real",
                   "--subject", "P07", "--rate", "500"});
  ASSERT_TRUE(command.says("2 of 3"));
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  EXPECT_THAT(answer.out, HasSubstr("haptrace run --resume"));
  EXPECT_EQ(load_session_log(session).sittings.back().ended_by, "interrupted");
  EXPECT_EQ(load_session_log(session).sittings.back().stopped_from, "user");

  EXPECT_EQ(haptrace("run", "--resume", session, "--dry-run").exit_code, 2);
  const Answer other = haptrace("run", "--resume", session, "--subject", "P99");
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.err, HasSubstr("a session of 'P07', not of 'P99'"));
  EXPECT_THAT(haptrace("run", "--resume", session, "--scale", "2").err,
              HasSubstr("--scale applies only to the start of a session"));
  const Answer again = haptrace("run", "--resume", session, "--device", kTrainee, "--clock", "virtual", "--json");
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(load_session_log(session).complete);
  EXPECT_EQ(again.json()["sitting"]["number"], 2);
  const std::string last = session + "/" + load_session_log(session).trials.back().file;
  const nlohmann::json kept = haptrace("info", last, "--json").json();
  EXPECT_EQ(kept["rate_hz"], 500) << "the session resumes with its first rate";
  EXPECT_EQ(kept["subject"], "P07");
  const Answer done = haptrace("run", "--resume", session);
  EXPECT_EQ(done.exit_code, 2);
  EXPECT_THAT(done.err, HasSubstr("is complete"));
}

TEST(RunCommand, TakesNoDeviceAndNoLimitsFromAFolder) {
  const TempFolder folder;
  const std::string session = folder / "it's monday";
  Command command({"run", programme(folder, "free", 3), "--device", kTrainee, "-o", session, "--clock", "real",
                   "--max-velocity", "3", "--max-force", "2.5"});
  ASSERT_TRUE(command.says("2 of 3"));
  kill(command.pid(), SIGINT);
  const std::string resume = "haptrace run --resume '" + folder.path() + "/it'\\''s monday' --device '" +
                             std::string(kTrainee) + "' --max-force 2.5 --max-velocity 3";
  EXPECT_THAT(command.wait().out, HasSubstr("resume with: " + resume));

  // A folder from another user names another device: a library, and no speed limit.
  nlohmann::json log = nlohmann::json::parse(test::read_bytes(session + "/session.json"));
  log["config"]["device"] = "plugin:path=" MASS_PLUGIN;
  log["config"]["max-velocity"] = 0;
  (void)folder.write("it's monday/session.json", log.dump());
  for (const std::vector<std::string>& given : {std::vector<std::string>{},
                                                {"--device", kTrainee},
                                                {"--device", kTrainee, "--max-force", "2.5"},
                                                {"--max-force", "2.5", "--max-velocity", "3"}}) {
    std::vector<std::string> words{"run", "--resume", session, "--clock", "virtual"};
    words.insert(words.end(), given.begin(), given.end());
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2);
    EXPECT_THAT(answer.err,
                AllOf(HasSubstr("the device and the safety limits of a session are not taken from its folder"),
                      HasSubstr("--max-velocity 0"), HasSubstr("--device 'plugin:path=" MASS_PLUGIN "'")));
  }
  EXPECT_EQ(load_session_log(session).sittings.size(), 1U);
  const Answer again = haptrace("run", "--resume", session, "--clock", "virtual", "--device", kTrainee, "--max-force",
                                "2", "--max-velocity", "1.5");
  EXPECT_EQ(again.exit_code, 0) << again.err;
  const std::string last = session + "/" + load_session_log(session).trials.back().file;
  EXPECT_EQ(haptrace("info", last, "--json").json()["config"]["max-force"], 2) << "the command line takes precedence";
}

TEST(RunCommand, CreatesASessionThatNoOtherUserCanOpen) {
  const TempFolder folder;
  const mode_t before = umask(022);
  std::filesystem::permissions(folder.path(), std::filesystem::perms(0755));
  const std::string session = folder / "s";
  EXPECT_EQ(haptrace("run", programme(folder, "free", 1), "--device", kTrainee, "-o", session).exit_code, 0);
  umask(before);
  EXPECT_EQ(std::filesystem::status(session).permissions(), std::filesystem::perms(0700));
  for (const auto& entry : std::filesystem::recursive_directory_iterator(session))
    EXPECT_EQ(entry.status().permissions(), std::filesystem::perms(entry.is_directory() ? 0700 : 0600)) << entry.path();
}

TEST(RunCommand, LetsNoSecondProcessIntoItsSession) {
  const TempFolder folder;
  const std::string session = folder / "s";
  Command first({"run", programme(folder, "free", 2), "--device", kTrainee, "-o", session, "--clock", "real"});
  ASSERT_TRUE(first.says("1 of 2"));
  const Answer second = haptrace("run", "--resume", session, "--device", kTrainee, "--clock", "virtual");
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_THAT(second.err, HasSubstr("another process runs this session"));
  kill(first.pid(), SIGINT);
  EXPECT_EQ(first.wait().exit_code, 130);
  EXPECT_EQ(load_session_log(session).sittings.size(), 1U);
}

TEST(RunCommand, PausesAndResumesByAKey) {
  const TempFolder folder;
  Command command(
      {"run", programme(folder, "free", 2), "--device", kTrainee, "-o", folder / "s", "--keys", "--clock", "real"},
      Command::Input::pipe);
  ASSERT_TRUE(command.says("1 of 2"));
  command.type("p");
  const auto trials = [&] { return load_session_log(folder / "s").trials.size(); };
  for (int k = 0; k < 3000 && trials() == 0; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  // A pause shows as the absence of a trial. This is longer than the rest before the second trial plus that trial.
  std::this_thread::sleep_for(std::chrono::seconds(4));
  EXPECT_EQ(trials(), 1U);
  command.type("p");
  EXPECT_EQ(command.wait().exit_code, 0);
  EXPECT_EQ(load_session_log(folder / "s").trials.size(), 2U);
}

TEST(RunCommand, GivesASimulatedHandNewNoiseInEveryRepetitionAndSitting) {
  const TempFolder folder;
  const std::string file = programme(folder, "cursor", 2);
  const auto places = [&](const std::string& session) {
    std::vector<std::vector<double>> repetitions;
    for (const LoggedTrial& trial : load_session_log(folder / session).trials) {
      repetitions.emplace_back();
      for (const Sample& sample : RecordingReader(folder / (session + "/" + trial.file)).read(0, 500))
        repetitions.back().push_back(sample.position.y());
    }
    return repetitions;
  };
  for (const char* session : {"first", "again"})
    ASSERT_EQ(haptrace("run", file, "--device", kTrainee + ",seed=7", "-o", folder / session, "-q").exit_code, 0);
  const auto first = places("first");
  ASSERT_EQ(first.size(), 2U);
  EXPECT_NE(first[0], first[1]) << "also with a seed in the description of the device";
  EXPECT_EQ(first, places("again"));
}

TEST(RunCommand, WarnsOfASupportThatTheDeviceLimitsInADryRunToo) {
  const TempFolder folder;
  nlohmann::json json = load_json(programme(folder));
  json["support"] = 3;
  const std::string file = folder.write("supported.json", json.dump());
  const auto errors = [&](const std::string& limit) {
    const Answer answer =
        haptrace("run", file, "--dry-run", "--device", "sim:preset=omega3,hand=relaxed", "--max-force", limit);
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    return answer.err;
  };
  EXPECT_THAT(errors("2"), HasSubstr("the arm is supported with 1.4 N instead of 3 N"));
  EXPECT_THAT(errors("12"), HasSubstr("instead of 3 N: Force Dimension omega.3 can hold no more for long"));
  EXPECT_THAT(haptrace("run", file, "--dry-run").err, Not(HasSubstr("instead of"))) << "without a device";
}

TEST(RunCommand, NamesTheFileOfANoteOnce) {
  const TempFolder folder;
  const std::string expert = folder / "expert.h5";
  ASSERT_EQ(haptrace("record", expert, "--device",
                     "sim:preset=omega3,hand=relaxed,spec=" + folder.write("s.json", R"({"force_sensor": true})"),
                     "--duration", "3", "--support", "1", "--up", "0,0,1")
                .exit_code,
            0);
  nlohmann::json json = load_json(programme(folder));
  json["exercises"][0].erase("shape");
  json["exercises"][0]["path"] = "expert.h5";
  const Answer answer = haptrace("run", folder.write("p.json", json.dump()), "--dry-run");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const std::string named = expert + ": ";
  EXPECT_THAT(answer.err, HasSubstr(named + "the support of the expert's arm is left out of the force"));
  EXPECT_THAT(answer.err, HasSubstr(named + "its measured force is not replayed"));
  EXPECT_THAT(answer.err, Not(HasSubstr(named + named)));
}

TEST(RunCommand, ReportsErrorsBeforeItWritesAnything) {
  const TempFolder folder;
  const std::string file = programme(folder);
  const auto error = [&](const std::vector<std::string>& words) {
    std::vector<std::string> all{"run"};
    all.insert(all.end(), words.begin(), words.end());
    const Answer answer = Command(all).wait();
    EXPECT_EQ(answer.exit_code, 2) << answer.err;
    return answer.err;
  };
  EXPECT_THAT(error({}), HasSubstr("needs PROGRAMME.json, or --resume"));
  EXPECT_THAT(error({file}), HasSubstr("needs --device"));
  EXPECT_THAT(error({folder / "none.json", "--dry-run"}), HasSubstr("none.json: cannot be read"));
  EXPECT_THAT(error({programme(folder, "tunel"), "--dry-run"}), HasSubstr("exercises[0].mode: 'tunel'"));
  EXPECT_THAT(error({file, "--mirror", "up", "--dry-run"}), HasSubstr("--mirror: unknown mirror axis 'up'"));
  EXPECT_THAT(error({file, "--resume", folder.path()}), HasSubstr("do not name another one"));
  EXPECT_THAT(error({"--resume", folder.path(), "--device", kTrainee}), HasSubstr("session.json"));
  EXPECT_THAT(error({file, "--device", kTrainee, "--profile", "a.json", "--no-profile"}),
              HasSubstr("exclude each other"));
  EXPECT_THAT(error({file, "--dry-run", "--fit"}), HasSubstr("give --device too"));
  EXPECT_THAT(error({programme(folder), "--device", kTrainee, "-o", folder / "a,b"}), HasSubstr("comma"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a,b"));
  EXPECT_FALSE(std::filesystem::exists(folder / "circles-session"));
}

}  // namespace
}  // namespace haptrace
