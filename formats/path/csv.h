// Comma-separated values. Private to formats: load_path, save_path, open_source and create_sink are the ways in.
#pragma once

#include "base/text_file.h"
#include "control/path/path.h"
#include "formats/path/csv_header.h"

#include <optional>
#include <string>

namespace haptrace {

/// Reads CSV row by row; memory is flat in the length of the file.
///
/// Files of haptrace's own, which begin with "# haptrace {...}", have its names and units. Of others, the columns,
/// units, time stamps and decimal signs are recognised (csv_header.h), or are those that the options name; notes() say
/// what was assumed. A vector of which a component is missing is passed over, and so are columns that nobody knows.
/// Comment lines
/// (#, %) may stand before the header and between the rows of others, blank lines at the end.
///
/// Every member throws Error(input) as "file:line: ...": no header or one that lacks a column, a row with too few or
/// too many columns, a field that is not a number, t,x,y,z that are not finite, positions that are farther than a hand
/// device reaches and have no unit, no rows.
class CsvReader {
 public:
  struct Options {
    std::size_t columns = kPathColumns;  ///< of text_columns(), those that are read; the others are passed over
    bool ordered = true;                 ///< time must increase from row to row
    std::string remedy;                  ///< what to do about time that does not, for the error
    CsvOptions csv;
  };

  CsvReader(const std::string& file, Options options);

  [[nodiscard]] bool has(std::size_t column) const { return head_.present[column]; }

  /// Reads the next row into cells(); false at the end.
  bool next();

  /// The present row in SI. A field that is empty or "nan" and may be so, and a column that is absent: see
  /// unknown_cells().
  [[nodiscard]] std::span<const double> cells() const noexcept { return cells_; }

  /// haptrace wrote the file.
  [[nodiscard]] bool recording() const noexcept { return head_.recording; }
  /// The comments before the header that are ours: "haptrace {...}" and "event {...}".
  [[nodiscard]] const std::vector<std::string>& comments() const noexcept { return head_.comments; }
  /// What was recognised, assumed and left out, for people. Complete at the end of the file.
  [[nodiscard]] std::vector<std::string> notes() const;
  [[nodiscard]] const LineReader& lines() const noexcept { return lines_; }

 private:
  bool next_line(std::string_view& line);
  bool parse_row(std::string_view line);
  void check_row() const;
  void check_time(double t) const;
  [[nodiscard]] double parse_field(std::size_t cell, std::string_view text, bool quoted);
  [[nodiscard]] double parse_time(std::string_view text, bool quoted);

  CsvHeader head_;
  LineReader lines_;
  Options options_;
  std::vector<double> cells_;
  std::string date_;  ///< of the row, where times of day have one
  std::size_t rows_ = 0, line_before_ = 0, blank_ = 0;
  std::uint64_t lost_ = 0;                             ///< rows without a position that were left out
  std::size_t line_of_point_ = 0, line_of_comma_ = 0;  ///< where a decimal sign was first seen; 0: not yet
  double time_before_ = 0;
};

/// Reads a path. Velocity and force stay when every row has them, else they go with a note. Throws like CsvReader.
Path read_csv(const std::string& file, const CsvOptions& options = {});

/// Writes a path with as many digits as bring every number back exactly. Throws Error(input) like OutputFile, and when
/// the disk refuses.
void write_csv(const Path& path, const std::string& file, bool overwrite);

}  // namespace haptrace
