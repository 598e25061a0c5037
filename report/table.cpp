#include "report/table.h"

#include "report/markup.h"

#include <fmt/format.h>

namespace haptrace {

using pugi::xml_node;

Table::Table(xml_node parent, const std::string& caption, std::size_t rows) {
  constexpr std::size_t kFew = 16;
  xml_node box = parent.append_child("div");
  set(box, "class", rows <= kFew ? "table short" : "table");
  set(box, "role", "region");
  set(box, "aria-label", caption);
  set(box, "tabindex", "0");
  table_ = box.append_child("table");
  add(add(table_, "caption"), "span", caption);
  head_ = add(add(table_, "thead"), "tr");
  body_ = add(table_, "tbody");
}

void Table::column(const std::string& title, bool number) {
  xml_node cell = add(head_, "th", title);
  set(cell, "scope", "col");
  if (number) set(cell, "class", "number");
  titles_.push_back(title);
}

xml_node Table::row(const std::string& title) {
  row_ = body_.append_child("tr");
  xml_node cell = add(row_, "th", title);
  set(cell, "scope", "row");
  if (!titles_.empty()) set(cell, "data-label", titles_.front());
  cell_ = 1;
  return row_;
}

xml_node Table::text(const std::string& what) {
  xml_node cell = add(row_, "td", what);
  if (cell_ < titles_.size()) set(cell, "data-label", titles_[cell_]);
  ++cell_;
  return cell;
}

xml_node Table::number(const std::string& what) {
  xml_node cell = text(what);
  set(cell, "class", "number");
  return cell;
}

std::string count(std::size_t n, const std::string& what) {
  return fmt::format("{} {}{}", n, what, n == 1 ? "" : "s");
}

}  // namespace haptrace
