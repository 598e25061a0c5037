#include "formats/path/csv_options.h"

#include "base/error.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "formats/path/csv_header.h"
#include "formats/path/csv_names.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

void check_asked_column(const std::string& name) {
  const std::vector<std::string> known(cell_names().begin(), cell_names().end());
  if (std::find(known.begin(), known.end(), name) == known.end())
    throw input_error(
        fmt::format("--columns {}=...: haptrace has no column '{}'{}", name, name, suggestion(name, known)));
}

}  // namespace

void add_columns(std::map<std::string, std::string>& columns, std::string_view text) {
  std::map<std::string, std::string> added;
  auto last = added.end();
  for (std::string_view rest = text;;) {
    const std::size_t comma = rest.find(',');
    const std::string_view part = rest.substr(0, comma);
    const std::size_t equals = part.find('=');
    if (equals == std::string_view::npos) {
      if (last == added.end())
        throw input_error(fmt::format("--columns {}: write it as COLUMN=NAME, for example t=time,x=x_mm", text));
      last->second += ',';
      last->second += part;
    } else {
      const std::string column(trim(part.substr(0, equals)));
      check_asked_column(column);
      if (columns.contains(column) || added.contains(column))
        throw input_error(fmt::format("--columns {}: column {} is given twice", text, column));
      last = added.emplace(column, part.substr(equals + 1)).first;
    }
    if (comma == std::string_view::npos) break;
    rest.remove_prefix(comma + 1);
  }
  for (const auto& [column, name] : added)
    if (trim(name).empty())
      throw input_error(fmt::format("--columns {}: the name of the file's column for {} is missing", text, column));
  columns.merge(added);
}

void check(const CsvOptions& options) {
  for (const auto& [column, name] : options.columns) check_asked_column(column);
  (void)asked_units(options);
}

}  // namespace haptrace
