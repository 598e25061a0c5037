#include "formats/csv.h"

#include "control/error.h"
#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::size_t kRequiredCells = 4;  // t,x,y,z

std::string_view unquote(std::string_view text) {
  text = trim(text);
  if (text.size() >= 2 && text.front() == text.back() && (text.front() == '"' || text.front() == '\''))
    text = trim(text.substr(1, text.size() - 2));
  return text;
}

/// Calls `visit(index, field)` for every field and answers how many there were.
template <class Visit>
std::size_t split(std::string_view line, char separator, const Visit& visit) {
  for (std::size_t index = 0;; ++index) {
    const std::size_t end = line.find(separator);
    visit(index, line.substr(0, end));
    if (end == std::string_view::npos) return index + 1;
    line.remove_prefix(end + 1);
  }
}

/// Names of all cells.
const std::vector<std::string_view>& cell_names() {
  static const std::vector<std::string_view> names = [] {
    std::vector<std::string_view> all;
    for (const TextColumn& column : text_columns())
      all.insert(all.end(), column.names.begin(), column.names.begin() + static_cast<std::ptrdiff_t>(column.width()));
    return all;
  }();
  return names;
}

/// A column that holds a number in every row stays; one that holds none goes; one in between goes with a note.
template <class Value>
void settle(std::vector<Value>& column, const char* name, std::vector<std::string>& notes) {
  const auto known = std::count_if(column.begin(), column.end(), [](const Value& value) { return is_finite(value); });
  if (known == std::ssize(column)) return;
  if (known > 0)
    notes.push_back(
        fmt::format("{} left out: {} of {} samples have none", name, std::ssize(column) - known, column.size()));
  column.clear();
}

}  // namespace

CsvReader::CsvReader(const std::string& file, Options options)
    : lines_(file, "CSV"),
      options_(std::move(options)),
      present_(text_columns().size(), false),
      cells_(unknown_cells()) {
  std::string_view line;
  bool found = false;
  while (!found && lines_.next(line)) {
    found = !trim(line).empty() && !line.starts_with('#');
    for (const std::string_view kind : {"# haptrace {", "# event {"})
      if (line.starts_with(kind)) comments_.emplace_back(line.substr(2));
  }
  if (!found) throw input_error(file + ": is empty; a path has a header t,x,y,z and a row for every sample");
  recording_ = !comments_.empty() && comments_.front().starts_with("haptrace");
  parse_header(line);
}

void CsvReader::parse_header(std::string_view line) {
  if (line.starts_with("\xFF\xFE") || line.starts_with("\xFE\xFF"))
    throw lines_.error("the text is UTF-16; save it as UTF-8 or ASCII");
  separator_ = line.find('\t') != std::string_view::npos ? '\t' : line.find(';') != std::string_view::npos ? ';' : ',';
  const std::vector<std::string_view>& known = cell_names();
  std::vector<std::string> names;
  std::vector<bool> found(cell_count(), false);
  bool numeric = true;
  split(line, separator_, [&](std::size_t, std::string_view text) {
    std::string name(unquote(text));
    double number = 0;
    numeric = numeric && parse_number(name, number);
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    const auto at = static_cast<std::size_t>(std::find(known.begin(), known.end(), name) - known.begin());
    if (at < known.size()) {
      if (found[at]) throw lines_.error(fmt::format("the header names the column {} twice", name));
      found[at] = true;
    }
    cell_of_field_.push_back(at < known.size() ? at : kPassedOver);
    names.push_back(name);
  });
  if (numeric)
    throw lines_.error(fmt::format(
        "there is no header; the first line must name the columns, as in t,x,y,z; found '{}'", shown(line)));

  std::vector<std::string_view> missing;
  for (std::size_t cell = 0; cell < kRequiredCells; ++cell)
    if (!found[cell]) missing.push_back(known[cell]);
  if (!missing.empty())
    throw lines_.error(
        fmt::format("the header lacks {}; it must name t,x,y,z, separated by comma, semicolon or tab; found '{}'",
                    fmt::join(missing, ", "), shown(line)));

  // Of a vector, all components or none. Columns that are known but not asked for are passed over without a word.
  std::vector<bool> read(cell_count() + 1, false), incomplete(cell_count() + 1, false);
  for (std::size_t index = 0; index < text_columns().size(); ++index) {
    const TextColumn& column = text_columns()[index];
    bool whole = true;
    for (std::size_t i = 0; i < column.width(); ++i) whole = whole && found[column.first + i];
    present_[index] = whole && index < options_.columns;
    for (std::size_t i = 0; i < column.width(); ++i) {
      read[column.first + i] = present_[index];
      incomplete[column.first + i] = !whole;
    }
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::size_t& cell = cell_of_field_[i];
    if (cell == kPassedOver || incomplete[cell]) ignored_ += (ignored_.empty() ? "" : ", ") + shown(names[i]);
    if (cell != kPassedOver && !read[cell]) cell = kPassedOver;
  }
}

