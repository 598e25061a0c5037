// Parsing of numbers in text.
#pragma once

#include <charconv>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

namespace haptrace {

/// Removes the number at the start of `text` and returns it. If there is no number or it is out of range, returns
/// nothing and leaves `text` unchanged. Accepts "nan" and "inf", but no leading "+".
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

/// Parses the whole of `text` as a number, under the rules of take_number().
template <class Number>
std::optional<Number> number_of(std::string_view text, int base = 10) noexcept {
  const std::optional<Number> value = take_number<Number>(text, base);
  return text.empty() ? value : std::nullopt;
}

}  // namespace haptrace
