// Conversion of text from files, devices and users for safe output to a terminal.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace haptrace {

/// The first character of a text.
struct Character {
  std::size_t bytes = 0;  ///< length; 0: the text does not begin with valid UTF-8
  char32_t code = 0;
};
Character first_character(std::string_view text);

/// Returns the position of the first byte that is not UTF-8; npos if there is none.
std::size_t find_invalid_utf8(std::string_view text);

/// Returns `text` with U+FFFD in place of every byte that is not UTF-8. The texts of a recording must be UTF-8.
std::string utf8_text(std::string_view text);

/// Returns the longest beginning of `text` of at most `bytes` bytes that does not cut a character.
std::string_view utf8_prefix(std::string_view text, std::size_t bytes);

/// Returns `text` with everything that a terminal obeys instead of showing written out: control characters and bytes
/// that are not UTF-8 as \x1b, characters that turn the direction of writing as \u{202e}. Line feeds too, so that a
/// title cannot look like a line of ours.
std::string printable(std::string_view text);

/// Does the same for text of several lines, but keeps line feeds and tabs.
std::string printable_lines(std::string_view text);

/// Returns `json` as text, with the same characters in JSON's own escapes. Bytes that are not UTF-8 become U+FFFD. A
/// negative `indent` writes everything on one line.
std::string printable_json(const nlohmann::json& json, int indent = 2);

}  // namespace haptrace
