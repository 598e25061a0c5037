// JSON numbers that may be absent.
#pragma once

#include "base/json_reader.h"

#include <optional>

namespace haptrace {

/// Returns a JSON number, or null if there is no value or it is not finite.
inline nlohmann::json json_of_number(const std::optional<double>& value) {
  return value ? json_of_number(*value) : nlohmann::json(nullptr);
}

}  // namespace haptrace
