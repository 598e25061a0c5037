// Tests of a session's messages: text, recipient and time.
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <algorithm>
#include <csignal>
#include <fstream>
#include <iomanip>
#include <regex>
#include <sstream>

namespace haptrace {
namespace {

std::string square(const TempFolder& folder) {
  std::string path = folder / "square.h5";
  EXPECT_EQ(haptrace("shape", "square", "--size", "0.05", "--duration", "1", "-o", path).exit_code, 0);
  return path;
}

/// Returns the number of columns of a text that has only narrow characters.
std::size_t columns_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

/// Splits a terminal's output at line feeds and carriage returns.
std::vector<std::string> lines_of(const std::string& printed) {
  std::vector<std::string> lines{""};
  for (const char c : printed) {
    if (c == '\r' || c == '\n')
      lines.emplace_back();
    else
      lines.back() += c;
  }
  for (std::string& line : lines)
    if (line.starts_with("\033[K")) line.erase(0, 3);
  std::erase(lines, "");
  return lines;
}

TEST(ProgressLine, FitsTheTerminal) {
  const TempFolder folder;
  const std::string path = square(folder);
  struct Case {
    unsigned short terminal;
    std::vector<std::string> environment;
    std::size_t columns;
  };
  for (const Case& each : {Case{80, {}, 80}, Case{40, {}, 40}, Case{20, {}, 20}, Case{0, {"COLUMNS=60"}, 60},
                           Case{80, {"COLUMNS=200"}, 80}}) {
    SCOPED_TRACE(testing::Message() << each.terminal << " columns");
    const std::string resize = each.terminal > 0 ? "stty cols " + std::to_string(each.terminal) + " && " : "";
    Command command({"-c", resize + R"(exec "$@")", "sh", HAPTRACE_COMMAND, "play", path, "--device", kFalcon,
                     "--clock", "real", "--no-realtime", "--no-profile", "--record", folder / "out.h5", "--overwrite"},
                    Command::Input::terminal, each.environment, "/bin/sh");
    const Answer answer = command.wait();
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    int progress = 0;
    for (const std::string& line : lines_of(answer.err)) {
      if (line.starts_with("haptrace: ")) continue;  // warnings may be long; they stay on the screen
      ++progress;
      EXPECT_LT(columns_of(line), each.columns) << line;
      EXPECT_THAT(line, HasSubstr(" s")) << "the time is dropped last";
      if (each.columns >= 40) {
        EXPECT_THAT(line, HasSubstr("force")) << line;
      }
    }
    EXPECT_GT(progress, 2) << answer.err;
  }
}

TEST(Quiet, StillReportsTheLimitThatStoppedTheSession) {
  const TempFolder folder;
  const Answer answer =
      haptrace("play", square(folder), "--device", kFalcon, "--no-profile", "--max-deviation", "0.0001", "-q");
  EXPECT_EQ(answer.exit_code, 1);
  EXPECT_EQ(answer.out, "");
  EXPECT_THAT(answer.err, HasSubstr("mm off the path, the limit is 0.1 mm"));
}

TEST(Quiet, HidesWarningsOfASessionThatContinues) {
  const TempFolder folder;
  const std::string path = square(folder);
  const std::vector<std::string> words{"play",        path,  "--device",        kFalcon, "--no-profile",
                                       "--max-force", "0.5", "--max-deviation", "0.2"};
  std::vector<std::string> quiet = words;
  quiet.emplace_back("-q");
  const Answer loud = Command(words).wait();
  EXPECT_THAT(loud.err, testing::ContainsRegex("force (was )?limited")) << "once, or several times";
  EXPECT_THAT(loud.out, HasSubstr("  warning: "));
  EXPECT_EQ(loud.exit_code, 0);
  const Answer silent = Command(quiet).wait();
  EXPECT_EQ(silent.exit_code, 0);
  EXPECT_EQ(silent.err, "");
  EXPECT_EQ(silent.out, "");
}

TEST(Warnings, ReachTheTerminalTheSummaryTheJsonTheFileAndTheReport) {
  const TempFolder folder;
  const std::string path = square(folder), file = folder / "played.h5", page = folder / "report.html";
  const std::vector<std::string> words{"play",         path,          "--device", kFalcon,
                                       "--no-profile", "--max-force", "0.5",      "--max-deviation",
                                       "0.2",          "--record",    file,       "--overwrite"};
  EXPECT_THAT(Command(words).wait().out, HasSubstr("  warning: "));
  std::vector<std::string> as_json = words;
  as_json.emplace_back("--json");
  const Answer answer = Command(as_json).wait();
  const nlohmann::json json = answer.json();
  ASSERT_FALSE(json["warnings"].empty());
  std::string text;
  for (const nlohmann::json& warning : json["warnings"]) {
    EXPECT_TRUE(warning.contains("severity") && warning.contains("time_s"));
    EXPECT_THAT(json["notices"], testing::Contains(warning["text"]));
    if (warning["code"] == "force_limit") text = warning["text"];
  }
  ASSERT_NE(text, "");
  // The terminal had it when it came, and counts no repetitions that came later.
  EXPECT_THAT(answer.err, testing::ContainsRegex("haptrace: (force limited: |the force was limited )"));
  EXPECT_EQ(RecordingReader(file).header().warnings, json["warnings"]);
  EXPECT_THAT(haptrace("info", file).out, HasSubstr(text));
  EXPECT_EQ(haptrace("info", file, "--json").json()["warnings"], json["warnings"]);
  EXPECT_EQ(haptrace("check", file).exit_code, 0);
  EXPECT_EQ(haptrace("report", file, "-o", page).exit_code, 0);
  std::ifstream html(page);
  const std::string shown(std::istreambuf_iterator<char>(html), {});
  EXPECT_THAT(shown, HasSubstr("orce limited"));
}

TEST(Play, ReportsItsControlLawAndProfile) {
  const TempFolder folder;
  const std::string path = square(folder), profile = folder / "falcon.json";
  const Answer before = haptrace("play", path, "--device", kFalcon);
  EXPECT_THAT(before.err, HasSubstr("haptrace calibrate --device sim:preset=falcon"));
  EXPECT_THAT(before.out, HasSubstr("PD alone"));
  EXPECT_THAT(before.out, HasSubstr("profile: none"));
  EXPECT_THAT(haptrace("play", path, "--device", kFalcon, "--no-profile").err, Not(HasSubstr("haptrace calibrate")));

  ASSERT_EQ(haptrace("calibrate", "--quick", "--device", kFalcon, "-o", profile).exit_code, 0);
  const Answer after = haptrace("play", path, "--device", kFalcon, "--profile", profile);
  EXPECT_EQ(after.exit_code, 0) << after.err;
  EXPECT_THAT(after.out, HasSubstr("LQG, normal with inertia, gravity, friction, observer"));
  EXPECT_THAT(after.out, HasSubstr("profile: " + profile));
  EXPECT_THAT(after.err, Not(HasSubstr("haptrace calibrate")));
}

TEST(Play, RejectsLoopTogetherWithRepeat) {
  const TempFolder folder;
  const Answer answer = haptrace("play", square(folder), "--device", kFalcon, "--loop", "--repeat", "3");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr("--loop repeats until Ctrl+C and --repeat 3 does not"));
}

/// Appends the commands of a page's first session, in order, without their comments.
void add_first_session(const std::string& page, std::vector<std::vector<std::string>>& commands) {
  std::ifstream readme(page);
  bool inside = false;
  for (std::string line; std::getline(readme, line);) {
    if (line.starts_with("## ")) inside = line.starts_with("## A first session");
    if (!inside || !line.starts_with("    haptrace ")) continue;
    std::istringstream parts(std::regex_replace(line.substr(4), std::regex("   +.*"), ""));  // drops the comment
    std::vector<std::string> words;
    for (std::string word; parts >> std::quoted(word, '\'');) {
      if (word == "haptrace") {
        commands.emplace_back();
      } else if (word != ";") {
        commands.back().push_back(word);
      }
    }
  }
}

TEST(Readme, ItsFirstSessionRunsWithoutAWarning) {
  const TempFolder folder;
  std::vector<std::vector<std::string>> commands;
  for (const char* page : {"/README.md", "/docs/tour.md"}) {
    const std::size_t before = commands.size();
    add_first_session(std::string(HAPTRACE_SOURCE_FOLDER) + page, commands);
    ASSERT_GT(commands.size(), before + 4) << page;
  }
  for (std::vector<std::string> words : commands) {
    const std::string verb = words.front();
    SCOPED_TRACE(testing::PrintToString(words));
    for (std::string& word : words)
      if (word.starts_with("samples/")) word = std::string(HAPTRACE_SAMPLES) + word.substr(7);
    // Shorten the commands: play once instead of until Ctrl+C, and print --help instead of running for minutes.
    if (const auto loop = std::find(words.begin(), words.end(), "--loop"); loop != words.end()) words.erase(loop);
    if (verb == "doctor" || verb == "stability" || verb == "tradeoff") words.emplace_back("--help");
    words.insert(words.begin(), HAPTRACE_COMMAND);
    const std::string script = R"(cd "$1" && shift && exec "$@")";
    std::vector<std::string> arguments{"-c", script, "sh", folder.path()};
    arguments.insert(arguments.end(), words.begin(), words.end());
    Command command(arguments, Command::Input::none, {"HAPTRACE_PROFILES=" + (folder / "profiles")}, "/bin/sh");
    if (verb == "view") {  // a view lasts until Ctrl+C
      EXPECT_TRUE(command.says("(Ctrl+C ends it)"));
      kill(command.pid(), SIGINT);
    }
    const Answer answer = command.wait();
    EXPECT_EQ(answer.exit_code, 0) << answer.err;
    EXPECT_THAT(answer.err, Not(HasSubstr("stuck"))) << answer.err;
    EXPECT_THAT(answer.out, Not(HasSubstr("  warning: "))) << answer.out;
    EXPECT_THAT(answer.out, Not(HasSubstr("  error: "))) << answer.out;
  }
}

}  // namespace
}  // namespace haptrace
