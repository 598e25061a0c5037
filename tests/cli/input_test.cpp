// Tests of the verbs' input: CSV of other programs, standard input and pipes.
#include "base/printable.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sys/stat.h>
#include <thread>

namespace haptrace {
namespace {

using test::read_bytes;

const std::string kExcel = "Zeit [ms];X [mm];Y [mm];Z [mm]\r\n0;1,0;2,0;3,0\r\n10;1,5;-2,0;3,0\r\n";

/// Runs haptrace in a shell, so that its standard input can be a pipe that ends. `script` calls it as "$0".
Answer in_shell(const std::string& script, const std::vector<std::string>& words = {}) {
  std::vector<std::string> arguments{"-c", script, HAPTRACE_COMMAND};
  arguments.insert(arguments.end(), words.begin(), words.end());
  return Command(arguments, Command::Input::none, {}, "/bin/sh").wait();
}

/// Writes a stroke of 80 mm in 2 s to a file in millimetres and milliseconds.
std::string stroke_in_millimetres(const TempFolder& folder) {
  std::string text = "time_ms,a,b,c\n";
  for (int i = 0; i <= 200; ++i) text += std::to_string(10 * i) + "," + std::to_string(0.4 * i - 40) + ",0,0\n";
  return folder.write("stroke.csv", text);
}

TEST(Input, FromAnotherProgramIsConvertedPrintedAndValid) {
  const TempFolder folder;
  const std::string file = folder.write("excel.csv", kExcel);
  const Answer answer = haptrace("convert", file, "--json");
  ASSERT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_THAT(answer.err, HasSubstr("position is read from 'X [mm]', 'Y [mm]', 'Z [mm]' in mm: the header says so"));
  EXPECT_THAT(answer.json()["notes"].dump(), HasSubstr("time is read from 'Zeit [ms]' in ms"));
  EXPECT_EQ(haptrace("check", folder / "excel.h5").exit_code, 0);
  const Answer info = haptrace("info", file, "--json");
  EXPECT_EQ(info.json()["position_max_m"][0], 0.0015);
  EXPECT_THAT(info.json()["notes"].dump(), HasSubstr("numbers have decimal commas"));
}

TEST(Input, TakesColumnsAndUnitsInEveryVerbThatReadsAPath) {
  const TempFolder folder;
  const std::string file = stroke_in_millimetres(folder);
  const std::vector<std::string> options{"--columns", "x=a,y=b", "--columns", "z=c", "--units", "mm"};
  for (std::vector<std::string> words :
       std::vector<std::vector<std::string>>{{"info", file},
                                             {"convert", file, "-o", folder / "a.h5"},
                                             {"plot", file, "-o", folder / "a.svg"},
                                             {"play", file, "--device", kFalcon, "--record", folder / "played.h5"},
                                             {"guide", file, "--device", "sim:preset=falcon,hand=relaxed,seed=3",
                                              "--mode", "free", "--time-limit", "1"}}) {
    EXPECT_EQ(Command(words).wait().exit_code, 2) << words[0];
    words.insert(words.end(), options.begin(), options.end());
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 0) << words[0] << ": " << answer.err;
    EXPECT_THAT(answer.err + answer.out, HasSubstr("position is read from 'a', 'b', 'c' in mm: --units says so"))
        << words[0];
  }
  EXPECT_EQ(RecordingReader(folder / "played.h5").header().config["units"], "mm");
  EXPECT_THAT(haptrace("info", file, "--columns", "x=A B,y=b,z=c").err,
              HasSubstr("--columns x=A B: the file has no column 'A B'; it has time_ms, a, b, c"));
  EXPECT_THAT(haptrace("info", file, "--units", "parsec").err,
              HasSubstr("--units parsec: 'parsec' is not a known unit"));
  EXPECT_THAT(haptrace("info", folder / "a.h5", "--units", "mm").err, HasSubstr("is a recording (HDF5)"));
}

TEST(Input, AsksWhetherFiftyMetresAreMillimetres) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv", "t,x,y,z\n0,0,0,0\n1,50,0,0\n");
  for (const char* verb : {"info", "convert"}) {
    const Answer asked = haptrace(verb, file);
    EXPECT_EQ(asked.exit_code, 2);
    EXPECT_THAT(asked.err, AllOf(HasSubstr("a.csv:3: column x: 50 m"), HasSubstr("Are these millimetres?"),
                                 HasSubstr("--units mm")));
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "a.h5"));
  EXPECT_EQ(haptrace("info", file, "--units", "mm", "--json").json()["position_max_m"][0], 0.05);
}

