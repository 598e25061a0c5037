// Results of assessments, for users.
#pragma once

#include <string>

namespace haptrace {

/// A result and its value with the unit: "direction 3 (90 degrees)", ">= 81.2 mm". An undefined one is "undefined".
struct NamedResult {
  std::string name, value;
};

}  // namespace haptrace
