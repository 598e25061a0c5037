// Numbers in texts.
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

namespace haptrace {

/// Removes the number that `text` begins with, and returns it. Returns nothing, and leaves `text`, when it begins with
/// none or the number is out of range. "nan" and "inf" are numbers; a leading "+" is not.
template <class Number>
std::optional<Number> take_number(std::string_view& text, int base = 10) noexcept {
  Number value{};
  std::from_chars_result result{};
  if constexpr (std::is_integral_v<Number>)
    result = std::from_chars(text.data(), text.data() + text.size(), value, base);
  else
    result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc{}) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(result.ptr - text.data()));
  return value;
}

/// Returns the number that the whole of `text` is, under the rules of take_number().
template <class Number>
std::optional<Number> number_of(std::string_view text, int base = 10) noexcept {
  const std::optional<Number> value = take_number<Number>(text, base);
  return text.empty() ? value : std::nullopt;
}

}  // namespace haptrace
