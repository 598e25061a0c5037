// Units in text, and their conversion to SI.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

struct Unit {
  std::string_view name;  ///< name in lower case
  std::string_view si;    ///< SI unit of the same quantity, such as s, m, m/s, N or N m
  double per_si = 1;      ///< number of these units in one SI unit: 1000 for mm
};

/// Returns the units that the header of a file can name. If a unit has several names, the one for messages comes first.
std::span<const Unit> units();

/// Finds the unit `text`, ignoring case, brackets, and any dots, stars or blanks between its parts. An empty `si`
/// allows all quantities, but then "nm" is not accepted as N m. Returns the unit by its short name, or null.
const Unit* find_unit(std::string_view text, std::string_view si);

/// Returns the first SI unit that stands in brackets in a description, as in "servo rate [Hz]", or an empty text.
std::string bracketed_unit(std::string_view description);

/// Parses a number with or without a unit of the quantity whose SI unit is `si`, and returns it in SI: 0.02 for "20mm"
/// and "m". Returns nothing if the text is not a finite number with such a unit.
std::optional<double> parse_quantity(std::string_view text, std::string_view si);

/// Returns a duration as text: "850 us" below a millisecond, "12.3 ms" below a second, else "4.56 s".
std::string duration_text(double seconds);

/// Returns a finite duration of seconds to days as people say it: "4.5 s" below 10 s, "12 s" below 100 s, "8 min" below
/// 100 min, "2 h 5 min" below 10 h, else "12 h". `space` stands between a number and its unit.
std::string long_duration_text(double seconds, std::string_view space = " ");

/// Returns `text` in lower case, with the micro sign (UTF-8 or Latin-1) or Greek mu as a u.
std::string lower_case(std::string_view text);

}  // namespace haptrace
