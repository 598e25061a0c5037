// Comma-separated values. Private to formats: load_path, save_path, open_source and create_sink are the ways in.
#pragma once

#include "control/path.h"
#include "formats/sample_text.h"
#include "formats/text_file.h"

#include <optional>
#include <string>

namespace haptrace {

/// Reads CSV row by row; memory is flat in the length of the file.
///
/// The header names t,x,y,z (s, m) and optionally the other columns of text_columns(), in any order and case, separated
/// by comma, semicolon or tab, whichever it has. A vector of which a component is missing is passed over, and so are
/// columns that nobody knows. Comment lines (#) may stand before the header and blank lines at the end.
///
/// Every member throws Error(input) as "file:line: ...": no header or one that lacks a column, a row with too few or
/// too many columns, a field that is not a number, t,x,y,z that are not finite, no rows.
class CsvReader {
 public:
  struct Options {
    std::size_t columns = kPathColumns;  ///< of text_columns(), those that are read; the others are passed over
    bool ordered = true;                 ///< time must increase from row to row
    std::string remedy;                  ///< what to do about time that does not, for the error
  };

  CsvReader(const std::string& file, Options options);

  [[nodiscard]] bool has(std::size_t column) const { return present_[column]; }

  /// Reads the next row into cells(); false at the end.
  bool next();

  /// The present row. A field that is empty or "nan" and may be so, and a column that is absent: see unknown_cells().
  [[nodiscard]] std::span<const double> cells() const noexcept { return cells_; }

  /// The comments before the header that are ours: "haptrace {...}" and "event {...}".
  [[nodiscard]] const std::vector<std::string>& comments() const noexcept { return comments_; }
  /// Names of columns that nobody knows and of those of incomplete vectors.
  [[nodiscard]] const std::string& ignored() const noexcept { return ignored_; }
  [[nodiscard]] const LineReader& lines() const noexcept { return lines_; }

 private:
  static constexpr std::size_t kPassedOver = static_cast<std::size_t>(-1);

  void parse_header(std::string_view line);
  void parse_row(std::string_view line);
  void check_time(double t) const;
  [[nodiscard]] double parse_field(std::size_t cell, std::string_view text) const;

  LineReader lines_;
  Options options_;
  std::vector<std::string> comments_;
  char separator_ = ',';
  std::vector<std::size_t> cell_of_field_;  ///< by field of a row: its cell or kPassedOver
  std::vector<bool> present_;               ///< by text column
  std::string ignored_;
  bool recording_ = false;  ///< written by us: any value may be missing but the time
  std::vector<double> cells_;
  std::size_t rows_ = 0, line_before_ = 0, blank_ = 0;
  double time_before_ = 0;
};

/// Reads a path. Velocity and force stay when every row has them, else they go with a note. Throws like CsvReader.
Path read_csv(const std::string& file);

/// Writes a path with as many digits as bring every number back exactly. Throws Error(input) like OutputFile, and when
/// the disk refuses.
void write_csv(const Path& path, const std::string& file, bool overwrite);

}  // namespace haptrace
