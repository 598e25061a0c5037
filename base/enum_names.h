// Names of the values of an enumeration.
#pragma once

#include "base/suggest.h"

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The names of an enumeration whose values count from 0, in their order.
///
/// Real-time: name() only.
template <class Enum, std::size_t n>
struct EnumNames {
  std::string_view kind;  ///< of value, for messages: "interpolation"
  std::array<const char*, n> names;

  /// Returns "unknown" for a number that is no value.
  [[nodiscard]] constexpr const char* name(Enum value) const noexcept {
    const auto index = static_cast<std::size_t>(value);
    return index < n ? names[index] : "unknown";
  }

  /// Throws Error(input) `unknown KIND 'TEXT'` with a suggestion.
  [[nodiscard]] Enum parse(std::string_view text) const { return static_cast<Enum>(index_of_name(kind, text, list())); }

  [[nodiscard]] std::vector<std::string> list() const { return {names.begin(), names.end()}; }
};

}  // namespace haptrace
