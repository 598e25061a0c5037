#include "formats/path/csv_header.h"

#include "base/error.h"
#include "base/printable.h"
#include "base/rfc3339.h"
#include "base/statistics.h"
#include "base/suggest.h"
#include "base/text_file.h"
#include "formats/path/csv_names.h"
#include "formats/path/csv_stamp.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
#include <map>

namespace haptrace {
namespace {

constexpr std::size_t kMostHeadLines = 100;  // to search for the header
constexpr std::size_t kMostHeadBytes = 1 << 20;
constexpr std::size_t kMostFields = 5000;  // of a header whose names are interpreted
constexpr std::size_t kMostSampled = 200;  // rows that are examined before they are read
constexpr std::size_t kMostListed = 12;    // names in a message

using Fields = std::vector<std::string>;

/// Replaces doubled quotes in a field by single ones.
std::string undoubled(std::string_view field) {
  std::string text;
  for (std::size_t i = 0; i < field.size(); ++i) {
    text += field[i];
    if (field[i] == '"' && i + 1 < field.size() && field[i + 1] == '"') ++i;
  }
  return text;
}

Fields fields_of(std::string_view line, char separator) {
  Fields fields;
  split_csv(line, separator, [&](std::size_t, std::string_view field, bool quoted) {
    fields.push_back(quoted ? undoubled(trim(field)) : std::string(field));
  });
  return fields;
}

/// Returns tab, semicolon or comma, the first of these that the line has outside quotes.
char separator_of(std::string_view line) {
  bool in_quotes = false, semicolon = false;
  for (const char c : line) {
    if (c == '"') in_quotes = !in_quotes;
    if (in_quotes) continue;
    if (c == '\t') return '\t';
    semicolon = semicolon || c == ';';
  }
  return semicolon ? ';' : ',';
}

std::string name_list(const Fields& names) {
  std::vector<std::string> parts;
  for (const std::string& name : names)
    if (!name.empty()) parts.push_back(shown(name));
  const std::size_t more = parts.size() > kMostListed ? parts.size() - kMostListed : 0;
  parts.resize(parts.size() - more);
  return fmt::format("{}{}", fmt::join(parts, ", "), more > 0 ? fmt::format(" and {} more", more) : "");
}

/// Lines of a Motive export above its header.
struct MotiveHead {
  Fields assets;       ///< by field: rigid body or marker
  Fields components;   ///< by field: Rotation, Position, ...
  std::string length;  ///< unit as the file writes it; empty: not stated
  std::string first_type;
};

/// Assignment of fields to cells.
struct Assignment {
  static constexpr std::size_t kNone = CsvHeader::kPassedOver;

  Fields names;                       ///< by field
  std::vector<CsvName> readings;      ///< by field
  std::vector<std::size_t> field_of;  ///< by cell
  std::optional<std::size_t> date_field;
  std::string twice;  ///< error: a duplicate name
  std::string lacks;  ///< error in --columns

  [[nodiscard]] bool has(std::size_t cell) const { return field_of[cell] != kNone; }
  [[nodiscard]] bool usable() const {
    for (std::size_t cell = 0; cell < kRequiredCells; ++cell)
      if (!has(cell)) return false;
    return lacks.empty();
  }
  [[nodiscard]] bool whole(const TextColumn& column) const {
    for (std::size_t i = 0; i < column.width(); ++i)
      if (!has(column.first + i)) return false;
    return true;
  }
  /// Returns true if every field of this vector has haptrace's own name.
  [[nodiscard]] bool plain(const TextColumn& column) const {
    for (std::size_t i = 0; i < column.width(); ++i)
      if (readings[field_of[column.first + i]].rank > 0 ||
          readings[field_of[column.first + i]].cell != column.first + i)
        return false;
    return true;
  }
};

/// Finds the columns by the names in a line.
class Assigner {
 public:
  Assigner(Fields names, const CsvOptions& options, bool own_only, const MotiveHead* motive = nullptr)
      : options_(options), motive_(motive) {
    result_.names = std::move(names);
    result_.field_of.assign(cell_count(), Assignment::kNone);
    const bool too_many = result_.names.size() > kMostFields;
    for (const std::string& name : result_.names)
      result_.readings.push_back(too_many ? CsvName{} : read_csv_name(name, own_only));
    taken_.assign(result_.names.size(), false);
    if (motive != nullptr) read_motive();
    take_mapped();
    for (std::size_t i = 0; i < text_columns().size(); ++i) {
      const TextColumn& column = text_columns()[i];
      if (i == 0)
        take_time();
      else
        take_vector(column);
    }
    if (!result_.twice.empty()) return;
    for (std::size_t i = 0; i < taken_.size() && !own_only; ++i)
      if (result_.readings[i].date && result_.readings[i].cell == 0 && !taken_[i] && !result_.date_field)
        result_.date_field = i;
  }

