// Tests of recording in experiments: triggers, trials, marks, metadata, parts, and the recording of a killed session.
#include "formats/recording/recording.h"
#include "formats/recording/recording_summary.h"
#include "tests/cli/command.h"
#include "tests/cli/live_recording.h"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <thread>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using testing::Contains;

void sleep(double seconds) {
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

std::vector<std::string> texts_of_events(const std::string& file, EventCode code) {
  std::vector<std::string> texts;
  for (const StoredEvent& event : RecordingReader(file).events())
    if (event.code == static_cast<int>(code)) texts.push_back(event.text);
  return texts;
}

double duration_of(const RecordingReader& reader) {
  return 1e-9 * static_cast<double>(reader.read(reader.rows() - 1, 1).front().time_ns);
}

std::string moving_hand(const TempFolder& folder) {
  EXPECT_EQ(haptrace("shape", "line", "--size", "0.05", "--duration", "2", "-o", folder / "line.h5").exit_code, 0);
  return "sim:preset=falcon,hand=firm,seed=1,intent=" + (folder / "line.h5");
}

TEST(Capture, StartsBeforeTheTrigger) {
  const TempFolder folder;
  const Answer answer = haptrace("record", folder / "a.h5", "--device", moving_hand(folder), "--trigger", "speed>0.02",
                                 "--pre", "0.1", "--duration", "0.5", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.read(0, 1).front().time_ns, 0);
  EXPECT_GT(reader.read(0, 1).front().tick, 10U) << "the hand starts at rest";
  EXPECT_NEAR(duration_of(reader), 0.6, 1e-6);
  ASSERT_EQ(texts_of_events(folder / "a.h5", EventCode::triggered).size(), 1U);
  for (const Sample& sample : reader.read(0, 99)) EXPECT_LE(sample.velocity.norm(), 0.02);
  EXPECT_GT(reader.read(100, 1).front().velocity.norm(), 0.02);
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
}

TEST(Capture, RefusesATriggerThatCannotFire) {
  const TempFolder folder;
  const std::string csv = folder.write("path.csv", "t,x,y,z\n0,0,0,0\n1,0.1,0,0\n");
  const Answer sensor = haptrace("record", folder / "a.h5", "--device", "replay:file=" + csv, "--trigger", "force>1N");
  EXPECT_EQ(sensor.exit_code, 2);
  EXPECT_THAT(sensor.err, HasSubstr("no force sensor"));
  const Answer slip = haptrace("record", folder / "a.h5", "--device", kFalcon, "--trigger", "sped>1");
  EXPECT_EQ(slip.exit_code, 2);
  EXPECT_THAT(slip.err, AllOf(HasSubstr("'sped>1'"), HasSubstr("force>0.5N")));
  const Answer alone = haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "1", "--pre", "2");
  EXPECT_EQ(alone.exit_code, 2);
  EXPECT_THAT(alone.err, HasSubstr("--trigger"));
  EXPECT_FALSE(fs::exists(folder / "a.h5"));
}

TEST(Capture, RecordsTrialAfterTrialIntoNumberedFiles) {
  const TempFolder folder;
  const Answer answer = haptrace("record", folder / "reach.h5", "--device", moving_hand(folder), "--count", "3",
                                 "--pause", "0.5", "--duration", "1", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["trials"].size(), 3U);
  EXPECT_FALSE(fs::exists(folder / "reach.h5"));
  for (int trial = 1; trial <= 3; ++trial) {
    const std::string file = folder / ("reach-00" + std::to_string(trial) + ".h5");
    const RecordingReader reader(file);
    EXPECT_EQ(reader.header().meta.at("trial"), std::to_string(trial));
    EXPECT_EQ(reader.header().meta.at("trials"), "3");
    EXPECT_NEAR(duration_of(reader), 1, 1e-6);
    EXPECT_GT((reader.read(999, 1).front().position - reader.read(0, 1).front().position).norm(), 0.01)
        << "the hand follows its path in every trial";
  }
}

