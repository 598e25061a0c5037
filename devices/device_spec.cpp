#include "devices/device_spec.h"

#include "control/error.h"

#include <fmt/format.h>

namespace haptrace {

DeviceSpec DeviceSpec::parse(std::string_view text) {
  const auto refuse = [text](const std::string& why) {
    return input_error(fmt::format("--device '{}': {}; it reads NAME[:key=value[,key=value...]]", text, why));
  };

  DeviceSpec spec;
  spec.text = text;
  const auto colon = text.find(':');
  spec.name = text.substr(0, colon);
  if (spec.name.empty()) throw refuse("the device has no name");
  if (const auto bad = spec.name.find_first_of("=,"); bad != std::string::npos)
    throw refuse(fmt::format("'{}' cannot stand in a name; options follow a ':'", spec.name[bad]));
  if (colon == std::string_view::npos) return spec;

  std::string_view rest = text.substr(colon + 1);
  for (bool more = true; more;) {
    const auto equals = rest.find('=');
    const auto comma = rest.find(',');
    if (equals == std::string_view::npos || comma < equals)
      throw refuse(fmt::format("the option '{}' has no '='", rest.substr(0, comma)));
    const std::string key(rest.substr(0, equals));
    if (key.empty()) throw refuse(fmt::format("'{}' has no key before its '='", rest.substr(0, comma)));

    // A JSON object has commas of its own.
    const auto end = key == "options" ? std::string_view::npos : comma;
    const std::string value(rest.substr(equals + 1, end == std::string_view::npos ? end : end - equals - 1));
    if (value.empty()) throw refuse(fmt::format("the option '{}' has no value", key));
    if (!spec.options.emplace(key, value).second) throw refuse(fmt::format("the option '{}' stands twice", key));

    more = end != std::string_view::npos;
    if (more) rest.remove_prefix(end + 1);
  }
  return spec;
}

}  // namespace haptrace
