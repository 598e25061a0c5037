// Tests of help pages, and of the completions and manual pages made from the same options.
#include "control/event_words.h"
#include "tests/cli/command.h"

#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

namespace haptrace {
namespace {

const std::vector<std::string>& verb_names() {
  static const std::vector<std::string> names{"record",
                                              "play",
                                              "guide",
                                              "run",
                                              "calibrate",
                                              "view",
                                              "info",
                                              "check",
                                              "plot",
                                              "report",
                                              "shape",
                                              "average",
                                              "convert",
                                              "recover",
                                              "devices",
                                              "doctor",
                                              "tradeoff",
                                              "completion",
                                              "stability map",
                                              "stability ensemble",
                                              "stability guidance",
                                              "stability staircase"};
  return names;
}

std::vector<std::string> words_of(const std::string& verb) {
  std::istringstream parts(verb);
  return {std::istream_iterator<std::string>(parts), {}};
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

std::string help_of(const std::string& verb, const char* flag = "--help") {
  std::vector<std::string> words = words_of(verb);
  words.emplace_back(flag);
  const Answer answer = Command(words).wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  return answer.out;
}

/// Runs a script in a shell and returns its output.
std::string run_script(const std::string& shell, const std::vector<std::string>& arguments) {
  const Answer answer = Command(arguments, Command::Input::none, {}, shell).wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_EQ(answer.err, "");
  return answer.out;
}

TEST(HelpPages, FitAScreenAndBeginWithExamples) {
  for (const std::string& verb : verb_names()) {
    SCOPED_TRACE(verb);
    const std::vector<std::string> lines = lines_of(help_of(verb));
    EXPECT_LE(lines.size(), 60U);
    for (const std::string& line : lines) EXPECT_LE(line.size(), 80U) << line;
    const auto at = [&](const std::string& start) {
      return std::find_if(lines.begin(), lines.end(), [&](const auto& line) { return line.starts_with(start); });
    };
    EXPECT_LT(at("Examples:"), at("Options:"));
    EXPECT_NE(at("  haptrace " + verb), lines.end());
  }
}

TEST(HelpPages, BreakNoExampleInsideQuotes) {
  for (const std::string& verb : verb_names())
    for (const std::string& line : lines_of(help_of(verb)))
      EXPECT_TRUE(!line.ends_with('\\') || std::count(line.begin(), line.end(), '\'') % 2 == 0) << verb << ": " << line;
}

TEST(HelpPages, MarkAnArgumentThatMayBeLeftOut) {
  EXPECT_THAT(help_of("devices"), HasSubstr("Usage: haptrace devices [NAME[:...]] [OPTIONS]"));
  EXPECT_THAT(help_of("completion"), HasSubstr("Usage: haptrace completion SHELL [PAGE] [OPTIONS]"));
  EXPECT_THAT(help_of("average"), HasSubstr("Usage: haptrace average FILE... [OPTIONS]"));
}

TEST(HelpPages, OfferOnlyOptionsThatHaveAnEffect) {
  EXPECT_THAT(help_of("completion", "--help-all"), Not(HasSubstr("--json")));
  const Answer answer = haptrace("completion", "bash", "--json");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr("unknown option '--json' of haptrace completion"));
}

TEST(HelpPages, ShowEveryOptionWithHelpAll) {
  EXPECT_THAT(help_of("play"), Not(HasSubstr("--interpolation")));
  EXPECT_THAT(help_of("play"), HasSubstr("--help-all"));
  const std::string all = help_of("play", "--help-all");
  for (const char* option : {"--interpolation", "--kp-rotation", "--tune-socket", "--mark-texts", "--kp NUMBER"})
    EXPECT_THAT(all, HasSubstr(option));
  for (const std::string& line : lines_of(all)) EXPECT_LE(line.size(), 80U) << line;
}

TEST(HelpPages, DescribeOptionsInPlainWords) {
  // Words such as "what" and "of" start fragments that have no subject.
  const std::regex fragment(R"(^ +(-[^ ]*( [A-Z.\[\]x]+)*)? {2,}(what|who|whose|of|but|where) )");
  for (const std::string& verb : verb_names())
    for (const std::string& line : lines_of(help_of(verb, "--help-all")))
      EXPECT_FALSE(std::regex_search(line, fragment)) << verb << ": " << line;
}

TEST(HelpPages, AreAlsoPrintedByTheVerbHelp) {
  EXPECT_EQ(haptrace("help").out, haptrace("--help").out);
  EXPECT_EQ(haptrace("help", "help").out, haptrace("--help").out);
  EXPECT_EQ(haptrace("help", "play").out, haptrace("play", "--help").out);
  EXPECT_EQ(haptrace("help", "stability", "map").out, haptrace("stability", "map", "--help").out);
  const Answer unknown = haptrace("help", "plai");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("play"));
}

TEST(Quantities, TakeAUnitWhereverAnOptionStatesOne) {
  const TempFolder folder;
  const std::string with = folder / "with.csv", without = folder / "without.csv";
  ASSERT_EQ(haptrace("shape", "square", "--size", "80mm", "--duration", "500ms", "--angle", "90deg", "--sample-rate",
                     "1kHz", "-o", with)
                .exit_code,
            0);
  ASSERT_EQ(haptrace("shape", "square", "--size", "0.08", "--duration", "0.5", "--angle", "1.5707963267948966",
                     "--sample-rate", "1000", "-o", without)
                .exit_code,
            0);
  EXPECT_EQ(test::read_bytes(with), test::read_bytes(without));
  const Answer wrong = haptrace("shape", "square", "--size", "80kg", "-o", folder / "x.csv");
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("'kg' is not a known unit of this quantity; its SI unit is m"));
  const std::string config = folder.write("c.json", R"({"size": "80mm", "duration": "500ms", "sample-rate": "1kHz",
      "angle": "90deg", "output": ")" + (folder / "config.csv") +
                                                        "\"}");
  ASSERT_EQ(haptrace("shape", "square", "--config", config).exit_code, 0);
  EXPECT_EQ(test::read_bytes(folder / "config.csv"), test::read_bytes(without));
}