  [[nodiscard]] Assignment take() { return std::move(result_); }

 private:
  /// Joins the names of a Motive export, which stand above each other.
  void read_motive() {
    std::string asset;
    if (const auto asked = options_.columns.find("x"); asked != options_.columns.end())
      if (std::find(motive_->assets.begin(), motive_->assets.end(), asked->second) != motive_->assets.end())
        asset = asked->second;
    by_asset_ = !asset.empty();
    for (std::size_t i = 0; i < result_.names.size(); ++i) {
      CsvName& reading = result_.readings[i];
      reading = {};
      if (i == 1) reading.cell = 0;
      if (i < 2 || i >= motive_->assets.size() || i >= motive_->components.size() || motive_->assets[i].empty())
        continue;
      const std::string component = lower_case(motive_->components[i]);
      const std::string axis = result_.names[i];
      result_.names[i] = fmt::format("{}.{}.{}", motive_->assets[i], motive_->components[i], axis);
      if (!asset.empty() && asset != motive_->assets[i]) continue;
      if (component != "position" && component != "rotation") continue;
      reading = read_csv_name(fmt::format("{}.{}", component, axis), false);
      if (reading.cell == CsvName::kUnknown) continue;
      reading.rank = 1;
      reading.group += motive_->assets[i];
    }
  }

  std::optional<std::size_t> field_called(std::string_view name) const {
    const auto& names = result_.names;
    for (const bool any_case : {false, true})
      for (std::size_t i = 0; i < names.size(); ++i)
        if (any_case ? lower_case(names[i]) == lower_case(name) : names[i] == name) return i;
    return std::nullopt;
  }

  void take_mapped() {
    for (const auto& [column, name] : options_.columns) {
      if (column == "x" && by_asset_) continue;
      const auto field = field_called(trim(name));
      const auto& known = cell_names();
      const auto cell = static_cast<std::size_t>(std::find(known.begin(), known.end(), column) - known.begin());
      if (cell >= known.size()) continue;  // check() reports it
      if (!field) {
        if (result_.lacks.empty())
          result_.lacks = fmt::format("--columns {}={}: the file has no column '{}'; it has {}", column, shown(name),
                                      shown(name), name_list(result_.names));
      } else if (taken_[*field]) {
        if (result_.lacks.empty())
          result_.lacks =
              fmt::format("--columns {}={}: another column uses the same column of the file", column, shown(name));
      } else {
        result_.field_of[cell] = *field;
        taken_[*field] = true;
      }
    }
  }

  void say_twice(std::size_t cell, std::size_t first, std::size_t second) {
    if (!result_.twice.empty()) return;
    const std::string_view name = cell_names()[cell];
    if (result_.readings[first].rank == 0)
      result_.twice = fmt::format("the header names the column {} twice", name);
    else
      result_.twice =
          fmt::format("the header names the column {} twice, as '{}' and '{}'; choose one with --columns {}=NAME", name,
                      shown(result_.names[first]), shown(result_.names[second]), name);
  }

  void take_time() {
    if (result_.has(0)) return;
    std::size_t best = Assignment::kNone;
    for (std::size_t i = 0; i < taken_.size(); ++i) {
      const CsvName& reading = result_.readings[i];
      if (reading.cell != 0 || taken_[i]) continue;
      if (best == Assignment::kNone || reading.rank < result_.readings[best].rank)
        best = i;
      else if (reading.rank == 0)
        say_twice(0, best, i);
    }
    if (best == Assignment::kNone) return;
    result_.field_of[0] = best;
    taken_[best] = true;
  }

