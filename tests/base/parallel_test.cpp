#include "base/parallel.h"

#include "base/error.h"
#include "tests/support/errors.h"

#include <atomic>
#include <chrono>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <thread>
#include <vector>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

TEST(RunParallel, DoesEveryJobOnceWhateverTheThreads) {
  for (const std::size_t threads : {0, 1, 3, 50}) {
    std::vector<std::atomic<int>> runs(20);
    std::size_t reported = 0;
    EXPECT_TRUE(run_parallel(
        runs.size(), threads, StopRequest{}, [&](std::size_t job) { ++runs[job]; },
        [&](std::size_t done) { reported = done; }));
    for (const auto& count : runs) EXPECT_EQ(count, 1);
    EXPECT_EQ(reported, 20U);
  }
  run_parallel(
      0, 2, StopRequest{}, [](std::size_t) { FAIL(); }, [](std::size_t) {});
}

TEST(RunParallel, StartsNoJobAfterAStopAndRethrowsTheErrorOfAJob) {
  StopRequest stop;
  std::atomic<int> runs{0};
  const auto count_until_third = [&](std::size_t) {
    if (++runs == 3) stop.raise();
  };
  EXPECT_FALSE(run_parallel(100, 1, stop, count_until_third, [](std::size_t) {}));
  EXPECT_EQ(runs, 3);

  runs = 0;
  const auto fail_at_third = [&](std::size_t) {
    if (++runs == 3) throw input_error("the third");
  };
  EXPECT_THAT(error_of([&] { run_parallel(100, 1, StopRequest{}, fail_at_third, [](std::size_t) {}); }),
              HasSubstr("the third"));
  EXPECT_EQ(runs, 3);

  // The other threads stop their jobs as well.
  std::atomic<int> after{0};
  std::atomic<bool> failed{false};
  const auto fail_first = [&](std::size_t job) {
    if (job == 0) {
      failed = true;
      throw input_error("the first");
    }
    while (!failed) std::this_thread::yield();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ++after;
  };
  EXPECT_THAT(error_of([&] { run_parallel(1000, 2, StopRequest{}, fail_first, [](std::size_t) {}); }),
              HasSubstr("the first"));
  EXPECT_LT(after, 900);
}

}  // namespace
}  // namespace haptrace
