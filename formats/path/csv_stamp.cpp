#include "formats/path/csv_stamp.h"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace haptrace {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

/// Takes parts from the beginning of a text.
class Taker {
 public:
  explicit Taker(std::string_view text) : rest_(text) {}

  bool take(std::string_view any_of) {
    if (rest_.empty() || any_of.find(rest_.front()) == std::string_view::npos) return false;
    rest_.remove_prefix(1);
    return true;
  }
  /// Takes a number of `fewest` to `most` digits.
  bool take(int& value, int fewest, int most) {
    int digits = 0;
    for (value = 0; digits < most && !rest_.empty() && is_digit(rest_.front()); ++digits) {
      value = 10 * value + (rest_.front() - '0');
      rest_.remove_prefix(1);
    }
    return digits >= fewest;
  }
  /// Takes a decimal sign and the fraction after it, in ns, if there is one.
  bool take_fraction(std::int64_t& ns) {
    ns = 0;
    if (!take(".,")) return true;
    std::int64_t unit = kSecondNs;
    bool any = false;
    for (; !rest_.empty() && is_digit(rest_.front()); rest_.remove_prefix(1)) {
      any = true;
      unit /= 10;
      ns += unit * (rest_.front() - '0');  // digits beyond 1 ns are dropped
    }
    return any;
  }
  void skip_blanks() {
    while (take(" \t")) {
    }
  }
  [[nodiscard]] std::string_view rest() const { return rest_; }

 private:
  std::string_view rest_;
};

bool take_clock(Taker& taker, std::int64_t& ns) {
  constexpr int kLastSecond = 60;  // in a leap second
  int hours = 0, minutes = 0, seconds = 0;
  std::int64_t fraction = 0;
  if (!taker.take(hours, 1, 2)) return false;
  const bool colons = taker.take(":");
  if (!taker.take(minutes, 2, 2)) return false;
  if (colons ? taker.take(":") : true)
    if (!taker.take(seconds, 2, 2)) return false;
  if (!taker.take_fraction(fraction) || hours > 23 || minutes > 59 || seconds > kLastSecond) return false;
  ns = (3600 * static_cast<std::int64_t>(hours) + 60 * static_cast<std::int64_t>(minutes) + seconds) * kSecondNs +
       fraction;
  return true;
}

bool take_date(Taker& taker, std::int64_t& ns) {
  int year = 0, month = 0, day = 0;
  Taker points = taker;
  if (points.take(day, 1, 2) && points.take(".")) {
    if (!points.take(month, 1, 2) || !points.take(".") || !points.take(year, 4, 4)) return false;
    taker = points;
  } else {
    if (!taker.take(year, 4, 4)) return false;
    const bool apart = taker.take("-/");
    if (!taker.take(month, apart ? 1 : 2, 2) || (apart && !taker.take("-/")) || !taker.take(day, apart ? 1 : 2, 2))
      return false;
  }
  const std::chrono::year_month_day date{std::chrono::year(year), std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day))};
  // Nanoseconds do not fit beyond these years.
  if (!date.ok() || year < 1700 || year > 2250) return false;
  ns = std::chrono::nanoseconds(std::chrono::sys_days(date).time_since_epoch()).count();
  return true;
}

/// Takes Z, +01:00, +0100, +01 or nothing. `ahead`: how far local time is ahead of UTC [ns].
bool take_zone(Taker& taker, std::int64_t& ahead) {
  taker.skip_blanks();
  ahead = 0;
  if (taker.rest() == "UTC" || taker.rest() == "GMT") {
    taker = Taker("");
    return true;
  }
  if (taker.rest().empty() || taker.take("Zz")) return true;
  const bool before = taker.take("-");
  if (!before && !taker.take("+")) return false;
  int hours = 0, minutes = 0;
  if (!taker.take(hours, 2, 2)) return false;
  const bool colon = taker.take(":");
  if (!taker.take(minutes, 2, 2) && (colon || !taker.rest().empty())) return false;
  if (hours > 23 || minutes > 59) return false;
  ahead = (3600 * static_cast<std::int64_t>(hours) + 60 * static_cast<std::int64_t>(minutes)) * kSecondNs;
  if (before) ahead = -ahead;
  return true;
}

}  // namespace

std::optional<std::int64_t> parse_decimal_stamp(std::string_view text, double per_second) {
  constexpr double kLongest = 9.2e18;
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  const std::size_t point = text.find('.');
  const std::string_view whole = text.substr(0, point);
  const std::string_view part = point == std::string_view::npos ? std::string_view() : text.substr(point + 1);
  if (whole.empty() || whole.size() > 19 || !std::all_of(whole.begin(), whole.end(), is_digit) ||
      !std::all_of(part.begin(), part.end(), is_digit))
    return std::nullopt;
  const double ns_per_unit = static_cast<double>(kSecondNs) / per_second;
  std::uint64_t units = 0;
  for (const char c : whole) units = 10 * units + static_cast<std::uint64_t>(c - '0');
  if (static_cast<double>(units) * ns_per_unit > kLongest) return std::nullopt;
  double share = 0, unit = 1;
  for (std::size_t i = 0; i < std::min<std::size_t>(part.size(), 17); ++i) share += (part[i] - '0') * (unit /= 10);
  // All units but minutes are whole nanoseconds. Stamps in minutes are small.
  const auto whole_ns = ns_per_unit == std::round(ns_per_unit)
                            ? static_cast<std::int64_t>(units) * static_cast<std::int64_t>(ns_per_unit)
                            : std::llround(static_cast<double>(units) * ns_per_unit);
  const std::int64_t ns = whole_ns + std::llround(share * ns_per_unit);
  return negative ? -ns : ns;
}

std::optional<std::int64_t> parse_date_stamp(std::string_view text, bool needs_zone) {
  Taker taker(text);
  std::int64_t date = 0, clock = 0, ahead = 0;
  if (!take_date(taker, date)) return std::nullopt;
  if (!taker.take("Tt")) {
    if (!taker.take(" \t")) return std::nullopt;
    taker.skip_blanks();
  }
  if (!take_clock(taker, clock) || (needs_zone && taker.rest().empty()) || !take_zone(taker, ahead) ||
      !taker.rest().empty())
    return std::nullopt;
  return date + clock - ahead;
}

std::optional<std::int64_t> parse_clock_stamp(std::string_view text) {
  if (text.find(':') == std::string_view::npos) return std::nullopt;
  Taker taker(text);
  std::int64_t ns = 0;
  if (!take_clock(taker, ns) || !taker.rest().empty()) return std::nullopt;
  return ns;
}

}  // namespace haptrace
