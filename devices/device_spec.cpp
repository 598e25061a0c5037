#include "devices/device_spec.h"

#include "base/error.h"
#include "base/number.h"
#include "base/units.h"

#include <cstdint>
#include <fmt/format.h>
#include <limits>
#include <optional>
#include <type_traits>

namespace haptrace {

DeviceSpec DeviceSpec::parse(std::string_view text) {
  const auto refuse = [text](const std::string& why) {
    return input_error(fmt::format("--device '{}': {}; expected NAME[:key=value[,key=value...]]", text, why));
  };

  DeviceSpec spec;
  spec.text = text;
  const auto colon = text.find(':');
  spec.name = text.substr(0, colon);
  if (spec.name.empty()) throw refuse("the device has no name");
  if (const auto bad = spec.name.find_first_of("=,"); bad != std::string::npos)
    throw refuse(fmt::format("a name cannot contain '{}'; options follow a ':'", spec.name[bad]));
  if (colon == std::string_view::npos) return spec;

  std::string_view rest = text.substr(colon + 1);
  for (bool more = true; more;) {
    const auto equals = rest.find('=');
    const auto comma = rest.find(',');
    if (equals == std::string_view::npos || comma < equals)
      throw refuse(fmt::format("the option '{}' has no '='", rest.substr(0, comma)));
    const std::string key(rest.substr(0, equals));
    if (key.empty()) throw refuse(fmt::format("'{}' has no key before its '='", rest.substr(0, comma)));

    // A JSON object contains commas, so it takes the rest of the text.
    const auto end = key == "options" ? std::string_view::npos : comma;
    const std::string value(rest.substr(equals + 1, end == std::string_view::npos ? end : end - equals - 1));
    if (value.empty()) throw refuse(fmt::format("the option '{}' has no value", key));
    if (!spec.options.emplace(key, value).second) throw refuse(fmt::format("the option '{}' is given twice", key));

    more = end != std::string_view::npos;
    if (more) rest.remove_prefix(end + 1);
  }
  return spec;
}

std::string DeviceSpec::where() const {
  return fmt::format("--device '{}'", text);
}

std::string DeviceSpec::option(const std::string& key, const std::string& otherwise) const {
  const auto found = options.find(key);
  return found != options.end() ? found->second : otherwise;
}

bool DeviceSpec::flag(const std::string& key, bool otherwise) const {
  const std::string value = option(key, otherwise ? "true" : "false");
  if (value != "true" && value != "false")
    throw input_error(fmt::format("{}: {}: expected true or false, found '{}'", where(), key, value));
  return value == "true";
}

template <class Number>
Number DeviceSpec::number(const std::string& key, Number least, Number most, Number otherwise,
                          std::string_view unit) const {
  const auto found = options.find(key);
  if (found == options.end()) return otherwise;
  const std::string& value = found->second;
  std::optional<Number> number = number_of<Number>(value);
  if constexpr (std::is_floating_point_v<Number>)
    if (!number && !unit.empty()) number = parse_quantity(value, unit);
  if (number && *number >= least && *number <= most) return *number;
  const bool bounded = most < std::numeric_limits<Number>::max();
  throw input_error(fmt::format("{}: {}: expected a {}number from {}{}{}{}, found '{}'", where(), key,
                                std::is_integral_v<Number> ? "whole " : "", least,
                                bounded ? fmt::format(" to {}", most) : "", unit.empty() ? "" : " ", unit, value));
}

template double DeviceSpec::number(const std::string&, double, double, double, std::string_view) const;
template int DeviceSpec::number(const std::string&, int, int, int, std::string_view) const;
template std::uint64_t DeviceSpec::number(const std::string&, std::uint64_t, std::uint64_t, std::uint64_t,
                                          std::string_view) const;

}  // namespace haptrace
