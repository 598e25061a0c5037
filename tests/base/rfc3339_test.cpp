#include "base/rfc3339.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

TEST(Rfc3339, ReadsWhatItWrites) {
  const auto time = std::chrono::system_clock::from_time_t(1'790'000'000);
  EXPECT_EQ(parse_rfc3339(rfc3339(time)), time);
}

}  // namespace
}  // namespace haptrace
