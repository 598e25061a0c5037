// Time stamps of a CSV file, exact to the nanosecond. Private to formats.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// Reads a decimal number in units of 1 / `per_second` s, as in 1700000000123.5 for milliseconds, in [ns]. Returns
/// nothing if `text` is not such a number or is over 290 years.
std::optional<std::int64_t> parse_decimal_stamp(std::string_view text, double per_second);

/// Reads a date and time in [ns] since 1970: ISO 8601 or RFC 3339 (2026-01-31T12:00:00.123+01:00, 20260131T120000), a
/// blank in place of the T, / in place of -, or day and month first with points (31.01.2026 12:00:00,123). Without a
/// zone it is in UTC, unless it `needs_zone`: then it is no stamp.
std::optional<std::int64_t> parse_date_stamp(std::string_view text, bool needs_zone = false);

/// Reads a time of day, 12:00:00.123, in [ns] since midnight.
std::optional<std::int64_t> parse_clock_stamp(std::string_view text);

}  // namespace haptrace
