// Builds HTML as a tree and escapes every text on insertion. Private to report.
#pragma once

#include <pugixml.hpp>
#include <string>
#include <string_view>

namespace haptrace {

inline constexpr const char* kUndefined = "\u2013";    ///< en dash
inline constexpr const char* kNarrowSpace = "\u202f";  ///< a space that does not break a line

/// Appends text. Characters that a document may not contain (control characters, invalid UTF-8) become U+FFFD.
void add_text(pugi::xml_node node, std::string_view text);

/// Appends an element with this text, which may be empty. The text node keeps an empty element from becoming <td/>,
/// which HTML reads as <td>.
pugi::xml_node add(pugi::xml_node parent, const char* element, std::string_view text = "");

void set(pugi::xml_node node, const char* attribute, std::string_view value);

/// Returns the number with a leading hyphen replaced by a minus sign.
std::string with_minus(std::string number);

}  // namespace haptrace
