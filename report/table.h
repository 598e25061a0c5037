// Tables of a page. Private to report.
#pragma once

#include <cstddef>
#include <pugixml.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// A table with a caption. On a wide screen its box scrolls sideways, also with the keyboard. On a narrow screen every
/// row becomes a list, in which each cell shows the title of its column, so that nothing is out of sight.
class Table {
 public:
  /// A table with few `rows` stays on one printed page.
  Table(pugi::xml_node parent, const std::string& caption, std::size_t rows);

  void column(const std::string& title, bool number = false);

  pugi::xml_node row(const std::string& title);
  /// Returns the title cell of the row.
  [[nodiscard]] pugi::xml_node title() const { return row_.first_child(); }

  pugi::xml_node text(const std::string& what);
  pugi::xml_node number(const std::string& what);

 private:
  pugi::xml_node table_, head_, body_, row_;
  std::vector<std::string> titles_;
  std::size_t cell_ = 0;
};

/// Returns "1 repetition", "2 repetitions".
std::string count(std::size_t n, const std::string& what);

}  // namespace haptrace
