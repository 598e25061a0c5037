#include "report/local_time.h"

#include "base/rfc3339.h"

#include <ctime>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <optional>

namespace haptrace {
namespace {

std::optional<std::tm> local(const std::string& text) {
  const auto point = parse_rfc3339(text);
  if (!point) return std::nullopt;
  const std::time_t seconds = std::chrono::system_clock::to_time_t(*point);
  std::tm time{};
  if (localtime_r(&seconds, &time) == nullptr) return std::nullopt;
  return time;
}

}  // namespace

std::string local_time(const std::string& rfc3339) {
  const std::optional<std::tm> time = local(rfc3339);
  if (!time) return rfc3339;
  constexpr long kHour = 3600, kMinute = 60;
  const long offset = time->tm_gmtoff, size = offset < 0 ? -offset : offset;
  const std::string zone = time->tm_zone != nullptr ? time->tm_zone : "";
  const std::string utc = fmt::format("UTC{}{:02}:{:02}", offset < 0 ? '-' : '+', size / kHour, size % kHour / kMinute);
  const std::string text = fmt::format("{:%d %B %Y, %H:%M} ", *time);
  // Zones without a name have their offset for one.
  const bool named = !zone.empty() && zone[0] != '+' && zone[0] != '-' && !(zone == "UTC" && offset == 0);
  return text + (named ? fmt::format("{} ({})", zone, utc) : zone == "UTC" ? zone : utc);
}

std::string local_minute(const std::string& rfc3339) {
  const std::optional<std::tm> time = local(rfc3339);
  return time ? fmt::format("{}, {:%H:%M}", local_date(rfc3339), *time) : rfc3339;
}

std::string local_date(const std::string& rfc3339) {
  const std::optional<std::tm> time = local(rfc3339);
  return time ? fmt::format("{} {:%b %Y}", time->tm_mday, *time) : rfc3339;
}

}  // namespace haptrace
