#include "formats/path/csv.h"

#include "base/error.h"
#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Clears a column unless every row has a value. Adds a note if only some rows have one.
template <class Value>
void settle(std::vector<Value>& column, const char* name, std::vector<std::string>& notes) {
  const auto known = std::count_if(column.begin(), column.end(), [](const Value& value) { return is_finite(value); });
  if (known == std::ssize(column)) return;
  if (known > 0)
    notes.push_back(
        fmt::format("{} left out: {} of {} samples lack it", name, std::ssize(column) - known, column.size()));
  column.clear();
}

}  // namespace

CsvReader::CsvReader(const std::string& file, Options options)
    : head_(read_csv_header(file, options.columns, options.csv)),
      lines_(file, "CSV", options.csv.name),
      options_(std::move(options)),
      cells_(unknown_cells()) {
  if (head_.recording && !options_.csv.empty())
    throw input_error(lines_.file() +
                      ": is a recording that haptrace wrote; its columns and units are known. Remove "
                      "--columns and --units");
  std::string_view line;
  while (lines_.number() < head_.last_line && lines_.next(line)) {
  }
}

std::vector<std::string> CsvReader::notes() const {
  std::vector<std::string> notes = head_.notes;
  if (line_of_comma_ > 0) notes.emplace_back("numbers have decimal commas");
  if (lost_ > 0)
    notes.push_back(
        fmt::format("{} of {} rows have no position (the body was not seen) and were left out", lost_, lost_ + rows_));
  if (!head_.ignored.empty()) notes.push_back("columns left out: " + head_.ignored);
  return notes;
}

