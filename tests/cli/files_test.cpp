// Tests of files: no verb replaces or loses a file without a message, and all files that the verbs write are valid.
#include "base/output_file.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"
#include "tests/cli/live_recording.h"

#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <fstream>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using test::read_bytes;

std::string path_in(const TempFolder& folder, const std::string& name = "square.h5") {
  const std::string file = folder / name;
  EXPECT_EQ(haptrace("shape", "square", "--size", "0.04", "--duration", "2", "-o", file).exit_code, 0);
  return file;
}

TEST(TheCommand, RejectsEmptyNamesAndNamesTheOption) {
  const TempFolder folder;
  const std::string path = path_in(folder), before = read_bytes(path);
  const std::vector<std::pair<std::vector<std::string>, std::string>> slips{
      {{"record", "", "--device", kFalcon, "--duration", "0.1"}, "file"},
      {{"record", folder / "a.h5", "--device", "", "--duration", "0.1"}, "--device"},
      {{"record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1", "--scene", ""}, "--scene"},
      {{"play", path, "--device", kFalcon, "--record", ""}, "--record"},
      {{"play", path, "--device", kFalcon, "--profile", " "}, "--profile"},
      {{"guide", path, "--device", kFalcon, "--record", ""}, "--record"},
      {{"calibrate", "--device", kFalcon, "-o", ""}, "--output"},
      {{"recover", path, "-o", ""}, "--output"},
      {{"convert", path, "-o", ""}, "--output"},
      {{"plot", path, "-o", ""}, "--output"},
      {{"report", path, "--csv", ""}, "--csv"},
      {{"shape", "square", "-o", ""}, "--output"},
      {{"info", ""}, "file"},
      {{"check", ""}, "file"},
      {{"info", path, "--config", ""}, "--config"}};
  for (const auto& [words, option] : slips) {
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2) << words[0] << " " << option << answer.err;
    EXPECT_THAT(answer.err, AllOf(HasSubstr(option), HasSubstr("is empty"))) << words[0];
  }
  EXPECT_EQ(read_bytes(path), before);
  EXPECT_EQ(haptrace("record", folder / "b.h5", "--device", kFalcon, "--duration", "0.1", "--subject", "").exit_code,
            0);
}

TEST(TheCommand, NeverReplacesItsInput) {
  const TempFolder folder;
  const std::string path = path_in(folder), before = read_bytes(path), link = folder / "link.h5";
  fs::create_symlink(path, link);
  const std::vector<std::vector<std::string>> slips{
      {"play", path, "--device", kFalcon, "--record", path, "--overwrite"},
      {"play", path, "--device", kFalcon, "--record", link, "--overwrite"},
      {"play", path, "--device", kFalcon, "--record", (folder / ".") + "/square.h5", "--overwrite"},
      {"guide", path, "--device", kFalcon, "--record", path, "--overwrite"},
      {"record", path, "--device", "sim:hand=relaxed,intent=" + path, "--duration", "0.1", "--overwrite"},
      {"convert", path, "-o", path, "--overwrite", "--from", "1"},
      {"recover", path, "-o", path, "--overwrite"},
      {"plot", path, "-o", path, "--overwrite"}};
  for (const auto& words : slips) {
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2) << words[0] << answer.err;
    EXPECT_THAT(answer.err, HasSubstr("choose another name")) << words[0];
    EXPECT_EQ(read_bytes(path), before) << words[0];
  }
}

TEST(TheCommand, DoesNotReplaceARecordingThatIsBeingWritten) {
  const TempFolder folder;
  const std::string path = path_in(folder), file = folder / "live.h5";
  Command session({"record", file, "--device", kFalcon, "--clock", "real"});
  ASSERT_TRUE(test::wait_for_rows(file, 300));
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"record", file, "--device", kFalcon, "--duration", "0.1", "--overwrite"},
        {"play", path, "--device", kFalcon, "--record", file, "--overwrite"},
        {"convert", path, "-o", file, "--overwrite"},
        {"shape", "circle", "-o", file, "--overwrite"}}) {
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 2) << words[0] << answer.err;
    EXPECT_THAT(answer.err, HasSubstr("being written")) << words[0];
  }
  kill(session.pid(), SIGINT);
  EXPECT_EQ(session.wait().exit_code, 130);
  EXPECT_EQ(haptrace("check", file).exit_code, 0);
  EXPECT_EQ(haptrace("record", file, "--device", kFalcon, "--duration", "0.1", "--overwrite").exit_code, 0);
}

