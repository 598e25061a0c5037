#include "base/units.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

TEST(LongDurationText, HasTheUnitsThatPeopleWouldSay) {
  EXPECT_EQ(long_duration_text(0), "0.0 s");
  EXPECT_EQ(long_duration_text(4.52), "4.5 s");
  EXPECT_EQ(long_duration_text(12.3), "12 s");
  EXPECT_EQ(long_duration_text(480), "8 min");
  EXPECT_EQ(long_duration_text(7200), "2 h");
  EXPECT_EQ(long_duration_text(7510), "2 h 5 min");
  EXPECT_EQ(long_duration_text(1e6), "278 h");
  EXPECT_EQ(long_duration_text(7510, "_"), "2_h 5_min");
}

}  // namespace
}  // namespace haptrace