double CsvReader::parse_field(std::size_t cell, std::string_view field, bool quoted) {
  const bool may_be_missing = cell >= kRequiredCells || ((head_.recording || head_.drops_lost_rows) && cell > 0);
  const std::string& name = head_.labels[cell];
  double value = 0;
  const NumberForm form = parse_csv_number(field, !head_.recording && (quoted || head_.separator != ','), value);
  if (form == NumberForm::comma && line_of_comma_ == 0) line_of_comma_ = lines_.number();
  if (form == NumberForm::point && line_of_point_ == 0) line_of_point_ = lines_.number();
  if (line_of_comma_ > 0 && line_of_point_ > 0 && !head_.recording)
    throw lines_.error(fmt::format("column {}: '{}' has a decimal {}, but numbers from line {} on have a {}", name,
                                   shown(field), form == NumberForm::comma ? "comma" : "point",
                                   form == NumberForm::comma ? line_of_point_ : line_of_comma_,
                                   form == NumberForm::comma ? "point" : "comma"));
  if (form != NumberForm::none) {
    if (std::isfinite(value) || (std::isnan(value) && may_be_missing) || (head_.recording && cell > 0)) return value;
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

double CsvReader::parse_time(std::string_view field, bool quoted) {
  if (head_.stamps == StampForm::number) return parse_field(0, field, quoted) / head_.stamps_per_second;
  const auto stamp = parse_stamp(head_, field, date_, true);
  if (!stamp)
    throw lines_.error(fmt::format(
        "column {}: '{}' is {}", head_.labels[0], shown(field),
        head_.stamps == StampForm::exact ? "not a number"
        : head_.stamps == StampForm::date
            ? "not a date and time like that of the first row, such as 2026-01-31T12:00:00.000Z"
        : head_.date_field.has_value() ? "not a time of day, or its date is invalid"
                                       : "not a time of day like that of the first row, such as 12:00:00.000"));
  std::int64_t since_start = 0;
  if (__builtin_sub_overflow(*stamp, head_.start_ns, &since_start))
    throw lines_.error(
        fmt::format("column {}: '{}' is over 290 years from the first row", head_.labels[0], shown(field)));
  return static_cast<double>(since_start) / 1e9;
}

void CsvReader::check_time(double t) const {
  if (!options_.ordered || rows_ == 0 || t > time_before_) return;
  const std::string remedy = options_.remedy.empty() ? "" : "; " + options_.remedy;
  if (t == time_before_)
    throw lines_.error(
        fmt::format("column t: {} s is in line {} as well; time stamps must increase{}", t, line_before_, remedy));
  throw lines_.error(fmt::format("column t: {} s comes after {} s in line {}; time stamps must increase{}", t,
                                 time_before_, line_before_, remedy));
}

/// Parses a row. Returns false if it has no position and the file permits that.
bool CsvReader::parse_row(std::string_view line) {
  const std::size_t in_header = head_.fields.size();
  std::string_view time;
  bool time_quoted = false, more = false;
  const std::size_t fields =
      split_csv(line, head_.separator, [&](std::size_t index, std::string_view text, bool quoted) {
        if (index >= in_header) {
          more = more || head_.recording || !trim(text).empty();
          return;
        }
        if (head_.date_field == index) date_ = trim(text);
        const CsvHeader::Field& field = head_.fields[index];
        if (field.cell == CsvHeader::kPassedOver) return;
        if (field.cell == 0) {
          time = trim(text);
          time_quoted = quoted;
        } else {
          cells_[field.cell] = parse_field(field.cell, quoted ? trim(text) : text, quoted) / field.per_si;
        }
      });
  if (fields == kOpenQuote)
    throw lines_.error("a field in quotes does not end in this line; fields with line breaks cannot be read");
  // A separator after the last field is ignored.
  if (fields < in_header || more)
    throw lines_.error(fmt::format("{} columns where the header has {}{}", fields, in_header,
                                   head_.separator == ',' && fields == 2 * in_header
                                       ? "; numbers need a decimal point, or semicolons between the columns"
                                       : ""));
  cells_[0] = parse_time(time, time_quoted);
  if (head_.drops_lost_rows && !(std::isfinite(cells_[1]) && std::isfinite(cells_[2]) && std::isfinite(cells_[3]))) {
    ++lost_;
    return false;
  }
  if (!head_.recording) check_row();
  check_time(cells_[0]);
  time_before_ = cells_[0];
  line_before_ = lines_.number();
  ++rows_;
  return true;
}

/// Checks rules that only files of other programs can violate.
void CsvReader::check_row() const {
  constexpr double kUnit = 1e-3;  // tolerance of a quaternion's norm
  for (std::size_t cell = 1; cell < kRequiredCells && !head_.position_unit_known; ++cell)
    if (std::abs(cells_[cell]) > kFarthestWithoutUnit)
      throw lines_.error(
          fmt::format("column {}: {:.6g} m is farther than a hand device reaches, and no unit is stated. Are these "
                      "millimetres? Use --units mm, or --units m if they are metres",
                      head_.labels[cell], cells_[cell]));
  const TextColumn& orientation = text_columns()[kPathColumns - 1];
  const Quat q(cells_[orientation.first], cells_[orientation.first + 1], cells_[orientation.first + 2],
               cells_[orientation.first + 3]);
  if (const double norm = q.norm(); std::abs(norm - 1) > kUnit)
    throw lines_.error(
        fmt::format("column {}: the quaternion has the norm {:.6g}, not 1", head_.labels[orientation.first], norm));
}

bool CsvReader::next_line(std::string_view& line) {
  while (lines_.next(line))
    if (head_.recording || !(line.starts_with('#') || line.starts_with('%'))) return true;
  return false;
}

bool CsvReader::next() {
  std::string_view line;
  while (next_line(line)) {
    if (trim(line).empty()) {
      blank_ = blank_ == 0 ? lines_.number() : blank_;
      continue;
    }
    if (blank_ != 0) throw lines_.error(fmt::format("line {} is blank, but rows follow it", blank_));
    if (parse_row(line)) return true;
  }
  if (rows_ == 0 && lost_ > 0) throw lines_.error("no row has a position");
  if (rows_ == 0 && !head_.recording) throw lines_.error("there is a header but no row");
  return false;
}

Path read_csv(const std::string& file, const CsvOptions& options) {
  CsvReader reader(file, {.columns = kPathColumns, .remedy = "", .csv = options});
  Path path;
  path.name = reader.lines().file();
  while (reader.next()) {
    const double* cell = reader.cells().data();
    path.time.push_back(cell[0]);
    path.position.emplace_back(cell[1], cell[2], cell[3]);
    if (reader.has(2)) path.velocity.emplace_back(cell[4], cell[5], cell[6]);
    if (reader.has(3)) path.force.emplace_back(cell[7], cell[8], cell[9]);
    if (reader.has(4)) path.orientation.emplace_back(cell[10], cell[11], cell[12], cell[13]);
  }
  path.notes = reader.notes();
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
