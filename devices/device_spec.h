// Parser of the text after --device.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A parsed device text, `NAME[:key=value[,key=value...]]`. The value of the key `options` is the rest of the text,
/// commas included.
struct DeviceSpec {
  std::string text;  ///< as given
  std::string name;
  std::map<std::string, std::string> options;

  /// Parses `text`. Throws Error(input) naming the part that cannot be read.
  static DeviceSpec parse(std::string_view text);

  /// Returns "--device 'TEXT'", the beginning of an error message.
  [[nodiscard]] std::string where() const;

  [[nodiscard]] std::string option(const std::string& key, const std::string& otherwise = "") const;

  /// Returns an option as a Boolean. Throws Error(input) if it is neither true nor false.
  [[nodiscard]] bool flag(const std::string& key, bool otherwise = false) const;

  /// Returns an option as a double, int or std::uint64_t. Throws Error(input) naming the range unless it is a number
  /// from `least` to `most`; for the integer types it must be whole. A double may have a unit of the quantity whose SI
  /// unit is `unit`, as in 20ms, and is returned in SI.
  template <class Number>
  [[nodiscard]] Number number(const std::string& key, Number least, Number most, Number otherwise,
                              std::string_view unit = "") const;
};

}  // namespace haptrace
