#include "base/mailbox.h"

#include <gtest/gtest.h>
#include <thread>

namespace haptrace {
namespace {

TEST(Mailbox, HoldsItsInitialValueUntilTheFirstPost) {
  Mailbox<int> mailbox(7);
  EXPECT_EQ(mailbox.latest(), 7);
  EXPECT_EQ(mailbox.latest(), 7);
}

TEST(Mailbox, GivesTheNewestAndKeepsIt) {
  Mailbox<int> mailbox;
  for (int i = 1; i <= 5; ++i) mailbox.post(i);
  EXPECT_EQ(mailbox.latest(), 5);
  EXPECT_EQ(mailbox.latest(), 5);
  mailbox.post(6);
  EXPECT_EQ(mailbox.latest(), 6);
}

TEST(Mailbox, NeverMixesTwoValuesAndNeverGoesBack) {
  struct Pair {
    long a = 0, b = 0;
  };
  Mailbox<Pair> mailbox;
  std::jthread writer([&](const std::stop_token& stop) {
    for (long i = 1; !stop.stop_requested(); ++i) mailbox.post({i, -i});
  });
  long before = 0;
  for (int i = 0; i < 500000; ++i) {
    const Pair pair = mailbox.latest();
    ASSERT_EQ(pair.a, -pair.b);
    ASSERT_GE(pair.a, before);
    before = pair.a;
  }
}

}  // namespace
}  // namespace haptrace
