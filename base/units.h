// Units that texts name, and what they are in SI. Private to formats.
#pragma once

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

/// Text in lower case, of which the micro sign, in UTF-8 or Latin-1, is a u.
std::string lower_case(std::string_view text);

}  // namespace haptrace
