#include "tests/devices/guardian_laws.h"

#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <gmock/gmock.h>
#include <optional>
#include <ostream>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace haptrace::test {

void PrintTo(const ListedPort& port, std::ostream* out) {
  *out << port.name;
}

namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using namespace std::chrono_literals;
using Heard = std::vector<std::uint8_t>;

constexpr std::uint8_t kSilent = 7, kDead = 8;

class GuardianLaws : public testing::TestWithParam<ListedPort> {
 protected:
  GuardianLaws() { in_real_time(); }

  Guardian& watch(const GuardedPort& port) { return guardian_.emplace(port, LastWords{{kSilent}, {kDead, kDead}}); }
  Guardian& watch() { return watch(bench_->port()); }

  [[nodiscard]] bool hears_in_the_end(const Heard& end) const {
    for (int k = 0; k < 5000; ++k) {
      const Heard heard = bench_->heard();
      if (heard.size() >= end.size() && std::equal(end.rbegin(), end.rend(), heard.rbegin())) return true;
      std::this_thread::sleep_for(1ms);
    }
    return false;
  }

  std::unique_ptr<GuardedBench> bench_ = GetParam().open();
  std::optional<Guardian> guardian_;
};

TEST_P(GuardianLaws, SendsItsLastWordsWhenItsHostIsSilentAndAgainWhenItsHostIsGone) {
  watch();
  EXPECT_TRUE(hears_in_the_end({kSilent}));
  EXPECT_TRUE(guardian_->speak_and_go());
  EXPECT_TRUE(hears_in_the_end({kDead, kDead}));
}

TEST_P(GuardianLaws, SendsItsLastWordsThreeTimesForASilentHostAndAgainAfterItsNextBeat) {
  watch();
  EXPECT_TRUE(hears_in_the_end({kSilent, kSilent, kSilent}));
  std::this_thread::sleep_for(300ms);
  EXPECT_THAT(bench_->heard(), ElementsAre(kSilent, kSilent, kSilent)) << "nobody reads the answers";
  guardian_->beat();
  EXPECT_TRUE(hears_in_the_end({kSilent, kSilent, kSilent, kSilent}));
}

TEST_P(GuardianLaws, SendsItsLastWordsAtOnceWhenAnotherThreadAsksAndConfirmsThem) {
  watch().beat();
  bool spoke = false;
  std::thread([&] { spoke = guardian_->speak(); }).join();
  EXPECT_TRUE(spoke);
  EXPECT_TRUE(hears_in_the_end({kSilent}));
  EXPECT_TRUE(guardian_->speak_and_go()) << "and it still watches";
  EXPECT_TRUE(hears_in_the_end({kDead, kDead}));
  EXPECT_FALSE(guardian_->speak()) << "nobody is there";
}

TEST_P(GuardianLaws, SendsNothingAfterItIsKilled) {
  watch();
  kill(guardian_->process(), SIGKILL);
  EXPECT_FALSE(guardian_->speak());
  EXPECT_FALSE(guardian_->speak_and_go());
  EXPECT_THAT(bench_->heard(), testing::Not(testing::Contains(kDead)));
}

TEST_P(GuardianLaws, EndsWithoutAMessageWhenItIsDismissed) {
  watch().beat();
  guardian_->dismiss();
  std::this_thread::sleep_for(20ms);
  EXPECT_THAT(bench_->heard(), testing::Not(testing::Contains(kDead)));
  EXPECT_NE(kill(guardian_->process(), 0), 0) << "and its process has ended";
}

TEST_P(GuardianLaws, LeavesNoProcessBehind) {
  for (int k = 0; k < 100; ++k) {
    watch();
    k % 2 == 0 ? guardian_->dismiss() : (void)guardian_->speak_and_go();
    ASSERT_NE(kill(guardian_->process(), 0), 0);
  }
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD) << "a zombie";
}

TEST_P(GuardianLaws, IgnoresTheSignalsOfATerminal) {
  watch();
  for (const int signal : {SIGINT, SIGHUP, SIGTERM, SIGQUIT}) kill(guardian_->process(), signal);
  std::this_thread::sleep_for(20ms);
  EXPECT_EQ(kill(guardian_->process(), 0), 0);
  EXPECT_NE(getsid(guardian_->process()), getsid(0)) << "nor is it in the group that they go to";
}

TEST_P(GuardianLaws, IsReportedAsMissingByItsHost) {
  watch();
  kill(guardian_->process(), SIGKILL);
  const std::string error = error_of(
      [&] {
        for (int k = 0; k < 5000; ++k) {
          guardian_->beat();
          std::this_thread::sleep_for(1ms);
        }
      },
      Error::Kind::device);
  EXPECT_THAT(error, HasSubstr("haptrace-guardian"));
}

TEST_P(GuardianLaws, InheritsOnlyTheSocketAndThePortOfItsHost) {
  const int other = open("/dev/null", O_RDONLY);  // any child process except a guardian would inherit it
  watch();
  std::vector<std::string> files;
  for (const auto& file : std::filesystem::directory_iterator("/proc/" + std::to_string(guardian_->process()) + "/fd"))
    if (std::stoi(file.path().filename()) < 100) files.push_back(file.path().filename());  // above: the emulated bus
  EXPECT_THAT(files, testing::UnorderedElementsAre("0", "1"));
  close(other);
}

TEST_P(GuardianLaws, ReachesAPortThatHasTheNumberOfAStandardStream) {
  GuardedPort port = bench_->port();
  const int input = fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 10);
  ASSERT_EQ(dup2(port.descriptor, STDIN_FILENO), STDIN_FILENO);
  port.descriptor = STDIN_FILENO;
  watch(port);
  dup2(input, STDIN_FILENO);
  close(input);
  EXPECT_TRUE(hears_in_the_end({kSilent}));
}

INSTANTIATE_TEST_SUITE_P(All, GuardianLaws, testing::ValuesIn(listed_ports()),
                         [](const auto& port) { return port.param.name; });

}  // namespace
}  // namespace haptrace::test
