#include "tests/cli/command.h"

#include <cstdlib>
#include <filesystem>

namespace haptrace {
namespace {

using testing::IsEmpty;

/// Sets PATH to one folder, and restores it at the end.
class OnlyPath {
 public:
  explicit OnlyPath(const std::string& folder) : before_(getenv("PATH")) { setenv("PATH", folder.c_str(), 1); }
  ~OnlyPath() { setenv("PATH", before_.c_str(), 1); }

 private:
  std::string before_;
};

/// Writes a fake cyclictest that only runs `script`.
void put_cyclictest(const TempFolder& folder, const std::string& script) {
  std::filesystem::permissions(folder.write("cyclictest", "#!/bin/sh\n" + script), std::filesystem::perms::owner_all);
}

TEST(TheDoctor, MeasuresThisMachineAndReportsProblemsInItsExitCode) {
  const TempFolder folder;
  const Answer answer = haptrace("doctor", "--duration", "1", "--rate", "500", "--folder", folder.path(), "--json");
  const nlohmann::json json = answer.json();
  EXPECT_THAT(answer.err, IsEmpty());

  const auto& loop = json["loop"];
  const auto samples = loop["samples"].get<double>(), missed = loop["missed"].get<double>();
  EXPECT_GE(samples + missed, 500);
  EXPECT_DOUBLE_EQ(loop["missed_fraction"].get<double>(), missed / (samples + missed));
  EXPECT_GE(loop["latency_s"]["max"], loop["latency_s"]["p999"]);
  EXPECT_EQ(json["criterion"]["latency_p999_s"], 0.001);
  const bool holds = loop["missed_fraction"] <= json["criterion"]["missed_fraction"] &&
                     loop["latency_s"]["p999"] <= json["criterion"]["latency_p999_s"];
  EXPECT_EQ(json["holds_rate"], holds);

  EXPECT_EQ(json["disk"]["folder"], folder.path());
  EXPECT_GT(json["disk"]["recording_s"], 0);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  EXPECT_FALSE(json.contains("cyclictest"));

  bool problem = false;
  for (const auto& finding : json["findings"]) {
    problem = problem || finding["severity"] == "problem";
    EXPECT_THAT(finding["measured"].get<std::string>(), Not(IsEmpty())) << finding;
    if (finding["check"] == "servo loop") {
      EXPECT_EQ(finding["severity"], holds ? "ok" : "problem");
    }
  }
  EXPECT_EQ(answer.exit_code, problem ? 1 : 0);
}

TEST(TheDoctor, PrintsATableAndAVerdict) {
  const TempFolder folder;
  const Answer answer = haptrace("doctor", "--duration", "0.2", "--folder", folder.path());
  for (const char* check : {"cpu governor", "preemption", "udev rules", "disk write", "scheduling", "servo loop"})
    EXPECT_THAT(answer.out, HasSubstr(check));
  EXPECT_THAT(answer.out, HasSubstr(answer.exit_code == 0 ? "sustains 1000 Hz; problems: 0\n" : "problems: "));
  EXPECT_THAT(answer.err, IsEmpty());  // progress is for terminals
}

TEST(TheDoctor, ComparesItsLoopWithCyclictest) {
  const TempFolder folder;
  put_cyclictest(folder, "echo \"$*\" >>" + folder / "calls" + "\necho '000010 000100'\n");
  const OnlyPath path(folder.path());
  const nlohmann::json json =
      haptrace("doctor", "--duration", "0.4", "--folder", folder.path(), "--cyclictest", "--json").json();
  EXPECT_EQ(json["cyclictest"]["samples"], 400);
  const double ours = json["cyclictest"]["median_p999_s"]["loop"];
  const double theirs = json["cyclictest"]["median_p999_s"]["cyclictest"];
  EXPECT_NEAR(theirs, 10e-6, 1e-6);
  EXPECT_GT(ours, 0);
  EXPECT_LE(ours, json["loop"]["latency_s"]["max"].get<double>());
  EXPECT_DOUBLE_EQ(json["cyclictest"]["p999_ratio"].get<double>(), ours / theirs);
  EXPECT_THAT(test::read_bytes(folder / "calls"),
              AllOf(HasSubstr("--policy=fifo --priority=80 --interval=1000 --loops=100 "), HasSubstr("--mlockall")));
}

TEST(TheDoctor, SaysHowToGetCyclictestWhenItIsMissingOrNotPermitted) {
  const TempFolder folder;
  const OnlyPath path(folder.path());
  const auto refusal = [&] {
    const nlohmann::json json =
        haptrace("doctor", "--duration", "0.2", "--folder", folder.path(), "--cyclictest", "--json").json();
    EXPECT_GT(json["loop"]["samples"], 0);
    return json["cyclictest"]["error"].get<std::string>();
  };
  EXPECT_THAT(refusal(), HasSubstr("not installed: sudo apt install rt-tests"));
  put_cyclictest(folder, "echo 'Unable to change scheduling policy!' >&2\nexit 1\n");
  EXPECT_THAT(refusal(), AllOf(HasSubstr("Unable to change scheduling policy!"), HasSubstr("SCHED_FIFO 80")));
}

TEST(TheDoctor, PrintsTheRulesOfEveryKnownDevice) {
  const Answer answer = haptrace("doctor", "--udev-rules");
  EXPECT_EQ(answer.exit_code, 0);
  EXPECT_THAT(answer.out, HasSubstr("# Novint Falcon\n"
                                    R"(SUBSYSTEM=="usb", ATTR{idVendor}=="0403", ATTR{idProduct}=="cb48", )"));
}

TEST(TheDoctor, RejectsInvalidOptions) {
  const auto refused = [](const char* option, const char* value, const char* because) {
    const Answer answer = haptrace("doctor", option, value);
    EXPECT_EQ(answer.exit_code, 2) << option;
    EXPECT_THAT(answer.err, HasSubstr(because));
  };
  refused("--folder", "/nonexistent", "--folder /nonexistent: there is no such folder");
  refused("--duration", "0", "--duration is 0 s");
  refused("--duration", "nan", "--duration is nan s");
  refused("--rate", "5", "the rate is 5 Hz");
  refused("--rate", "1e9", "it must be from 10 to 20000 Hz");
}

}  // namespace
}  // namespace haptrace
