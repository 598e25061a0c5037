// Tests of texts from users, files and devices: the command rejects invalid UTF-8 and names its source, and no control
// sequence reaches the terminal.
#include "base/printable.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"

#include <filesystem>
#include <sys/stat.h>

namespace haptrace {
namespace {

constexpr const char* kNoText = "J\xe4ne";  // in Latin-1

/// Expects no control characters except line feeds and tabs.
void expect_printable(const Answer& answer) {
  EXPECT_EQ(printable_lines(answer.out), answer.out);
  EXPECT_EQ(printable_lines(answer.err), answer.err);
}

TEST(TheCommand, RefusesATextThatIsNotUtf8AndNamesItsOption) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  for (const char* option :
       {"--subject", "--title", "--operator", "--notes", "--meta", "--mark-texts", "--meta-file"}) {
    const std::string text = (std::string_view(option) == "--meta" ? "name=" : "") + std::string(kNoText);
    const Answer answer = haptrace("record", file, "--device", kFalcon, "--duration", "0.1", option, text);
    EXPECT_EQ(answer.exit_code, 2) << option;
    EXPECT_THAT(answer.err, AllOf(HasSubstr(option), HasSubstr("UTF-8"), HasSubstr("J\\xe4ne"))) << option;
    expect_printable(answer);
    EXPECT_FALSE(std::filesystem::exists(file)) << option;
  }
  const Answer json = haptrace("record", file, "--device", kNoText, "--json");
  EXPECT_EQ(json.exit_code, 2);
  EXPECT_THAT(json.json()["error"].get<std::string>(), HasSubstr("--device"));
  EXPECT_EQ(json.json()["exit_code"], 2);
  EXPECT_THAT(haptrace("info", folder / kNoText).err, AllOf(HasSubstr("file"), HasSubstr("UTF-8")));
  expect_printable(haptrace("record", file, std::string("--") + kNoText, "--json"));
}

TEST(TheCommand, RefusesAFileOfOptionsThatIsNotUtf8AndNamesIt) {
  const TempFolder folder;
  const std::string config = folder.write("config.json", std::string("{\"subject\": \"") + kNoText + "\"}");
  for (const char* option : {"--config", "--meta-file"})
    for (const char* json : {"--json", "--no-realtime"}) {
      const Answer answer =
          haptrace("record", folder / "a.h5", "--device", kFalcon, "--duration", "0.1", option, config, json);
      EXPECT_EQ(answer.exit_code, 2) << answer.err;
      EXPECT_THAT(answer.err, AllOf(HasSubstr(config), HasSubstr("UTF-8"))) << option;
      expect_printable(answer);
    }
}

TEST(TheCommand, PrintsNoControlSequencesOfAFile) {
  const TempFolder folder;
  const std::string hostile = "a\x1b[2J\x1b]0;owned\x07\u009b31m\u202eb\r\n  event   0.000 s  nothing\xff";
  RecordingHeader header;
  header.title = header.subject = header.operator_name = header.notes = header.device_name = header.device_model =
      header.software = header.created = header.clock = hostile;
  header.config = {{"device", "a\x1b[2J"}, {"a\x1b[2J", "b"}};
  header.meta = {{"key\x1b[2J", hostile}};
  const std::string file = folder / "a.h5";
  {
    RecordingWriter writer(file, header, {}, {});
    std::vector<Sample> samples(100);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      samples[i].tick = i;
      samples[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
      samples[i].position = Vec3(1e-4 * static_cast<double>(i), 0, 0);
    }
    writer.append(samples);
    writer.append(StoredEvent{0.01, 50, hostile});
    writer.finish();
  }
  const Answer info = haptrace("info", file);
  EXPECT_EQ(info.exit_code, 0) << info.err;
  EXPECT_THAT(info.out, HasSubstr("a\\x1b[2J\\x1b]0;owned\\x07\\u{009b}31m\\u{202e}b\\x0d\\x0a  event"));
  EXPECT_THAT(info.out, Not(HasSubstr("\n  event   0.000"))) << "the title must not look like a line of haptrace";
  expect_printable(info);
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"info", file, "--json"},
                                             {"check", file},
                                             {"check", file, "--json"},
                                             {"report", file, "-o", folder / "report.html"},
                                             {"report", file, "--json", "-o", folder / "again.html"},
                                             {"convert", file, "-o", folder / "a.csv"},
                                             {"convert", file, "-o", folder / "b.h5", "--anonymise"},
                                             {"plot", file, "-o", folder / "a.svg"},
                                             {"play", file, "--device", kFalcon, "--fit"}}) {
    const Answer answer = Command(words).wait();
    EXPECT_GE(answer.exit_code, 0) << words[0];
    EXPECT_THAT(answer.err, Not(HasSubstr("unexpected"))) << words[0] << ": " << answer.err;
    expect_printable(answer);
    if (words.size() > 2 && words[2] == "--json") (void)answer.json();
  }
  for (const char* page : {"report.html", "again.html"})
    EXPECT_EQ(test::read_bytes(folder / page).find('\x1b'), std::string::npos);
  expect_printable(haptrace("info", folder / "no\x1b[2Jfile"));
}

TEST(TheCommand, PlaysWithoutAHomeFolder) {
  const TempFolder folder;
  const std::string path = folder / "circle.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--size", "0.04", "--duration", "0.5", "-o", path).exit_code, 0);
  const std::string script = "cd '" + folder.path() + "' && unset HAPTRACE_PROFILES XDG_DATA_HOME && HOME= exec " +
                             HAPTRACE_COMMAND + " play " + path + " --device " + kFalcon;
  const Answer answer = Command({"-c", script}, Command::Input::none, {}, "/bin/sh").wait();
  EXPECT_EQ(answer.exit_code, 0) << answer.err;
  EXPECT_FALSE(std::filesystem::exists(folder / ".local")) << "nothing is written to the current folder";
}

TEST(TheCommand, KeepsThePermissionsOfAFileThatItOverwrites) {
  const TempFolder folder;
  const mode_t before = umask(022);
  std::filesystem::permissions(folder.path(), std::filesystem::perms(0755));
  const std::string file = folder / "circle.h5", played = folder / "played.h5";
  ASSERT_EQ(haptrace("shape", "circle", "--size", "0.04", "--duration", "0.5", "-o", file).exit_code, 0);
  EXPECT_EQ(haptrace("play", file, "--device", kFalcon, "--record", played).exit_code, 0);
  EXPECT_EQ(std::filesystem::status(played).permissions(), std::filesystem::perms(0644));
  std::filesystem::permissions(played, std::filesystem::perms(0600));
  EXPECT_EQ(haptrace("play", file, "--device", kFalcon, "--record", played, "--overwrite").exit_code, 0);
  umask(before);
  EXPECT_EQ(std::filesystem::status(played).permissions(), std::filesystem::perms(0600));
}

}  // namespace
}  // namespace haptrace
