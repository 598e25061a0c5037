// Times as text: RFC 3339 in UTC with whole seconds, as in 2026-01-31T12:00:00Z.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace haptrace {

std::string rfc3339(std::chrono::system_clock::time_point time);

/// Returns a time with nine decimals; `since_1970` counts nanoseconds.
std::string rfc3339_nanoseconds(std::int64_t since_1970);

/// Parses a time that rfc3339() has written; returns nothing for any other text.
std::optional<std::chrono::system_clock::time_point> parse_rfc3339(const std::string& text);

}  // namespace haptrace
