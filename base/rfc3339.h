// Times as texts: RFC 3339 in UTC, whole seconds, as in 2026-01-31T12:00:00Z.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace haptrace {

std::string rfc3339(std::chrono::system_clock::time_point time);

/// With nine decimals, of nanoseconds since 1970.
std::string rfc3339_nanoseconds(std::int64_t since_1970);

/// Nothing when `text` is no time as rfc3339() writes it.
std::optional<std::chrono::system_clock::time_point> parse_rfc3339(const std::string& text);

}  // namespace haptrace