  /// Takes the first complete group of names, of the most certain rank.
  void take_vector(const TextColumn& column) {
    struct Group {
      Group() { fields.fill(Assignment::kNone); }
      std::size_t first = 0;
      std::array<std::size_t, kMostComponents> fields{};
      std::optional<std::array<std::size_t, 3>> twice = std::nullopt;  // cell, fields
    };
    for (std::size_t i = 0; i < column.width(); ++i)
      if (result_.has(column.first + i)) return fill(column);
    constexpr int kLastRank = 3;
    for (int rank = 0; rank <= kLastRank; ++rank) {
      std::map<std::string_view, Group> groups;
      for (std::size_t i = 0; i < taken_.size(); ++i) {
        const CsvName& reading = result_.readings[i];
        if (taken_[i] || reading.rank > rank || !belongs(reading, column)) continue;
        Group& group = groups.try_emplace(reading.group).first->second;
        if (group.fields == Group{}.fields) group.first = i;
        std::size_t& at = group.fields.at(reading.cell - column.first);
        if (at == Assignment::kNone)
          at = i;
        else if (!group.twice)
          group.twice = {reading.cell, at, i};
      }
      const Group* best = nullptr;
      for (const auto& [name, group] : groups) {
        const auto end = group.fields.begin() + static_cast<std::ptrdiff_t>(column.width());
        if (std::find(group.fields.begin(), end, Assignment::kNone) == end &&
            (best == nullptr || group.first < best->first))
          best = &group;
      }
      if (best == nullptr) continue;
      if (best->twice) say_twice((*best->twice)[0], (*best->twice)[1], (*best->twice)[2]);
      for (std::size_t i = 0; i < column.width(); ++i) {
        result_.field_of[column.first + i] = best->fields.at(i);
        taken_[best->fields.at(i)] = true;
      }
      return;
    }
    // Take part of a vector with plain names, for messages.
    for (std::size_t i = 0; i < taken_.size(); ++i)
      if (belongs(result_.readings[i], column) && result_.readings[i].rank <= 1) {
        std::size_t& field = result_.field_of[result_.readings[i].cell];
        if (field == Assignment::kNone)
          field = i;
        else if (result_.readings[i].rank == 0)
          say_twice(result_.readings[i].cell, field, i);
      }
  }

  /// Takes the components that --columns does not name.
  void fill(const TextColumn& column) {
    for (std::size_t i = 0; i < taken_.size(); ++i)
      if (const CsvName& reading = result_.readings[i];
          !taken_[i] && belongs(reading, column) && reading.rank <= 1 && !result_.has(reading.cell)) {
        result_.field_of[reading.cell] = i;
        taken_[i] = true;
      }
  }

  static bool belongs(const CsvName& reading, const TextColumn& column) {
    return reading.cell >= column.first && reading.cell < column.first + column.width();
  }

  const CsvOptions& options_;
  const MotiveHead* motive_;
  bool by_asset_ = false;
  Assignment result_;
  std::vector<bool> taken_;
};

bool all_numbers(const Fields& fields) {
  double number = 0;
  return std::all_of(fields.begin(), fields.end(),
                     [&](const std::string& field) {
                       return field.empty() || parse_csv_number(field, true, number) != NumberForm::none;
                     }) &&
         std::any_of(fields.begin(), fields.end(), [](const std::string& field) { return !field.empty(); });
}

/// Returns the word for a unit in a sentence.
std::string_view spoken(std::string_view si) {
  return si == "m" ? "metres" : si == "s" ? "seconds" : si;
}

class HeadReader {
 public:
  HeadReader(const std::string& file, std::size_t columns, const CsvOptions& options)
      : options_(options), columns_(columns), lines_(file, "CSV", options.name) {}

  CsvHeader read() {
    check(options_);
    find_header();
    settle_columns();
    if (!header_.recording) {
      sample_rows();
      settle_units();
      settle_time();
      tell_columns();
    }
    return std::move(header_);
  }

 private:
  struct Candidate {
    std::string text;
    std::size_t line = 0;
    char separator = ',';
  };

  [[nodiscard]] Error error_at(std::size_t line, const std::string& what) const {
    return input_error(fmt::format("{}:{}: {}", lines_.file(), line, what));
  }

  static bool is_comment(std::string_view line) { return line.starts_with('#') || line.starts_with('%'); }

  /// Reads the next line that is neither blank nor a comment. Returns false at the end.
  bool next_line(std::string_view& line) {
    while (lines_.next(line))
      if (!trim(line).empty() && !is_comment(line)) return true;
    return false;
  }

