#include "report/markup.h"

#include <array>
#include <cstdint>

namespace haptrace {
namespace {

constexpr std::string_view kReplacement = "\uFFFD";

/// Bytes of the UTF-8 character that `text` begins with; 0 when it is none that a document may hold.
std::size_t character(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x20) return first == '\t' || first == '\n' || first == '\r' ? 1 : 0;
  if (first < 0x7f) return 1;
  const std::size_t length = first >= 0xf0 && first < 0xf5   ? 4
                             : first >= 0xe0 && first < 0xf0 ? 3
                             : first >= 0xc2 && first < 0xe0 ? 2
                                                             : 0;
  if (length == 0 || text.size() < length) return 0;
  std::uint32_t code = first & (0x7fU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xc0U) != 0x80U) return 0;
    code = (code << 6U) | (byte(i) & 0x3fU);
  }
  constexpr std::array<std::uint32_t, 5> kLeast{0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code < 0xe000;
  const bool none = (code & 0xfffeU) == 0xfffeU || (code >= 0x7f && code < 0xa0);
  return code < kLeast[length] || code > 0x10ffff || surrogate || none ? 0 : length;
}

std::string clean(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const std::size_t length = character(text);
    result += length > 0 ? text.substr(0, length) : kReplacement;
    text.remove_prefix(length > 0 ? length : 1);
  }
  return result;
}

}  // namespace

void add_text(pugi::xml_node node, std::string_view text) {
  node.append_child(pugi::node_pcdata).set_value(clean(text).c_str());
}

pugi::xml_node add(pugi::xml_node parent, const char* element, std::string_view text) {
  pugi::xml_node node = parent.append_child(element);
  add_text(node, text);
  return node;
}

void set(pugi::xml_node node, const char* attribute, std::string_view value) {
  node.append_attribute(attribute).set_value(clean(value).c_str());
}

std::string with_minus(std::string number) {
  if (!number.empty() && number[0] == '-') number.replace(0, 1, "\u2212");
  return number;
}

}  // namespace haptrace
