// Units that texts name, and their values in SI.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

struct Unit {
  std::string_view name;  ///< in lower case, as texts write it
  std::string_view si;    ///< of its quantity: s, m, m/s, N or N m
  double per_si = 1;      ///< how many are one of SI: 1000 for mm
};

/// All that are known; of several names of a unit, the one for messages comes first.
std::span<const Unit> units();

/// Finds the unit `text`, in any case, with or without brackets, a dot, a star or blanks between its parts. `si` empty:
/// of any quantity but torque, whose "nm" is then no unit. Returns the unit by its short name, or null.
const Unit* find_unit(std::string_view text, std::string_view si);

/// Returns the SI unit that ends a description in brackets, as in "servo rate [Hz]": the first that stands so, or an
/// empty text.
std::string bracketed_unit(std::string_view description);

/// Returns a number with a unit of the quantity whose SI unit is `si`, or without a unit, in SI: 0.02 for "20mm" and
/// "m". Nothing when the text is no finite number with such a unit.
std::optional<double> parse_quantity(std::string_view text, std::string_view si);

/// Returns a short time for people: "850 us" below a millisecond, "12.3 ms" below a second, else "4.56 s".
std::string duration_text(double seconds);

/// Text in lower case, of which the micro sign, in UTF-8 or Latin-1, is a u.
std::string lower_case(std::string_view text);

}  // namespace haptrace
