// Signals and dead streams, on the real command.
#include "formats/recording.h"
#include "tests/cli/command.h"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <thread>

namespace haptrace {
namespace {

/// Waits until a recording can be read: its session runs then. A test that waits in vain fails by what it expects next.
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

INSTANTIATE_TEST_SUITE_P(OfEveryKind, EndingSignals,
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
  EXPECT_EQ(state.substr(state.rfind(')') + 2).find('T'), std::string::npos) << "it stands still: " << state;
  kill(command.pid(), SIGINT);
  EXPECT_EQ(command.wait().exit_code, 130);
}

/// The exit code of a session whose output goes where `redirection` of bash says.
int code_with(const std::string& redirection, const std::string& file, const std::string& more = "") {
  const std::string line = fmt::format("'{}' record '{}' --device {} --clock real --no-realtime --duration 0.5 {} {}",
                                       HAPTRACE_COMMAND, file, kFalcon, more, redirection);
  return test::Command({"-c", line}, test::Command::Input::none, {}, "/bin/bash").wait().exit_code;
}

TEST(DeadStreams, EndNoSessionBeforeItsTime) {
  const TempFolder folder;
  int number = 0;
  for (const char* more : {"", "--json"})
    for (const char* redirection :
         {"2> >(true)", "> >(true)", ">/dev/full", "2>/dev/full", "2>&-", ">&-", ">&- 2>&- <&-"}) {
      const std::string file = folder / fmt::format("{}.h5", ++number);
      EXPECT_EQ(code_with(redirection, file, more), 0) << more << " " << redirection;
      const Answer checked = test::haptrace("check", file);
      EXPECT_EQ(checked.exit_code, 0) << redirection << ": " << checked.out << checked.err;
      EXPECT_GT(RecordingReader(file).rows(), 100U) << redirection;
    }
}

}  // namespace
}  // namespace haptrace