TEST(Capture, RecordsTrialsOfASimulatedHandThatDifferAndRepeatsThemAsASeries) {
  const TempFolder folder;
  const std::string hand = moving_hand(folder);
  const auto movement = [&](const std::string& name, int trial) {
    std::vector<double> heights;
    for (const Sample& sample : RecordingReader(folder / (name + "-00" + std::to_string(trial) + ".h5")).read(0, 500))
      heights.push_back(sample.position.y());
    return heights;
  };
  for (const char* name : {"first", "again"})
    ASSERT_EQ(
        haptrace("record", folder / (std::string(name) + ".h5"), "--device", hand, "--count", "2", "--duration", "0.5")
            .exit_code,
        0);
  EXPECT_NE(movement("first", 1), movement("first", 2)) << "no hand does the same twice";
  for (const int trial : {1, 2}) EXPECT_EQ(movement("first", trial), movement("again", trial));
}

TEST(Capture, RejectsTrialsIfOneFileExists) {
  const TempFolder folder;
  const std::string there = folder.write("reach-002.h5", "mine");
  const Answer answer =
      haptrace("record", folder / "reach.h5", "--device", kFalcon, "--duration", "0.1", "--count", "3");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, AllOf(HasSubstr("reach-002.h5"), HasSubstr("trial 2"), HasSubstr("--overwrite")));
  EXPECT_FALSE(fs::exists(folder / "reach-001.h5"));
}

TEST(Capture, EndsTheTrialsWhenOneIsInterrupted) {
  const TempFolder folder;
  Command command(
      {"record", folder / "a.h5", "--device", kFalcon, "--clock", "real", "--duration", "60", "--count", "5"});
  ASSERT_TRUE(test::wait_for_rows(folder / "a-001.h5", 100));
  kill(command.pid(), SIGTERM);
  EXPECT_EQ(command.wait().exit_code, 130);
  EXPECT_TRUE(RecordingReader(folder / "a-001.h5").header().complete);
  EXPECT_FALSE(fs::exists(folder / "a-002.h5"));
}

TEST(Capture, KeepsMetadataFromTheCommandLineAndATemplate) {
  const TempFolder folder;
  const std::string form =
      folder.write("form.json", R"({"subject": null, "hand": null, "table_height_m": 0.72, "operator": "R. Lee"})");
  const Answer missing = haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1", "--meta-file",
                                  form, "--meta", "hand=left");
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.err, AllOf(HasSubstr("subject"), HasSubstr("--meta subject=")));
  EXPECT_FALSE(fs::exists(folder / "a.h5"));

  const Answer given = haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1", "--meta-file",
                                form, "--meta", "hand=left", "--meta", "subject=S=7", "--operator", "Q");
  ASSERT_EQ(given.exit_code, 0) << given.err;
  const RecordingHeader header = RecordingReader(folder / "a.h5").header();
  EXPECT_EQ(header.subject, "S=7");
  EXPECT_EQ(header.operator_name, "Q");
  EXPECT_EQ(header.meta, (std::map<std::string, std::string>{{"hand", "left"}, {"table_height_m", "0.72"}}));
  EXPECT_THAT(haptrace("info", folder / "a.h5").out, AllOf(HasSubstr("hand"), HasSubstr("left")));

  const Answer slip = haptrace("record", folder / "b.h5", "--device", kFalcon, "--duration", "0.1", "--meta", "left");
  EXPECT_EQ(slip.exit_code, 2);
  EXPECT_THAT(slip.err, HasSubstr("KEY=VALUE"));
}

TEST(Capture, TakesMarksPausesAndTheEndFromKeys) {
  const TempFolder folder;
  Command command({"record", folder / "a.h5", "--device", kFalcon, "--clock", "real", "--mark-texts", "rest,reach"},
                  Command::Input::terminal);
  ASSERT_TRUE(test::wait_for_rows(folder / "a.h5", 100));
  command.type("m2");
  command.type("thello\x7f there\n");
  command.type("p");
  ASSERT_TRUE(test::wait_for_event(folder / "a.h5", EventCode::paused));
  sleep(0.3);
  command.type("p");
  ASSERT_TRUE(test::wait_for_event(folder / "a.h5", EventCode::resumed));
  command.type("q");
  EXPECT_EQ(command.wait().exit_code, 130);
  EXPECT_EQ(texts_of_events(folder / "a.h5", EventCode::mark),
            (std::vector<std::string>{"mark 1", "reach", "hell there"}));
  EXPECT_EQ(texts_of_events(folder / "a.h5", EventCode::paused).size(), 1U);
  EXPECT_EQ(texts_of_events(folder / "a.h5", EventCode::resumed).size(), 1U);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_GE(summarise(reader).longest_interval, 0.3);
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
}