  void find_header() {
    std::optional<Candidate> first, commented;
    std::string_view line;
    std::size_t seen = 0, bytes = 0;
    while (seen < kMostHeadLines && bytes < kMostHeadBytes && lines_.next(line)) {
      if (!header_.recording) bytes += line.size();
      if (lines_.number() == 1 && (line.starts_with("\xFF\xFE") || line.starts_with("\xFE\xFF")))
        throw lines_.error("the text is UTF-16; save it as UTF-8 or ASCII");
      if (trim(line).empty()) continue;
      if (line.starts_with('#') || (line.starts_with('%') && !header_.recording)) {
        for (const std::string_view kind : {"# haptrace {", "# event {", "# clock {"})
          if (line.starts_with(kind)) header_.comments.emplace_back(line.substr(2));
        header_.recording = header_.recording || line.starts_with("# haptrace {");
        if (header_.recording) continue;
        const std::size_t begin = line.find_first_not_of("#% \t");
        if (begin == std::string_view::npos) continue;
        Candidate candidate{std::string(line.substr(begin)), lines_.number(), separator_of(line.substr(begin))};
        if (assign(candidate).usable()) commented = std::move(candidate);
        continue;
      }
      if (forced_separator_ == '\0' && line.size() == 5 && line.starts_with("sep=")) {  // written by Excel
        forced_separator_ = line[4];
        continue;
      }
      ++seen;
      Candidate candidate{std::string(line), lines_.number(), separator_of(line)};
      if (forced_separator_ != '\0') candidate.separator = forced_separator_;
      if (!first) first = candidate;
      if (header_.recording) break;
      if (seen == 1 && unquoted(line.substr(0, line.find_first_of(",;"))) == "Format Version") return read_motive(line);
      const Fields fields = fields_of(line, candidate.separator);
      if (assign(candidate).usable()) {
        if (candidate.line != first->line)
          header_.notes.push_back(
              fmt::format("the header is line {}; the lines before it were ignored", candidate.line));
        return choose(candidate);
      }
      if (commented && is_row_of(*commented, line)) {
        header_.notes.push_back(fmt::format("the comment in line {} is read as the header", commented->line));
        rows_begin_ = lines_.number();
        held_ = std::string(line);
        return choose(*commented);
      }
      if (all_numbers(fields)) break;
    }
    if (!first) throw input_error(lines_.file() + ": is empty; a path has a header t,x,y,z and a row for every sample");
    choose(*first);
  }

  [[nodiscard]] Assignment assign(const Candidate& candidate) const {
    return Assigner(fields_of(candidate.text, candidate.separator), options_, header_.recording).take();
  }

  /// Returns true if the line has numbers in the header's columns of the position.
  [[nodiscard]] bool is_row_of(const Candidate& header, std::string_view line) const {
    const Assignment columns = assign(header);
    const Fields fields = fields_of(line, header.separator);
    double number = 0;
    for (std::size_t cell = 1; cell < kRequiredCells; ++cell)
      if (columns.field_of[cell] >= fields.size() ||
          parse_csv_number(fields[columns.field_of[cell]], true, number) == NumberForm::none)
        return false;
    return fields.size() >= columns.names.size();
  }

  void choose(const Candidate& candidate) {
    header_.separator = candidate.separator;
    header_line_ = candidate.line;
    header_text_ = candidate.text;
    header_.last_line = rows_begin_ > 0 ? rows_begin_ - 1 : candidate.line;
    assignment_ = assign(candidate);
  }

  /// Reads "Format Version,1.23,Take Name,..." and the rows of names above the header "Frame,Time (Seconds),X,Y,Z,...".
  void read_motive(std::string_view first) {
    constexpr std::size_t kMostRows = 20;
    header_.separator = separator_of(first);
    const Fields facts = fields_of(first, header_.separator);
    MotiveHead motive;
    for (std::size_t i = 0; i + 1 < facts.size(); i += 2)
      if (facts[i] == "Length Units") motive.length = facts[i + 1];
    std::vector<Fields> rows;
    std::string_view line;
    bool found = false;
    while (!found && rows.size() < kMostRows && next_line(line)) {
      rows.push_back(fields_of(line, header_.separator));
      found = rows.back().size() > 1 && lower_case(rows.back()[0]) == "frame" &&
              lower_case(rows.back()[1]).starts_with("time");
    }
    if (!found)
      throw lines_.error("a Motive export has a row Frame,Time (Seconds),X,Y,Z, but none follows its first line");
    const Fields names = rows.back();
    rows.pop_back();
    std::size_t of_names = 1;
    for (std::size_t i = 0; i < rows.size(); ++i)
      for (std::size_t field = 0; field < std::min<std::size_t>(2, rows[i].size()); ++field)
        if (lower_case(rows[i][field]) == "name") of_names = i;
    if (rows.size() < 3)
      throw lines_.error("a Motive export has rows of types, names and Rotation or Position above this one");
    motive.assets = rows[of_names];
    motive.components = rows.back();
    if (of_names > 0) {
      const Fields& types = rows[of_names - 1];
      for (std::size_t i = 2; i < types.size() && motive.first_type.empty(); ++i) motive.first_type = types[i];
    }
    header_line_ = header_.last_line = lines_.number();
    header_text_ = std::string(line);
    header_.drops_lost_rows = true;
    assignment_ = Assigner(names, options_, false, &motive).take();
    motive_ = std::move(motive);
  }