TEST(Input, ComesThroughStandardInputAndLeavesThroughStandardOutput) {
  const TempFolder folder;
  const std::string file = folder.write("excel.csv", kExcel);
  const Answer there = in_shell(R"(cat "$1" | "$0" convert - -o -)", {file});
  EXPECT_EQ(there.exit_code, 0) << there.err;
  EXPECT_THAT(there.out, HasSubstr("\n0,0.001,0.002,0.003,"));
  EXPECT_EQ(std::count(there.out.begin(), there.out.end(), '\n'), 4)
      << "standard output has only the samples: " << there.out;
  EXPECT_THAT(there.err, AllOf(HasSubstr("2 samples"), HasSubstr("numbers have decimal commas")));
  EXPECT_EQ(in_shell(R"("$0" convert - -o - -q < "$1" | "$0" convert - -o "$2" -q)", {file, folder / "a.h5"}).err, "");
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);

  const Answer faulty = in_shell(R"(printf 't,x,y,z\n0,a,0,0\n' | "$0" info - --json)");
  EXPECT_EQ(faulty.exit_code, 2);
  EXPECT_THAT(faulty.json()["error"].get<std::string>(), HasSubstr("standard input:2: column x: 'a'"));
  EXPECT_THAT(in_shell(R"("$0" info - < /dev/null)").err, HasSubstr("standard input: is empty"));
  EXPECT_THAT(in_shell(R"("$0" convert - < "$1")", {file}).err, HasSubstr("haptrace convert - needs -o"));
  EXPECT_THAT(in_shell(R"("$0" plot - < "$1")", {file}).err, HasSubstr("haptrace plot - needs -o"));
  const Answer both = in_shell(R"("$0" convert "$1" -o - --json)", {file});
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_THAT(both.json()["error"].get<std::string>(), HasSubstr("leave one of them out"));
  EXPECT_THAT(in_shell(R"("$0" info /dev/zero)").err, HasSubstr("no line ends in its first 1 MiB"));
}

TEST(Input, MayBeHdf5ThatComesThroughAPipeAndLeavesNoTemporaryFile) {
  const TempFolder folder;
  const std::string file = folder / "circle.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--size", "0.04", "--duration", "0.5", "-o", file).exit_code, 0);
  const std::string temporary = folder / "temporary";
  std::filesystem::create_directory(temporary);
  const std::string here = "export TMPDIR=\"$2\"; ";
  const Answer info = in_shell(here + R"(cat "$1" | "$0" info - --json)", {file, temporary});
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(info.json()["title"], "circle");
  EXPECT_EQ(info.json()["file"], "standard input");
  EXPECT_EQ(in_shell(here + R"(cat "$1" | "$0" check -)", {file, temporary}).out, "standard input: valid\n");
  const Answer played = in_shell(here + R"(cat "$1" | "$0" play - --device "$3" --record "$4")",
                                 {file, temporary, kFalcon, folder / "played.h5"});
  EXPECT_EQ(played.exit_code, 0) << played.err;
  EXPECT_THAT(played.out, HasSubstr("standard input: played on"));
  EXPECT_THAT(played.out + played.err, Not(HasSubstr(temporary)));
  EXPECT_EQ(RecordingReader(folder / "played.h5").header().config["path"], "-");
  EXPECT_TRUE(std::filesystem::is_empty(temporary));
}

TEST(Input, MayBeAPipeWithANameAndWaitsForItsWriter) {
  const TempFolder folder;
  const std::string pipe = folder / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  Command command({"info", pipe, "--json"});
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  std::ofstream(pipe) << kExcel;
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.json()["file"], pipe);
  EXPECT_EQ(answer.json()["samples"], 2);

  for (const char* verb : {"info", "convert", "play"}) {
    std::vector<std::string> words{verb, pipe};
    if (words[0] == "convert") words.insert(words.end(), {"-o", folder / "a.h5"});
    if (words[0] == "play") words.insert(words.end(), {"--device", kFalcon});
    Command waiting(words);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    kill(waiting.pid(), SIGINT);
    EXPECT_EQ(waiting.wait().exit_code, -SIGINT) << verb;
  }
}

TEST(Input, WithALatin1HeaderIsReadAndEveryAnswerIsUtf8) {
  const TempFolder folder;
  const std::string file = folder.write("a.csv",
                                        "Zeit;L\xE4nge;Gr\xF6\xDF"
                                        "e;x;y;z\n0;1;2;0,1;0,2;0,3\n1;1;2;0,1;0,2;0,3\n");
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"info", file},
           {"info", file, "--json"},
           {"convert", file, "--json"},
           {"play", file, "--device", kFalcon, "--fit", "--json", "--record", folder / "p.h5"}}) {
    const Answer answer = Command(words).wait();
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    EXPECT_THAT(answer.out + answer.err, HasSubstr("L\\")) << words[0];
    EXPECT_EQ(find_invalid_utf8(answer.out), std::string::npos);
    EXPECT_EQ(find_invalid_utf8(answer.err), std::string::npos);
    if (words.back() == "--json") (void)answer.json();
  }
  EXPECT_EQ(haptrace("check", folder / "a.h5").exit_code, 0);
  EXPECT_EQ(haptrace("check", folder / "p.h5").exit_code, 0);
}

}  // namespace
}  // namespace haptrace