TEST(Capture, TakesKeysFromAPipeOnlyOnRequest) {
  const TempFolder folder;
  for (const bool asked : {false, true}) {
    std::vector<std::string> words{"record", folder / "a.h5", "--device", kFalcon,      "--clock",
                                   "real",   "--duration",    "0.6",      "--overwrite"};
    if (asked) words.emplace_back("--keys");
    Command command(words, Command::Input::pipe);
    command.type("m");
    EXPECT_EQ(command.wait().exit_code, 0);
    EXPECT_EQ(texts_of_events(folder / "a.h5", EventCode::mark).size(), asked ? 1U : 0U);
  }
}

TEST(Capture, ContinuesInFurtherFilesThatEveryVerbReadsAsOne) {
  const TempFolder folder;
  const Answer answer = haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "5", "--split", "2s",
                                 "--sync", "1", "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["parts"], 3);
  EXPECT_TRUE(fs::exists(folder / "a.part003.h5"));
  EXPECT_EQ(haptrace("info", folder / "a.h5", "--json").json()["samples"], 5001);
  EXPECT_EQ(RecordingReader(folder / "a.part002.h5").rows(), 2000U);
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
  EXPECT_EQ(haptrace("plot", folder / "a.h5").exit_code, 0);
  const Answer slip =
      haptrace("record", folder / "b.h5", "--device", kFalcon, "--duration", "1", "--split", "2 bananas");
  EXPECT_EQ(slip.exit_code, 2);
  EXPECT_THAT(slip.err, HasSubstr("30min or 1GiB"));
}

TEST(Capture, CompressesAndRoundsWhileItRecords) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "5").exit_code, 0);
  ASSERT_EQ(haptrace("record", folder / "b.h5", "--device", kFalcon, "--duration", "5", "--compress", "1",
                     "--precision", "1um,1mN,0.1mm/s")
                .exit_code,
            0);
  EXPECT_LT(fs::file_size(folder / "b.h5"), fs::file_size(folder / "a.h5") / 2);
  const RecordingReader plain(folder / "a.h5"), packed(folder / "b.h5");
  const auto a = plain.read(0, plain.rows()), b = packed.read(0, packed.rows());
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_LE((a[i].position - b[i].position).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LE((a[i].velocity - b[i].velocity).cwiseAbs().maxCoeff(), 1e-4);
  }
  const Answer slow =
      haptrace("record", folder / "c.h5", "--device", kFalcon, "--duration", "5", "--compress", "1", "--rate", "100");
  EXPECT_EQ(slow.exit_code, 2);
  EXPECT_THAT(slow.err, HasSubstr("haptrace convert --compress"));
}

TEST(Recover, CompletesTheRecordingOfAKilledSession) {
  const TempFolder folder;
  Command command({"record", folder / "a.h5", "--device", kFalcon, "--clock", "real", "--duration", "60"});
  ASSERT_TRUE(test::wait_for_rows(folder / "a.h5", 300));
  const Answer refused = haptrace("recover", folder / "a.h5");
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("being written by a running session"));
  kill(command.pid(), SIGKILL);
  command.wait();

  const std::uint64_t rows = RecordingReader(folder / "a.h5").rows();
  EXPECT_GE(rows, 300U);
  const Answer recovered = haptrace("recover", folder / "a.h5", "--json");
  EXPECT_EQ(recovered.exit_code, 0) << recovered.err;
  EXPECT_EQ(recovered.json()["samples"], rows);
  EXPECT_EQ(recovered.json()["needed"], true);
  EXPECT_EQ(haptrace("recover", folder / "a.h5", "--json").json()["needed"], false);
  const Answer check = haptrace("check", folder / "a.h5");
  EXPECT_EQ(check.exit_code, 0);
  EXPECT_THAT(check.out, Not(HasSubstr("not finished")));
}

}  // namespace
}  // namespace haptrace