  void settle_columns() {
    const Assignment& found = assignment_;
    const auto& names = cell_names();
    if (!found.twice.empty()) throw error_at(header_line_, found.twice);
    if (!found.lacks.empty()) throw error_at(header_line_, found.lacks);
    if (!motive_ && all_numbers(found.names))
      throw error_at(header_line_, fmt::format("there is no header; the first line must name the columns, as in "
                                               "t,x,y,z; found '{}'",
                                               shown(header_text_)));
    std::vector<std::string_view> missing;
    for (std::size_t cell = 0; cell < kRequiredCells; ++cell)
      if (!found.has(cell)) missing.push_back(names[cell]);
    if (!missing.empty()) {
      std::vector<std::string> example;
      for (const std::string_view name : missing) example.push_back(fmt::format("{}=NAME", name));
      throw error_at(
          header_line_,
          motive_
              ? fmt::format("no rigid body or marker has a position X, Y, Z; there are {}", name_list(motive_->assets))
              : fmt::format("the header lacks {}; it must name t,x,y,z, separated by comma, semicolon or tab; "
                            "found '{}'; name the columns with --columns {}",
                            fmt::join(missing, ", "), shown(header_text_), fmt::join(example, ",")));
    }

    // A vector needs all its components. Known columns that are not wanted are skipped without a note.
    header_.fields.assign(found.names.size(), {});
    header_.present.assign(text_columns().size(), false);
    header_.labels.resize(cell_count());
    std::vector<bool> quiet(found.names.size(), false);
    for (std::size_t i = 0; i < text_columns().size(); ++i) {
      const TextColumn& column = text_columns()[i];
      const bool whole = found.whole(column);
      header_.present[i] = whole && i < columns_;
      for (std::size_t cell = column.first; whole && cell < column.first + column.width(); ++cell) {
        const std::size_t field = found.field_of[cell];
        quiet[field] = true;
        if (header_.present[i]) header_.fields[field].cell = cell;
      }
    }
    for (std::size_t cell = 0; cell < cell_count(); ++cell) {
      header_.labels[cell] = names[cell];
      if (const std::size_t field = found.field_of[cell];
          field != Assignment::kNone && lower_case(found.names[field]) != names[cell])
        header_.labels[cell] += fmt::format(" ('{}')", shown(found.names[field]));
    }
    Fields left;
    for (std::size_t i = 0; i < found.names.size(); ++i)
      if (!quiet[i] && !(found.date_field == i) && !(motive_ && i < 2)) left.push_back(found.names[i]);
    if (!motive_) header_.ignored = name_list(left);
  }

  /// Reads the row of units, if there is one, and the first rows.
  void sample_rows() {
    std::string_view line;
    const auto next = [&] {
      if (!held_.empty()) {
        line = held_;
        return true;
      }
      return next_line(line);
    };
    bool is_first = true;
    while (samples_.size() < kMostSampled && next()) {
      Fields fields;
      const std::size_t count = split_csv(line, header_.separator, [&](std::size_t, std::string_view field, bool) {
        fields.emplace_back(trim(field));
      });
      held_.clear();
      if (count == kOpenQuote) return;
      fields.resize(assignment_.names.size());
      if (is_first && read_units_row(fields)) {
        header_.last_line = lines_.number();
        is_first = false;
        continue;
      }
      is_first = false;
      samples_.push_back(std::move(fields));
    }
  }

  [[nodiscard]] bool wanted(std::size_t field) const { return header_.fields[field].cell != CsvHeader::kPassedOver; }

  bool read_units_row(const Fields& fields) {
    bool any = false;
    double number = 0;
    for (std::size_t i = 0; i < fields.size(); ++i) {
      if (!wanted(i) || fields[i].empty()) continue;
      const std::string_view si = si_of_cell(header_.fields[i].cell);
      if (si == "1") continue;
      if (parse_csv_number(fields[i], true, number) != NumberForm::none) return false;
      any = any || find_unit(fields[i], si) != nullptr;
    }
    if (!any) return false;
    units_row_.assign(fields.size(), nullptr);
    for (std::size_t i = 0; i < fields.size(); ++i) {
      if (!wanted(i) || fields[i].empty()) continue;
      const std::string_view si = si_of_cell(header_.fields[i].cell);
      units_row_[i] = find_unit(fields[i], si);
      if (units_row_[i] == nullptr && si != "1") unknown_unit(i, fields[i]);
    }
    return true;
  }

