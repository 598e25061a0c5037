// Reading and writing of comma-separated values. Private to formats: use load_path, save_path, open_source and
// create_sink.
#pragma once

#include "base/text_file.h"
#include "control/path/path.h"
#include "formats/path/csv_header.h"

#include <optional>
#include <string>

namespace haptrace {

/// Reads CSV row by row. Memory does not grow with the length of the file.
///
/// A file of haptrace's own, which begins with "# haptrace {...}", has haptrace's names and units. In other files, the
/// reader recognises columns, units, time stamps and decimal signs (csv_header.h), unless the options name them;
/// notes() lists the assumptions. It skips unknown columns, and vectors with a missing component. In other files,
/// comment lines (#, %) may stand before the header and between the rows, and blank lines at the end.
///
/// Every member throws Error(input) as "file:line: ..." if the header or a required column is missing, a row has too
/// few or too many columns, a field is not a number, t,x,y,z are not finite, positions without a unit are beyond the
/// reach of a hand device, or there are no rows.
class CsvReader {
 public:
  struct Options {
    std::size_t columns = kPathColumns;  ///< number of text_columns() to read; the others are skipped
    bool ordered = true;                 ///< time must increase from row to row
    std::string remedy;                  ///< remedy for time that does not increase, for the error
    CsvOptions csv;
  };

  CsvReader(const std::string& file, Options options);

  [[nodiscard]] bool has(std::size_t column) const { return head_.present[column]; }

  /// Reads the next row into cells(). Returns false at the end.
  bool next();

  /// Returns the present row in SI units. An optional field that is empty or "nan", and an absent column, are as in
  /// unknown_cells().
  [[nodiscard]] std::span<const double> cells() const noexcept { return cells_; }

  /// Returns true if haptrace wrote the file.
  [[nodiscard]] bool recording() const noexcept { return head_.recording; }
  /// Returns haptrace's comments before the header: "haptrace {...}", "event {...}" and "clock {...}".
  [[nodiscard]] const std::vector<std::string>& comments() const noexcept { return head_.comments; }
  /// Returns what was recognised, assumed and left out, for the user. Complete at the end of the file.
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
  std::string date_;  ///< date of the row, for times of day that have one
  std::size_t rows_ = 0, line_before_ = 0, blank_ = 0;
  std::uint64_t lost_ = 0;                             ///< rows without a position that were left out
  std::size_t line_of_point_ = 0, line_of_comma_ = 0;  ///< line in which a decimal sign was first seen; 0: none
  double time_before_ = 0;
};

/// Reads a path. Keeps velocity, force and orientation if all rows have them; otherwise drops them, with a note if some
/// rows have them. Throws like CsvReader.
Path read_csv(const std::string& file, const CsvOptions& options = {});

/// Writes a path with enough digits to read every number back exactly. Throws Error(input) like OutputFile, and if a
/// write to the disk fails.
void write_csv(const Path& path, const std::string& file, bool overwrite);

}  // namespace haptrace