TEST(TheCommand, RemovesTheFilesOfAKilledConversionAndNothingElse) {
  const TempFolder folder;
  const std::string file = folder / "long.csv", converted = folder / "long.h5";
  {
    std::ofstream text(file);
    text << "t,x,y,z\n";
    for (int i = 0; i < 2'000'000; ++i) text << fmt::format("{},{},0,0\n", 1e-3 * i, 1e-5 * (i % 1000));
  }
  const auto unfinished = [&] {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder.path()))
      if (entry.path().extension() == ".unfinished") names.push_back(entry.path());
    return names;
  };
  {
    Command killed({"convert", file, "-o", converted});
    for (int i = 0; i < 60000 && unfinished().empty(); ++i) usleep(1000);
    // A running process keeps its unfinished file.
    EXPECT_TRUE(remove_leftovers(converted).empty());
    EXPECT_FALSE(unfinished().empty());
    kill(killed.pid(), SIGKILL);
    killed.wait();
  }
  const std::vector<std::string> left = unfinished();
  ASSERT_FALSE(left.empty());
  const std::string mine = folder.write("long.h5.20261123", "a copy"), other = folder.write("other.h5.unfinished", "");
  const std::string elsewhere = folder.write("long.h5.00000000-1-0000.unfinished", "of another machine");

  const std::string path = path_in(folder);
  const Answer answer = haptrace("convert", path, "-o", converted);
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err, AllOf(HasSubstr("removed " + left.front()), HasSubstr("left unfinished")));
  for (const std::string& each : left) EXPECT_FALSE(fs::exists(each)) << each;
  for (const std::string& kept : {mine, other, elsewhere}) EXPECT_TRUE(fs::exists(kept)) << kept;
  EXPECT_EQ(haptrace("check", converted).exit_code, 0);
}

TEST(TheCommand, ReportsThatAFullStandardOutputLostItsResults) {
  const TempFolder folder;
  const std::string path = path_in(folder);
  const std::string words = fmt::format("'{}' info '{}' --json", HAPTRACE_COMMAND, path);
  Command full({"-c", words + " > /dev/full"}, Command::Input::none, {}, "/bin/sh");
  const Answer answer = full.wait();
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr("could not be written to standard output"));
  // A reader that closes the pipe early causes no error.
  Command pipe({"-c", words + " | true"}, Command::Input::none, {}, "/bin/sh");
  EXPECT_THAT(pipe.wait().err, Not(HasSubstr("standard output")));
}

TEST(TheCommand, RejectsOtherFileTypesForARecording) {
  const TempFolder folder;
  for (const char* name : {"x.csv", "x.CSV", "x.jsonl", "x.xdf", "x.txt"}) {
    const Answer answer = haptrace("record", folder / name, "--device", kFalcon, "--duration", "0.1");
    EXPECT_EQ(answer.exit_code, 2) << name;
    EXPECT_THAT(answer.err, AllOf(HasSubstr("HDF5"), HasSubstr("x.h5"), HasSubstr("convert"))) << name;
    EXPECT_FALSE(fs::exists(folder / name));
  }
  EXPECT_EQ(haptrace("record", folder / "trial.2", "--device", kFalcon, "--duration", "0.1").exit_code, 0);
}