  /// Throws if a column has an unknown unit, unless --units states one.
  void unknown_unit(std::size_t field, const std::string& unit) const {
    const std::string_view si = si_of_cell(header_.fields[field].cell);
    if (asked_units(options_).contains(si)) return;
    std::vector<std::string> known;
    for (const Unit& each : units())
      if (each.si == si && each.name.size() < 5) known.emplace_back(each.name);
    throw input_error(
        fmt::format("{}: column '{}' is in '{}', which is none of {}; convert it, or state its unit "
                    "with --units",
                    lines_.file(), shown(assignment_.names[field]), shown(unit), fmt::join(known, ", ")));
  }

  /// Returns the unit that the file states for a field, or null.
  [[nodiscard]] const Unit* stated(std::size_t field) const {
    if (!units_row_.empty() && units_row_[field] != nullptr) return units_row_[field];
    return assignment_.readings[field].unit;
  }

  void settle_units() {
    const auto asked = asked_units(options_);
    const Unit* length = nullptr;
    for (std::size_t i = 0; i < text_columns().size(); ++i) {
      const TextColumn& column = text_columns()[i];
      const std::string_view si = column.column->units;
      if (!header_.present[i] || si.empty() || si == "1") continue;
      const bool position = column.column->name == std::string_view("position");
      const Unit* of_vector = nullptr;
      const Unit* of_other = nullptr;  // unit of a component that --units overrides
      for (std::size_t c = 0; c < column.width(); ++c) {
        const std::size_t field = assignment_.field_of[column.first + c];
        if (!assignment_.readings[field].unknown_unit.empty() && (units_row_.empty() || units_row_[field] == nullptr))
          unknown_unit(field, assignment_.readings[field].unknown_unit);
        if (of_vector == nullptr) of_vector = stated(field);
      }
      std::string_view why = units_row_.empty() ? "the header says so" : "the row of units says so";
      if (motive_ && position && of_vector == nullptr && !motive_->length.empty()) {
        of_vector = find_unit(motive_->length, si);
        why = "its Length Units say so";
        if (of_vector == nullptr && !asked.contains(si))
          throw error_at(1, fmt::format("Length Units are '{}', which is not a known unit; state it with --units",
                                        shown(motive_->length)));
      }
      if (motive_ && i == 0) of_vector = find_unit("s", "s");
      if (const auto found = asked.find(si); found != asked.end()) {
        if (of_vector != nullptr && of_vector->per_si != found->second->per_si) of_other = of_vector;
        of_vector = found->second;
        why = "--units says so";
      } else if (of_vector == nullptr && si == "m/s" && length != nullptr && length->per_si != 1) {
        of_vector = find_unit(fmt::format("{}/s", length->name), si);
        if (of_vector != nullptr) why = "the positions are in that unit";
      }
      if (position) {
        length = of_vector;
        header_.position_unit_known = of_vector != nullptr;
      }
      for (std::size_t c = 0; c < column.width(); ++c) {
        const std::size_t field = assignment_.field_of[column.first + c];
        const Unit* unit = asked.contains(si) || stated(field) == nullptr ? of_vector : stated(field);
        header_.fields[field].per_si = unit == nullptr ? 1 : unit->per_si;
      }
      if (i == 0) {
        time_unit_ = of_vector;
        time_why_ = why;
      } else {
        tell_vector(column, of_vector, of_vector == nullptr ? "no unit is stated" : why);
      }
      if (of_other != nullptr)
        header_.notes.push_back(fmt::format("--units states {} in {}, but the file states {}; --units takes precedence",
                                            column.column->name, of_vector->name, of_other->name));
    }
  }

  [[nodiscard]] Fields names_of(const TextColumn& column) const {
    Fields names;
    for (std::size_t c = 0; c < column.width(); ++c)
      names.push_back(fmt::format("'{}'", shown(assignment_.names[assignment_.field_of[column.first + c]])));
    return names;
  }

  void tell_vector(const TextColumn& column, const Unit* unit, std::string_view why) {
    const bool si = unit == nullptr || unit->per_si == 1;
    if (assignment_.plain(column) && si) return;
    header_.notes.push_back(fmt::format("{} is read from {} in {}: {}", column.column->name,
                                        fmt::join(names_of(column), ", "),
                                        unit == nullptr ? spoken(column.column->units) : unit->name, why));
  }

  [[nodiscard]] std::string_view time_text(const Fields& row) const { return row[assignment_.field_of[0]]; }

  [[nodiscard]] std::string_view date_text(const Fields& row) const {
    return assignment_.date_field ? std::string_view(row[*assignment_.date_field]) : std::string_view();
  }

