// Building HTML as a tree, so that every text is escaped where it goes in. Private to report.
#pragma once

#include <pugixml.hpp>
#include <string>
#include <string_view>

namespace haptrace {

inline constexpr const char* kUndefined = "\u2013";    ///< en dash
inline constexpr const char* kNarrowSpace = "\u202f";  ///< that does not break a line

/// Appends text. What no document may hold (control characters, bytes that are no UTF-8) becomes U+FFFD.
void add_text(pugi::xml_node node, std::string_view text);

/// Appends an element with this text, which may be empty. It never becomes <td/>, which HTML reads as <td>.
pugi::xml_node add(pugi::xml_node parent, const char* element, std::string_view text = "");

void set(pugi::xml_node node, const char* attribute, std::string_view value);

/// A hyphen in front of a number as a minus sign.
std::string with_minus(std::string number);

}  // namespace haptrace