double CsvReader::parse_field(std::size_t cell, std::string_view text) const {
  const std::string_view name = cell_names()[cell];
  const std::string_view field = unquote(text);
  const bool may_be_missing = cell >= kRequiredCells || (recording_ && cell > 0);
  double value = 0;
  if (parse_number(field, value)) {
    if (std::isfinite(value) || (std::isnan(value) && may_be_missing) || (recording_ && cell > 0)) return value;
    throw lines_.error(fmt::format("column {}: '{}' is not a finite number", name, shown(field)));
  }
  if (field.empty() && may_be_missing) return kNaN;
  if (field.empty()) throw lines_.error(fmt::format("column {}: the field is empty", name));
  std::string with_point(field);
  std::replace(with_point.begin(), with_point.end(), ',', '.');
  if (with_point != field && parse_number(with_point, value))
    throw lines_.error(
        fmt::format("column {}: '{}' has a decimal comma; write {} with a point", name, shown(field), with_point));
  throw lines_.error(fmt::format("column {}: '{}' is not a number", name, shown(field)));
}

void CsvReader::check_time(double t) const {
  if (!options_.ordered || rows_ == 0 || t > time_before_) return;
  const std::string remedy = options_.remedy.empty() ? "" : "; " + options_.remedy;
  if (t == time_before_)
    throw lines_.error(
        fmt::format("column t: {} s stands in line {} as well; time stamps must increase{}", t, line_before_, remedy));
  throw lines_.error(fmt::format("column t: {} s comes after {} s in line {}; time stamps must increase{}", t,
                                 time_before_, line_before_, remedy));
}

void CsvReader::parse_row(std::string_view line) {
  const std::size_t in_header = cell_of_field_.size();
  const std::size_t fields = split(line, separator_, [&](std::size_t index, std::string_view text) {
    const std::size_t cell = index < in_header ? cell_of_field_[index] : kPassedOver;
    if (cell != kPassedOver) cells_[cell] = parse_field(cell, text);
  });
  if (fields != in_header)
    throw lines_.error(fmt::format("{} columns where the header has {}{}", fields, in_header,
                                   separator_ == ',' && fields == 2 * in_header
                                       ? "; numbers need a decimal point, or semicolons between the columns"
                                       : ""));
  check_time(cells_[0]);
  time_before_ = cells_[0];
  line_before_ = lines_.number();
  ++rows_;
}

bool CsvReader::next() {
  std::string_view line;
  while (lines_.next(line)) {
    if (trim(line).empty()) {
      blank_ = blank_ == 0 ? lines_.number() : blank_;
      continue;
    }
    if (blank_ != 0) throw lines_.error(fmt::format("line {} is blank, but rows follow it", blank_));
    parse_row(line);
    return true;
  }
  if (rows_ == 0 && !recording_) throw lines_.error("there is a header but no row");
  return false;
}

Path read_csv(const std::string& file) {
  CsvReader reader(file, {});
  Path path;
  path.name = file;
  if (!reader.ignored().empty()) path.notes.push_back("columns left out: " + reader.ignored());
  while (reader.next()) {
    const double* cell = reader.cells().data();
    path.time.push_back(cell[0]);
    path.position.emplace_back(cell[1], cell[2], cell[3]);
    if (reader.has(2)) path.velocity.emplace_back(cell[4], cell[5], cell[6]);
    if (reader.has(3)) path.force.emplace_back(cell[7], cell[8], cell[9]);
    if (reader.has(4)) path.orientation.emplace_back(cell[10], cell[11], cell[12], cell[13]);
  }
  settle(path.velocity, "velocity", path.notes);
  settle(path.force, "force", path.notes);
  settle(path.orientation, "orientation", path.notes);
  return path;
}

void write_csv(const Path& path, const std::string& file, bool overwrite) {
  TextWriter writer(file, overwrite);
  std::string& text = writer.text();
  text = "t,x,y,z";
  if (!path.velocity.empty()) text += ",vx,vy,vz";
  if (!path.force.empty()) text += ",fx,fy,fz";
  if (!path.orientation.empty()) text += ",qw,qx,qy,qz";
  text += '\n';
  const auto out = std::back_inserter(text);
  for (std::size_t i = 0; i < path.size(); ++i) {
    fmt::format_to(out, "{}", path.time[i]);
    for (const std::vector<Vec3>* column : {&path.position, &path.velocity, &path.force})
      if (!column->empty()) fmt::format_to(out, ",{},{},{}", (*column)[i].x(), (*column)[i].y(), (*column)[i].z());
    if (!path.orientation.empty()) {
      const Quat& q = path.orientation[i];
      fmt::format_to(out, ",{},{},{},{}", q.w(), q.x(), q.y(), q.z());
    }
    text += '\n';
    writer.save();
  }
  writer.commit();
}

}  // namespace haptrace
