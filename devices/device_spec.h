// The text after --device.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// `NAME[:key=value[,key=value...]]`, taken apart. The value of `options` is the rest of the text, commas included.
struct DeviceSpec {
  std::string text;  ///< as given
  std::string name;
  std::map<std::string, std::string> options;

  /// Throws Error(input) naming the part that cannot be read.
  static DeviceSpec parse(std::string_view text);

  /// "--device 'TEXT'", to begin an error with.
  [[nodiscard]] std::string where() const;

  [[nodiscard]] std::string option(const std::string& key, const std::string& otherwise = "") const;

  /// Throws Error(input) when it is neither true nor false.
  [[nodiscard]] bool flag(const std::string& key, bool otherwise = false) const;

  /// Of double, int or std::uint64_t. Throws Error(input) naming the range unless it is a number from `least` to
  /// `most`, and a whole one where those are.
  template <class Number>
  [[nodiscard]] Number number(const std::string& key, Number least, Number most, Number otherwise,
                              std::string_view unit = "") const;
};

}  // namespace haptrace
