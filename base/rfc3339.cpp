#include "base/rfc3339.h"

#include <ctime>
#include <fmt/chrono.h>

namespace haptrace {

std::string rfc3339(std::chrono::system_clock::time_point time) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::chrono::system_clock::to_time_t(time)));
}

std::string rfc3339_nanoseconds(std::int64_t since_1970) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(std::chrono::nanoseconds(since_1970));
  std::string text = rfc3339(std::chrono::system_clock::time_point(seconds));
  text.pop_back();
  return fmt::format("{}.{:09}Z", text, since_1970 - std::chrono::nanoseconds(seconds).count());
}

std::optional<std::chrono::system_clock::time_point> parse_rfc3339(const std::string& text) {
  std::tm time{};
  const char* end = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%SZ", &time);
  if (end == nullptr || *end != '\0') return std::nullopt;
  return std::chrono::system_clock::from_time_t(timegm(&time));
}

std::optional<std::string> utc_rfc3339(const std::string& text) {
  std::tm time{};
  const char* rest = nullptr;
  for (const char* form : {"%Y-%m-%dT%H:%M:%S", "%Y-%m-%d %H:%M:%S"}) {
    time = {};
    if (rest = strptime(text.c_str(), form, &time); rest != nullptr) break;
  }
  if (rest == nullptr) return std::nullopt;
  if (*rest == '.' || *rest == ',') do
      ++rest;
    while (*rest >= '0' && *rest <= '9');
  std::tm zone{};  // strptime sees +02:00, +0200, +02 and Z
  const char* end = strptime(rest, "%z", &zone);
  if (*rest == '\0' || end == nullptr || *end != '\0') return std::nullopt;
  return rfc3339(std::chrono::system_clock::from_time_t(timegm(&time) - zone.tm_gmtoff));
}

}  // namespace haptrace
