#include "base/rfc3339.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

TEST(Rfc3339, PutsTimesOfOthersIntoUtc) {
  for (const char* text : {"2026-03-01T12:00:00Z", "2026-03-01T14:00:00+0200", "2026-03-01T14:00:00+02:00",
                           "2026-03-01T14:00:00.123456+02:00", "2026-03-01 14:00:00,5 +0200",
                           "2026-03-01T06:30:00-05:30", "2026-02-28T23:00:00-13"})
    EXPECT_EQ(utc_rfc3339(text), "2026-03-01T12:00:00Z") << text;
  EXPECT_EQ(utc_rfc3339("2026-01-01T00:30:00+01:00"), "2025-12-31T23:30:00Z");
}

TEST(Rfc3339, RefusesWhatIsNoTimeOrNamesNoZone) {
  for (const char* text : {"", "yesterday", "2026-03-01", "2026-03-01T12:00:00", "2026-03-01T12:00:00.5",
                           "2026-13-01T12:00:00Z", "2026-03-01T12:00:00Z and more", "2026-03-01T12:00:00+2:x"})
    EXPECT_EQ(utc_rfc3339(text), std::nullopt) << text;
}

TEST(Rfc3339, ReadsWhatItWrites) {
  const auto time = std::chrono::system_clock::from_time_t(1'790'000'000);
  EXPECT_EQ(parse_rfc3339(rfc3339(time)), time);
  EXPECT_EQ(utc_rfc3339(rfc3339(time)), rfc3339(time));
  EXPECT_EQ(utc_rfc3339(rfc3339_nanoseconds(1'790'000'000'123'456'789)), rfc3339(time));
}

}  // namespace
}  // namespace haptrace