TEST(TheCommand, RejectsATextOfAMarkThatIsTooLong) {
  const TempFolder folder;
  const std::string longest(kLongestEventText, 'a');
  EXPECT_EQ(
      haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1", "--mark-texts", longest).exit_code,
      0);
  const Answer answer =
      haptrace("record", folder / "b.h5", "--device", kFalcon, "--duration", "0.1", "--mark-texts", longest + "b");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, AllOf(HasSubstr("--mark-texts"), HasSubstr("128 bytes"), HasSubstr("127")));
}

TEST(TheCommand, WritesOnlyFilesThatPassCheckWithoutAFinding) {
  const TempFolder folder;
  const std::string path = path_in(folder), base = folder / "";
  const auto run = [&](std::vector<std::string> words) {
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 0) << fmt::format("{}", fmt::join(words, " ")) << "\n" << answer.err;
  };
  for (const char* shape : {"circle", "line", "figure8", "reach", "spiral", "script"})
    if (haptrace("shape", shape, "-o", base + shape + ".h5").exit_code != 0) ADD_FAILURE() << shape;
  run({"record", base + "record.h5", "--device", kFalcon, "--duration", "2"});
  run({"record", base + "real.h5", "--device", kFalcon, "--duration", "1", "--clock", "real"});
  run({"record", base + "rounded.h5", "--device", kFalcon, "--duration", "2", "--precision", "1um,1mN", "--compress",
       "6"});
  run({"record", base + "split.h5", "--device", kFalcon, "--duration", "5", "--split", "1s"});
  run({"record", base + "triggered.h5", "--device", kFalcon, "--duration", "1", "--trigger", "speed>0.0", "--pre",
       "0.1"});
  run({"record", base + "trial.h5", "--device", kFalcon, "--duration", "0.5", "--count", "2"});
  run({"record", base + "scene.h5", "--device", kFalcon, "--duration", "2", "--scene",
       HAPTRACE_SAMPLES "/scenes/sphere.json"});
  run({"play", path, "--device", kFalcon, "--record", base + "played.h5"});
  run({"play", path, "--device", kFalcon, "--record", base + "paused.h5", "--repeat", "2", "--on-deviation", "pause"});
  run({"guide", path, "--device", kFalcon, "--record", base + "guided.h5"});
  run({"calibrate", "--quick", "--device", kFalcon, "--record", base + "calibration.h5", "-o", base + "profile.json"});
  for (const char* kind : {"csv", "jsonl"}) {
    run({"convert", base + "played.h5", "-o", base + "played." + kind});
    run({"convert", base + "played." + kind, "-o", base + "back_" + kind + ".h5"});
  }
  run({"convert", base + "real.h5", "-o", base + "slow.h5", "--resample", "100"});
  run({"convert", base + "real.h5", "-o", base + "packed.h5", "--precision", "1um,1mN", "--compress", "6"});
  run({"convert", base + "real.h5", "-o", base + "cut.h5", "--from", "0.2", "--to", "0.7"});
  run({"convert", base + "real.h5", "-o", base + "anonymous.h5", "--anonymise"});
  run({"convert", base + "real.h5", "-o", base + "old.h5", "--libver", "1.8"});
  {
    Command killed({"record", base + "killed.h5", "--device", kFalcon, "--clock", "real"});
    ASSERT_TRUE(test::wait_for_rows(base + "killed.h5", 300));
    kill(killed.pid(), SIGKILL);
    killed.wait();
  }
  run({"recover", base + "killed.h5"});

  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    const std::string file = entry.path();
    if (entry.path().extension() != ".h5" || file.find(".part") != std::string::npos) continue;
    ++files;
    const Answer answer = haptrace("check", file, "--json");
    EXPECT_EQ(answer.exit_code, 0) << answer.out;
    EXPECT_TRUE(answer.json()["findings"].empty()) << answer.out;
    // Info does not warn about these files either.
    for (const char* alarm : {"steps", "stuck", "constant", "repeat"})
      EXPECT_THAT(haptrace("info", file).err, Not(HasSubstr(alarm))) << file;
  }
  EXPECT_GE(files, 27U);
}

}  // namespace
}  // namespace haptrace