  void settle_time() {
    constexpr double kSince1970 = 1e8;  // [s], three years: a larger stamp counts from an epoch
    if (samples_.empty()) return;
    const Fields& row = samples_.front();
    const std::string_view text = time_text(row);
    std::string source = fmt::format("'{}'", shown(assignment_.names[assignment_.field_of[0]]));
    double number = 0;
    const bool plain = assignment_.plain(text_columns()[0]);
    if (parse_csv_number(text, true, number) == NumberForm::none) {
      const bool date = parse_date_stamp(text).has_value();
      if (!date && !parse_clock_stamp(text)) return;  // reading the row reports the error
      header_.stamps = date ? StampForm::date : StampForm::time_of_day;
      if (date)
        assignment_.date_field.reset();
      else
        header_.date_field = assignment_.date_field;
      if (header_.date_field) source += fmt::format(" and '{}'", shown(assignment_.names[*header_.date_field]));
      const auto stamp = parse_stamp(header_, text, date_text(row), true);
      if (!stamp) return;
      header_.start_ns = *stamp;
      if (date || header_.date_field)
        header_.notes.push_back(
            fmt::format("time is read from {} as dates and times; time 0 is {}", source, rfc3339_nanoseconds(*stamp)));
      else
        header_.notes.push_back(fmt::format("time is read from {} as times of day; time 0 is {}", source, shown(text)));
      return;
    }

    const auto magnitude = std::abs(number);
    std::string_view why = time_why_;
    if (time_unit_ == nullptr)  // in seconds since 1970 these would be beyond the year 5000
      for (const auto& [least, name] : {std::pair(1e17, "ns"), std::pair(1e14, "us"), std::pair(1e11, "ms")})
        if (magnitude >= least) {
          time_unit_ = find_unit(name, "s");
          why = "its stamps are too large for seconds";
          break;
        }
    const double per_second = time_unit_ == nullptr ? 1 : time_unit_->per_si;
    header_.stamps_per_second = per_second;
    header_.fields[assignment_.field_of[0]].per_si = per_second;
    if (per_second != 1)
      header_.notes.push_back(fmt::format("time is read from {} in {}: {}", source, time_unit_->name, why));
    else if (!plain)
      header_.notes.push_back(fmt::format("time is read from {} in seconds: {}", source,
                                          time_unit_ == nullptr ? "no unit is stated" : why));
    if (magnitude / per_second >= kSince1970) {
      header_.stamps = StampForm::exact;
      if (const auto stamp = parse_stamp(header_, text, "", true)) {
        header_.start_ns = *stamp;
        header_.notes.push_back(fmt::format("time 0 is the first stamp, {}", shown(text)));
      } else {
        header_.stamps = StampForm::number;
      }
    }
    if (time_unit_ == nullptr) ask_about_slow_time();
  }

  /// Throws if time is read as seconds but its steps do not fit a movement.
  void ask_about_slow_time() const {
    constexpr double kNoMovement = 10;                              // [s]: no hand movement is sampled so slowly
    constexpr double kSlow = 0.5, kCreeping = 2e-3, kMoved = 5e-3;  // [s], [m/s], [m]
    constexpr std::size_t kEnough = 20;                             // steps
    std::vector<double> steps, speeds;
    std::optional<std::array<double, 4>> before;
    std::array<double, 4> least{}, most{};
    for (const Fields& row : samples_) {
      std::array<double, 4> cells{};
      for (std::size_t cell = 0; cell < kRequiredCells; ++cell) {
        const std::size_t field = assignment_.field_of[cell];
        if (parse_csv_number(row[field], true, cells.at(cell)) == NumberForm::none) return;
        cells.at(cell) /= header_.fields[field].per_si;
      }
      if (!before) least = most = cells;
      if (before && cells[0] > (*before)[0]) {
        steps.push_back(cells[0] - (*before)[0]);
        speeds.push_back(std::hypot(cells[1] - (*before)[1], cells[2] - (*before)[2], cells[3] - (*before)[3]) /
                         steps.back());
      }
      for (std::size_t i = 0; i < cells.size(); ++i) {
        least.at(i) = std::min(least.at(i), cells.at(i));
        most.at(i) = std::max(most.at(i), cells.at(i));
      }
      before = cells;
    }
    if (steps.size() < kEnough) return;
    const double step = median(steps), speed = median(speeds);
    const double moved = std::max({most[1] - least[1], most[2] - least[2], most[3] - least[3]});
    if (!(step >= kNoMovement) && !(step >= kSlow && speed < kCreeping && moved > kMoved)) return;
    throw input_error(fmt::format(
        "{}: in seconds, two rows would be {:.4g} s apart. Are these {}? Use --units {}, or --units s if they are "
        "seconds",
        lines_.file(), step,
        step < 1e3   ? "milliseconds"
        : step < 1e6 ? "microseconds"
                     : "nanoseconds",
        step < 1e3   ? "ms"
        : step < 1e6 ? "us"
                     : "ns"));
  }

