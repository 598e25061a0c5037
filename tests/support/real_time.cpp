#include "tests/support/real_time.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

namespace haptrace::test {
namespace {

using namespace std::chrono_literals;

constexpr int kAttempts = 5;
constexpr auto kBusy = 2ms;  // on a busy machine threads wake up this late, on an idle one hardly ever
constexpr const char* kAttempt = "HAPTRACE_TEST_ATTEMPT";

/// Sleeps 1 ms at a time and keeps the largest delay of its wake-ups.
class Watch {
 public:
  ~Watch() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
  }
  void start() {
    latest_ = 0;
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  }
  [[nodiscard]] std::chrono::nanoseconds latest() const { return std::chrono::nanoseconds(latest_.load()); }

 private:
  void run() {
    while (!ends_) {
      const auto due = std::chrono::steady_clock::now() + 1ms;
      std::this_thread::sleep_until(due);
      const std::int64_t late = std::chrono::nanoseconds(std::chrono::steady_clock::now() - due).count();
      if (late > latest_) latest_ = late;
    }
  }

  std::atomic<std::int64_t> latest_{0};  // [ns]
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

/// Records the largest delay of the machine in each test that called in_real_time().
class RealTimeTests final : public testing::EmptyTestEventListener {
 public:
  void mark() {
    const testing::TestInfo* test = testing::UnitTest::GetInstance()->current_test_info();
    if (test == running_) return;
    running_ = test;
    watch_.start();
  }
  void OnTestEnd(const testing::TestInfo& test) override {
    if (running_ == &test) late_[&test] = watch_.latest();
    running_ = nullptr;
  }
  /// Returns the delay that excuses a failure; 0 if the test is not in real time or the machine was not busy.
  [[nodiscard]] std::chrono::nanoseconds excuse(const testing::TestInfo& test) const {
    const auto found = late_.find(&test);
    return found != late_.end() && found->second > kBusy ? found->second : 0ns;
  }

 private:
  Watch watch_;
  const testing::TestInfo* running_ = nullptr;
  std::map<const testing::TestInfo*, std::chrono::nanoseconds> late_;
};

RealTimeTests* real_time_tests = nullptr;  // GoogleTest owns it

std::string name_of(const testing::TestInfo& test) {
  return std::string(test.test_suite_name()) + "." + test.name();
}

template <class Visit>
void for_each_test(const Visit& visit) {
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  for (int i = 0; i < program.total_test_suite_count(); ++i) {
    const testing::TestSuite& suite = *program.GetTestSuite(i);
    for (int k = 0; k < suite.total_test_count(); ++k) visit(*suite.GetTestInfo(k));
  }
}

/// Prints the skipped laws and returns their number.
int skipped_laws() {
  int skipped = 0;
  for_each_test([&](const testing::TestInfo& test) {
    if (!test.result()->Skipped() || name_of(test).rfind("All/", 0) != 0) return;
    std::printf("[ SKIPPED ] %s: a law must not be skipped; its parameters select the cases\n", name_of(test).c_str());
    ++skipped;
  });
  return skipped;
}

/// Returns a filter of the failed tests if all of them may be repeated, otherwise an empty string.
std::string to_be_tried_again(int attempt) {
  std::string filter, told;
  bool all = true;
  for_each_test([&](const testing::TestInfo& test) {
    if (!test.result()->Failed()) return;
    const auto late = std::chrono::duration<double, std::milli>(real_time_tests->excuse(test)).count();
    all = all && late > 0;
    filter += (filter.empty() ? "" : ":") + name_of(test);
    told += "[  AGAIN   ] " + name_of(test) + ": this machine was busy and delayed a thread by " +
            std::to_string(std::lround(late)) + " ms; attempt " + std::to_string(attempt + 1) + " of " +
            std::to_string(kAttempts) + "\n";
  });
  if (!all) return {};
  std::fputs(told.c_str(), stdout);
  return filter;
}

}  // namespace

void in_real_time() {
  if (real_time_tests != nullptr) real_time_tests->mark();
}

int run_tests(int argc, char** argv, const std::function<int(const std::function<int()>&)>& around) {
  std::vector<std::string> words(argv, argv + argc);
  testing::InitGoogleMock(&argc, argv);
  real_time_tests = new RealTimeTests;
  testing::UnitTest::GetInstance()->listeners().Append(real_time_tests);
  const int result = around([] { return RUN_ALL_TESTS(); });
  if (skipped_laws() > 0) return 1;
  const char* before = std::getenv(kAttempt);
  const int attempt = before != nullptr ? std::atoi(before) : 1;
  if (result == 0 || attempt >= kAttempts) return result;
  const std::string filter = to_be_tried_again(attempt);
  if (filter.empty()) return result;

  // Use a new process, since a test may have left this one in any state.
  setenv(kAttempt, std::to_string(attempt + 1).c_str(), 1);
  words.push_back("--gtest_filter=" + filter);
  std::vector<char*> again;
  for (std::string& word : words) again.push_back(word.data());
  again.push_back(nullptr);
  std::fflush(nullptr);
  execv("/proc/self/exe", again.data());
  return result;
}

int run_tests(int argc, char** argv) {
  return run_tests(argc, argv, [](const std::function<int()>& run) { return run(); });
}

}  // namespace haptrace::test
