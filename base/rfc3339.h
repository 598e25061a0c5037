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

/// The same in UTC and whole seconds of a time as others write it: with a zone as in +02:00 or +0200, with decimals,
/// with a space for the T. Nothing when `text` is none, or names no zone: nobody knows when that was.
std::optional<std::string> utc_rfc3339(const std::string& text);

}  // namespace haptrace
