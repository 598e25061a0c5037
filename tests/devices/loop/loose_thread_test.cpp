#include "devices/loop/loose_thread.h"

#include <atomic>
#include <chrono>
#include <gtest/gtest.h>
#include <memory>

namespace haptrace {
namespace {

TEST(LooseThread, IsWaitedForUntilItReturned) {
  const auto done = std::make_shared<std::atomic<bool>>(false);
  LooseThread thread([done] { *done = true; });
  EXPECT_TRUE(thread.join_within(1e9));
  EXPECT_TRUE(*done);
  EXPECT_TRUE(thread.join_within(0)) << "there is none any more";
  EXPECT_TRUE(LooseThread().join_within(0)) << "there was none";
}

TEST(LooseThread, IsAbandonedWithEverythingThatItUses) {
  const auto free = std::make_shared<std::atomic<bool>>(false);
  LooseThread thread([free] {
    while (!*free) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  EXPECT_FALSE(thread.join_within(0.01));
  EXPECT_FALSE(thread.join_within(0)) << "nor later";
  EXPECT_TRUE(LooseThread::any_given_up());
  EXPECT_GT(free.use_count(), 1) << "still its own";
  *free = true;
  for (int k = 0; k < 10000 && free.use_count() > 1; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(free.use_count(), 1);
}

TEST(LooseThread, RunsACallThatIsOverInTime) {
  const auto value = std::make_shared<int>(0);
  EXPECT_TRUE(call_within(1e9, [value] { *value = 7; }));
  EXPECT_EQ(*value, 7);
}

}  // namespace
}  // namespace haptrace
