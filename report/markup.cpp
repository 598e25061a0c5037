#include "report/markup.h"

#include "base/printable.h"

namespace haptrace {
namespace {

constexpr std::string_view kReplacement = "\uFFFD";

/// Returns the length of the first character of `text` in bytes; 0 when a document may not contain it.
std::size_t character(std::string_view text) {
  const auto [bytes, code] = first_character(text);
  const bool blank = code == '\t' || code == '\n' || code == '\r';
  const bool none = (code & 0xfffeU) == 0xfffeU || (code >= 0x7f && code < 0xa0) || (code < 0x20 && !blank);
  return none ? 0 : bytes;
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
