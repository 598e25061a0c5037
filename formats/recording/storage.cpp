#include "formats/recording/storage.h"

#include "base/error.h"
#include "base/number.h"
#include "base/text_file.h"
#include "base/units.h"

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <vector>

namespace haptrace {
namespace {

/// Units with SI prefixes, whose case counts: nm is a length, Nm a torque. All other names are those of
/// parse_quantity().
struct PrecisionUnit {
  std::string_view name, si;
  double Precision::*quantity;
};
constexpr std::array<PrecisionUnit, 4> kPrecisionUnits{{{"m/s", "m/s", &Precision::velocity},
                                                        {"Nm", "N m", &Precision::torque},
                                                        {"N", "N", &Precision::force},
                                                        {"m", "m", &Precision::position}}};

struct Prefix {
  std::string_view name;
  double factor;
};
constexpr std::array<Prefix, 5> kPrefixes{{{"", 1}, {"m", 1e-3}, {"u", 1e-6}, {"µ", 1e-6}, {"n", 1e-9}}};

/// Sets the quantity that `part` names. Returns false if it names none.
bool read_part(std::string_view part, Precision& precision) {
  const std::string_view whole = trim(part);
  std::string_view name = whole;
  const auto number = take_number<double>(name);
  name = trim(name);
  if (!number || !(*number > 0) || !std::isfinite(*number) || name.empty()) return false;
  for (const PrecisionUnit& unit : kPrecisionUnits) {
    for (const Prefix& prefix : kPrefixes) {
      if (name != std::string(prefix.name) + std::string(unit.name)) continue;
      precision.*unit.quantity = *number * prefix.factor;
      return true;
    }
  }
  for (const PrecisionUnit& unit : kPrecisionUnits) {
    const auto value = parse_quantity(whole, unit.si);
    if (!value || !(*value > 0)) continue;
    precision.*unit.quantity = *value;
    return true;
  }
  return false;
}

}  // namespace

Precision parse_precision(std::string_view text) {
  Precision precision;
  if (text.empty()) return precision;
  for (;;) {
    const std::size_t comma = text.find(',');
    const std::string_view part = text.substr(0, comma);
    if (!read_part(part, precision))
      throw input_error(fmt::format(
          "precision '{}' is not a positive number with a unit; write, for example, 1um,1mN (m, m/s, N, Nm)", part));
    if (comma == std::string_view::npos) return precision;
    text.remove_prefix(comma + 1);
  }
}

std::string to_string(const Precision& precision) {
  std::vector<std::string> parts;
  for (const double Precision::*quantity :
       {&Precision::position, &Precision::velocity, &Precision::force, &Precision::torque}) {
    if (precision.*quantity == 0) continue;
    for (const PrecisionUnit& unit : kPrecisionUnits)
      if (unit.quantity == quantity) parts.push_back(fmt::format("{}{}", precision.*quantity, unit.name));
  }
  return fmt::format("{}", fmt::join(parts, ","));
}

void validate(const Storage& storage) {
  if (storage.deflate < 0 || storage.deflate > 9)
    throw input_error(fmt::format("the compression level is {}; it must be from 0 (none) to 9", storage.deflate));
  for (const double bound :
       {storage.precision.position, storage.precision.velocity, storage.precision.force, storage.precision.torque})
    if (!(bound >= 0 && std::isfinite(bound)))
      throw input_error(fmt::format("a precision is {}; it must be a positive number, or 0 for every bit", bound));
}

}  // namespace haptrace
