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

}  // namespace haptrace