TEST(Quantities, SpellTheCentreEitherWay) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("shape", "line", "--centre", "10mm", "0", "0", "-o", folder / "a.csv").exit_code, 0);
  ASSERT_EQ(haptrace("shape", "line", "--center", "0.01", "0", "0", "-o", folder / "b.csv").exit_code, 0);
  EXPECT_EQ(test::read_bytes(folder / "a.csv"), test::read_bytes(folder / "b.csv"));
  ASSERT_EQ(haptrace("shape", "line", "--centre", "1cm,0,0", "-o", folder / "d.csv").exit_code, 0);
  EXPECT_EQ(test::read_bytes(folder / "a.csv"), test::read_bytes(folder / "d.csv"));
  EXPECT_EQ(haptrace("shape", "line", "--centre", "1cm,0", "-o", folder / "e.csv").exit_code, 2);
  EXPECT_EQ(haptrace("shape", "line", "--centre", "1cm,0,0,0", "-o", folder / "e.csv").exit_code, 2);
  const std::string config = folder.write("c.json", R"({"center": [0.01, 0, 0]})");
  ASSERT_EQ(haptrace("shape", "line", "--config", config, "-o", folder / "c.csv").exit_code, 0);
  EXPECT_EQ(test::read_bytes(folder / "a.csv"), test::read_bytes(folder / "c.csv"));
}

TEST(Completion, WorksInBash) {
  const TempFolder folder;
  const std::string file = folder.write("complete.bash", haptrace("completion", "bash").out);
  const auto complete = [&](const std::string& words) {
    // Bash calls the function with the words so far; the last word is unfinished.
    return run_script("/bin/bash", {"-c",
                                    "source \"$1\"; COMP_WORDS=(" + words +
                                        "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _haptrace; "
                                        "printf '%s\\n' \"${COMPREPLY[@]}\"",
                                    "bash", file});
  };
  EXPECT_EQ(complete("haptrace re"), "record\nreport\nrecover\n");
  EXPECT_EQ(complete("haptrace stability st"), "staircase\n");
  EXPECT_EQ(complete("haptrace play x.h5 --kp-"), "--kp-rotation\n");
  EXPECT_EQ(complete("haptrace play x.h5 --on-deviation s"), "stop\nsoften\n");
  EXPECT_EQ(complete("haptrace stability ensemble --dr"), "--draws\n");
  EXPECT_EQ(complete("haptrace plot '" + folder.path() + "/comp'"), file + "\n");
  EXPECT_EQ(complete("haptrace convert a.h5 -o '" + folder.path() + "/comp'"), file + "\n");
  EXPECT_EQ(complete("haptrace play x.h5 -d re"), "replay\n") << "a device";
  EXPECT_EQ(complete("haptrace play x.h5 --kp 1"), "\n") << "a number has no completion";
  EXPECT_EQ(complete("haptrace h"), "help\n");
  EXPECT_EQ(complete("haptrace help cal"), "calibrate\n");
  EXPECT_EQ(complete("haptrace --v"), "--version\n");
  EXPECT_EQ(complete("haptrace shape s"), "square\nspiral\nscript\n");
  EXPECT_EQ(complete("haptrace completion f"), "fish\n");
}

