#include "base/printable.h"

#include <fmt/format.h>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utf8.h>

namespace haptrace {
namespace {

/// Returns true for control characters, and for characters that change the writing direction or break lines.
bool is_obeyed(char32_t code) {
  return code < 0x20 || (code >= 0x7f && code < 0xa0) || (code >= 0x2028 && code <= 0x202e) ||
         (code >= 0x2066 && code <= 0x2069);
}

/// Replaces each unsafe character by the result of `escape`. Keeps line feeds and tabs if `lines` is set.
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
  const char* end = text.data();
  try {
    const char32_t code = utf8::next(end, text.data() + text.size());
    return {static_cast<std::size_t>(end - text.data()), code};
  } catch (const utf8::exception&) {
    return {};
  }
}

std::size_t find_invalid_utf8(std::string_view text) {
  return utf8::find_invalid(text);
}

std::string utf8_text(std::string_view text) {
  std::string result;
  utf8::replace_invalid(text.begin(), text.end(), std::back_inserter(result), U'\uFFFD');
  return result;
}

std::string_view utf8_prefix(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  const char* end = text.data() + bytes;
  while (end > text.data() && (static_cast<unsigned char>(*end) & 0xC0U) == 0x80U) --end;
  return text.substr(0, static_cast<std::size_t>(end - text.data()));
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