  void tell_columns() {
    if (!motive_) return;
    const std::size_t chosen = assignment_.field_of[1];
    const std::string& asset = motive_->assets[chosen];
    Fields others;
    for (const std::string& name : motive_->assets)
      if (name != asset && !name.empty() && lower_case(name) != "name" &&
          std::find(others.begin(), others.end(), name) == others.end())
        others.push_back(name);
    if (!header_.present[text_column("orientation")])
      for (std::size_t i = 2; i < std::min(motive_->assets.size(), motive_->components.size()); ++i)
        if (motive_->assets[i] == asset && lower_case(motive_->components[i]) == "rotation") {
          header_.notes.emplace_back("its rotation is in angles and is not read; export it as a quaternion");
          break;
        }
    header_.notes.insert(
        header_.notes.begin(),
        fmt::format(
            "a Motive export: the path is that of '{}'{}", shown(asset),
            others.empty() ? "" : fmt::format("; choose another with --columns x=NAME: {}", name_list(others))));
  }

  const CsvOptions& options_;
  std::size_t columns_;
  LineReader lines_;
  CsvHeader header_;
  char forced_separator_ = '\0';
  std::size_t header_line_ = 0, rows_begin_ = 0;
  std::string header_text_, held_;
  Assignment assignment_;
  std::optional<MotiveHead> motive_;
  std::vector<Fields> samples_;
  std::vector<const Unit*> units_row_;
  const Unit* time_unit_ = nullptr;
  std::string_view time_why_;
};

}  // namespace

std::string_view unquoted(std::string_view text) {
  text = trim(text);
  if (text.size() >= 2 && text.front() == text.back() && (text.front() == '"' || text.front() == '\''))
    text = trim(text.substr(1, text.size() - 2));
  return text;
}

NumberForm parse_csv_number(std::string_view field, bool comma, double& value) {
  if (parse_number(field, value))
    return field.find('.') == std::string_view::npos ? NumberForm::whole : NumberForm::point;
  const std::size_t at = field.find(',');
  if (!comma || at == std::string_view::npos) return NumberForm::none;
  std::string with_point(field);
  with_point[at] = '.';
  return parse_number(with_point, value) && std::isfinite(value) ? NumberForm::comma : NumberForm::none;
}

std::optional<std::int64_t> parse_stamp(const CsvHeader& header, std::string_view text, std::string_view date,
                                        bool comma) {
  if (header.stamps == StampForm::date) return parse_date_stamp(text);
  if (header.stamps == StampForm::time_of_day) {
    if (!header.date_field) return parse_clock_stamp(text);
    std::string both(date);
    return parse_date_stamp(both.append(" ").append(text));
  }
  double value = 0;
  if (const auto exact = parse_decimal_stamp(text, header.stamps_per_second)) return exact;
  std::string with_point(text);
  if (comma) std::replace(with_point.begin(), with_point.end(), ',', '.');
  if (const auto exact = parse_decimal_stamp(with_point, header.stamps_per_second)) return exact;
  constexpr double kLongest = 9.2e9;  // [s]
  if (!parse_number(with_point, value) || !(std::abs(value / header.stamps_per_second) < kLongest)) return std::nullopt;
  return std::llround(value / header.stamps_per_second * 1e9);
}

std::map<std::string_view, const Unit*> asked_units(const CsvOptions& options) {
  std::map<std::string_view, const Unit*> asked;
  for (std::string_view rest = options.units; !rest.empty();) {
    const std::size_t comma = rest.find(',');
    const std::string_view name = trim(rest.substr(0, comma));
    const Unit* unit = find_unit(name, "");
    if (unit == nullptr && (name == "Nm" || name == "N m")) unit = find_unit(name, "N m");
    if (unit == nullptr) {
      std::vector<std::string> known;
      for (const Unit& each : units())
        if (each.name.size() < 5) known.emplace_back(each.name == "nm" ? "Nm" : each.name);
      throw input_error(fmt::format("--units {}: '{}' is not a known unit; known: {}", options.units, shown(name),
                                    fmt::join(known, ", ")));
    }
    if (!asked.emplace(unit->si, unit).second)
      throw input_error(
          fmt::format("--units {}: gives two units of one quantity; write one of them, as in mm,ms", options.units));
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
  }
  return asked;
}

CsvHeader read_csv_header(const std::string& file, std::size_t columns, const CsvOptions& options) {
  return HeadReader(file, columns, options).read();
}

}  // namespace haptrace