TEST(Completion, IsWellFormedInZshAndFish) {
  const TempFolder folder;
  int tried = 0;
  for (const char* shell : {"zsh", "fish"}) {
    const std::string program = std::string("/usr/bin/") + shell;
    if (!std::filesystem::exists(program)) continue;
    ++tried;
    const std::string file = folder.write(shell, haptrace("completion", shell).out);
    EXPECT_EQ(run_script(program, {"-n", file}), "");
  }
  if (std::filesystem::exists("/usr/bin/fish")) {
    const auto complete = [&](const std::string& words) {
      return run_script("/usr/bin/fish",
                        {"--no-config", "-c", "source " + (folder / "fish") + "; complete -C '" + words + "'"});
    };
    EXPECT_THAT(complete("haptrace stability ma"), HasSubstr("map\t"));
    EXPECT_THAT(complete("haptrace he"), HasSubstr("help\t"));
    EXPECT_THAT(complete("haptrace help cal"), HasSubstr("calibrate\t"));
    EXPECT_THAT(complete("haptrace --ver"), HasSubstr("--version\t"));
    EXPECT_THAT(complete("haptrace shape sp"), HasSubstr("spiral"));
  }
  if (tried == 0) GTEST_SKIP() << "neither zsh nor fish is installed";
}

TEST(Completion, IsRefusedForAShellThatIsNotKnown) {
  const Answer answer = haptrace("completion", "tcsh");
  EXPECT_EQ(answer.exit_code, 2);
  EXPECT_THAT(answer.err, HasSubstr("bash, zsh, fish"));
  EXPECT_EQ(haptrace("completion").exit_code, 2);
}

TEST(ManualPages, ExistForEveryVerbAndAreWellFormed) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("completion", "man", "-o", folder.path()).exit_code, 0);
  for (const std::string& verb : verb_names()) {
    const std::string page = folder / "haptrace-" + std::regex_replace(verb, std::regex(" "), "-") + ".1";
    ASSERT_TRUE(std::filesystem::exists(page)) << page;
  }
  EXPECT_EQ(haptrace("completion", "man", "haptrace-play").out, test::read_bytes(folder / "haptrace-play.1"));
  EXPECT_THAT(test::read_bytes(folder / "haptrace-play.1"), HasSubstr(".SH EXAMPLES\n"));
  if (!std::filesystem::exists("/usr/bin/groff")) GTEST_SKIP() << "groff is not installed";
  for (const auto& page : std::filesystem::directory_iterator(folder.path()))
    EXPECT_EQ(run_script("/usr/bin/groff", {"-man", "-ww", "-z", "-Tutf8", page.path()}), "") << page;
  for (const auto& page : std::filesystem::directory_iterator(folder.path()))
    for (const std::string& line :
         lines_of(run_script("/usr/bin/groff", {"-man", "-Tascii", "-P-cbou", "-rLL=78n", page.path()})))
      EXPECT_LE(line.size(), 80U) << page << ": " << line;
}

TEST(Output, HasNoColour) {
  const TempFolder folder;
  ASSERT_EQ(haptrace("shape", "line", "-o", folder / "a.h5").exit_code, 0);
  for (const char* verb : {"info", "check", "devices", "nonsense"}) {
    Command command({verb, folder / "a.h5"}, Command::Input::terminal);
    const Answer answer = command.wait();
    EXPECT_THAT(answer.out + answer.err, Not(testing::ContainsRegex("\033\\[[0-9;]*m"))) << verb;
  }
}

}  // namespace
}  // namespace haptrace
