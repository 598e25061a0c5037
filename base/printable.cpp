#include "base/printable.h"

#include <array>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

/// Control characters, and those that turn the direction of writing or break lines.
bool is_obeyed(char32_t code) {
  return code < 0x20 || (code >= 0x7f && code < 0xa0) || (code >= 0x2028 && code <= 0x202e) ||
         (code >= 0x2066 && code <= 0x2069);
}

/// `escape` writes out what stays not as it is.
template <class Escape>
std::string escaped(std::string_view text, bool lines, const Escape& escape) {
  std::string result;
  result.reserve(text.size());
  while (!text.empty()) {
    const Character character = first_character(text);
    const std::size_t bytes = character.bytes > 0 ? character.bytes : 1;
    if (character.bytes > 0 && (!is_obeyed(character.code) || (lines && (text[0] == '\n' || text[0] == '\t'))))
      result += text.substr(0, bytes);
    else
      result += escape(character, static_cast<unsigned char>(text[0]));
    text.remove_prefix(bytes);
  }
  return result;
}

std::string written_out(std::string_view text, bool lines) {
  return escaped(text, lines, [](const Character& character, unsigned char byte) {
    return character.bytes < 2 ? fmt::format("\\x{:02x}", byte)
                               : fmt::format("\\u{{{:04x}}}", static_cast<std::uint32_t>(character.code));
  });
}

}  // namespace

Character first_character(std::string_view text) {
  if (text.empty()) return {};
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x80) return {1, first};
  const std::size_t bytes = first >= 0xf0 && first < 0xf5   ? 4
                            : first >= 0xe0 && first < 0xf0 ? 3
                            : first >= 0xc2 && first < 0xe0 ? 2
                                                            : 0;
  if (bytes == 0 || text.size() < bytes) return {};
  char32_t code = first & (0x7fU >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0U) != 0x80U) return {};
    code = (code << 6U) | (byte(i) & 0x3fU);
  }
  constexpr std::array<char32_t, 5> kLeast{0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code < 0xe000;
  if (code < kLeast[bytes] || code > 0x10ffff || surrogate) return {};
  return {bytes, code};
}

std::size_t find_invalid_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t bytes = first_character(text.substr(i)).bytes;
    if (bytes == 0) return i;
    i += bytes;
  }
  return std::string_view::npos;
}

std::string utf8_text(std::string_view text) {
  std::string result;
  for (std::size_t at = find_invalid_utf8(text); at != std::string_view::npos; at = find_invalid_utf8(text)) {
    result += text.substr(0, at);
    result += "\uFFFD";
    text.remove_prefix(at + 1);
  }
  return result.append(text);
}

std::string printable(std::string_view text) {
  return written_out(text, false);
}

std::string printable_lines(std::string_view text) {
  return written_out(text, true);
}

std::string printable_json(const nlohmann::json& json, int indent) {
  const std::string text = json.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
  return escaped(text, true, [](const Character& character, unsigned char) {
    return fmt::format("\\u{:04x}", static_cast<std::uint32_t>(character.code));
  });
}

}  // namespace haptrace
