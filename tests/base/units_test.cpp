#include "base/units.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

TEST(ParseQuantity, TakesUnitsInAnyCaseButNoMegaForAMilli) {
  EXPECT_EQ(parse_quantity("20mm", "m"), 0.02);
  EXPECT_EQ(parse_quantity("2 n", "N"), 2);
  EXPECT_EQ(parse_quantity("1KHZ", "Hz"), 1000);
  EXPECT_EQ(parse_quantity("5 Millimetres", "m"), 0.005);
  EXPECT_EQ(parse_quantity("0.1M", "m"), 0.1);
  for (const char* mega : {"500MN", "1Mm", "2 Ms", "3MJ", "4MM/S"})
    for (const char* si : {"N", "m", "s", "J", "m/s"}) EXPECT_FALSE(parse_quantity(mega, si)) << mega << " of " << si;
}

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
