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
};

}  // namespace haptrace
