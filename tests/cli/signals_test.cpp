// Tests of signals and broken output streams, with the real command.
#include "formats/documents/session_log.h"
#include "formats/recording/recording.h"
#include "tests/cli/command.h"
#include "tests/cli/live_recording.h"
#include "tests/support/real_time.h"

#include <array>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

namespace haptrace {
namespace {

/// Waits up to a minute until the recording exists: the session is then running. If it does not, the test's next
/// expectation fails.
void wait_for(const std::string& file) {
  for (int k = 0; k < 6000 && !std::filesystem::exists(file); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
}

test::Command endless(const std::string& file) {
  return test::Command({"record", file, "--device", kFalcon, "--clock", "real", "--no-realtime", "--json"});
}

class EndingSignals : public testing::TestWithParam<int> {};

TEST_P(EndingSignals, FadeTheForceOutAndKeepTheFile) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  test::Command command = endless(file);
  wait_for(file);
  kill(command.pid(), GetParam());
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  EXPECT_EQ(answer.json()["stopped_by"], "interrupted");
  EXPECT_EQ(test::haptrace("check", file).exit_code, 0);
}

INSTANTIATE_TEST_SUITE_P(EveryKind, EndingSignals,
                         testing::Values(SIGQUIT, SIGTSTP, SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGXCPU,
                                         SIGPWR, SIGRTMIN + 3));

TEST(IgnoredSignals, NeitherStopNorEndASession) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  test::Command command = endless(file);
  wait_for(file);
  for (const int signal : {SIGTTOU, SIGTTIN, SIGPIPE, SIGXFSZ, SIGCHLD, SIGWINCH, SIGCONT}) kill(command.pid(), signal);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  std::string state;
  std::getline(std::ifstream(fmt::format("/proc/{}/stat", command.pid())), state);
  EXPECT_EQ(state.substr(state.rfind(')') + 2).find('T'), std::string::npos) << "the process is stopped: " << state;
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().exit_code, 130);
}

class StoppedProcesses : public testing::TestWithParam<const char*> {};

TEST_P(StoppedProcesses, ResumeAsAfterAGapOfTheDevice) {
  test::in_real_time();
  const TempFolder folder;
  const std::string path = folder / "circle.h5", file = folder / "out.h5";
  ASSERT_EQ(test::haptrace("shape", "circle", "--duration", "4", "-o", path).exit_code, 0);
  test::Command command({"play", path, "--fit", "--device", fmt::format("{}:emulated=true,hand=relaxed", GetParam()),
                         "--no-profile", "--hold", "60", "--record", file, "--no-realtime", "--json"});
  ASSERT_TRUE(test::wait_for_phase(file, Phase::run));
  kill(command.pid(), SIGSTOP);
  std::this_thread::sleep_for(std::chrono::seconds(1));
  kill(command.pid(), SIGCONT);
  std::this_thread::sleep_for(std::chrono::seconds(1));
  kill(command.pid(), SIGINT);
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130) << answer.err;
  EXPECT_EQ(answer.json()["stopped_by"], "interrupted");
  EXPECT_GE(answer.json()["gaps"], 1);
  EXPECT_THAT(answer.err, testing::Not(testing::HasSubstr("has not answered")));
  const RecordingReader reader(file);
  const std::vector<Sample> rows = reader.read(0, reader.rows());
  for (std::size_t k = 1; k < rows.size(); ++k) {
    EXPECT_LT(rows[k].velocity.norm(), 1) << "at " << rows[k].time_ns << " ns: faster than the path";
    if (rows[k].time_ns - rows[k - 1].time_ns > 500'000'000) {
      EXPECT_LT(rows[k].force.norm(), 0.05) << "the force fades in";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(OnEveryDevice, StoppedProcesses, testing::Values("falcon", "haply2diy", "hapkit", "inverse3"),
                         [](const auto& tested) { return std::string(tested.param); });

/// Returns the exit code of the command under a bash `redirection`.
int code_with(const std::string& redirection, const std::string& arguments) {
  const std::string line = fmt::format("'{}' {} {}", HAPTRACE_COMMAND, arguments, redirection);
  return test::Command({"-c", line}, test::Command::Input::none, {}, "/bin/bash").wait().exit_code;
}

constexpr std::array kDeadStreams{"2> >(true)", "> >(true)", ">/dev/full",  "2>/dev/full",
                                  "2>&-",       ">&-",       ">&- 2>&- <&-"};

TEST(DeadStreams, DoNotEndAProgrammeEarly) {
  const TempFolder folder;
  const nlohmann::json programme{{"haptrace_programme", 1},
                                 {"title", "two circles"},
                                 {"exercises",
                                  {{{"name", "round"},
                                    {"shape", {{"kind", "circle"}, {"size", 0.04}, {"duration", 1}}},
                                    {"mode", "tunnel"},
                                    {"repetitions", 2}}}}};
  const std::string file = folder.write("circles.json", programme.dump());
  int number = 0;
  for (const char* more : {"", "--json"})
    for (const char* redirection : kDeadStreams) {
      const std::string session = folder / fmt::format("session-{}", ++number);
      EXPECT_EQ(code_with(redirection,
                          fmt::format("run '{}' --device 'sim:preset=omega3,hand=relaxed,intent={{path}}' -o '{}' {}",
                                      file, session, more)),
                0)
          << more << " " << redirection;
      EXPECT_TRUE(load_session_log(session).complete) << more << " " << redirection;
    }
}

TEST(ATerminalThatIsClosed, EndsASessionInGoodOrder) {
  const TempFolder folder;
  const std::string file = folder / "out.h5";
  test::Command command({"record", file, "--device", kFalcon, "--clock", "real", "--no-realtime", "--json"},
                        test::Command::Input::terminal);
  wait_for(file);
  ASSERT_TRUE(command.says("Hz")) << "the terminal shows the progress";
  command.hang_up();
  const Answer answer = command.wait();
  EXPECT_EQ(answer.exit_code, 130);
  EXPECT_EQ(answer.json()["stopped_by"], "interrupted");
  EXPECT_EQ(test::haptrace("check", file).exit_code, 0);
}

TEST(DeadStreams, DoNotEndASessionEarly) {
  const TempFolder folder;
  int number = 0;
  for (const char* more : {"", "--json"})
    for (const char* redirection : kDeadStreams) {
      const std::string file = folder / fmt::format("{}.h5", ++number);
      EXPECT_EQ(
          code_with(redirection, fmt::format("record '{}' --device {} --clock real --no-realtime --duration 0.5 {}",
                                             file, kFalcon, more)),
          0)
          << more << " " << redirection;
      const Answer checked = test::haptrace("check", file);
      EXPECT_EQ(checked.exit_code, 0) << redirection << ": " << checked.out << checked.err;
      EXPECT_GT(RecordingReader(file).rows(), 100U) << redirection;
    }
}

}  // namespace
}  // namespace haptrace
