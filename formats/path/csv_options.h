// User options for CSV files whose header is incomplete.
#pragma once

#include <map>
#include <string>
#include <string_view>

namespace haptrace {

/// Options for a CSV file that haptrace did not write, where its header is incomplete or wrong. Readers of other
/// formats reject options that are not empty.
struct CsvOptions {
  /// Name of a column in the file, by haptrace's own name (t, x, vx, fx, qw, ...; docs/file-format.md). For a Motive
  /// export, `x` may be the name of a rigid body or marker, whose position and orientation are then read.
  std::map<std::string, std::string> columns;
  /// Units of the file, separated by commas, at most one per quantity: "mm,ms". They override the header's units.
  std::string units;
  /// Name of the file in messages; empty: its own name.
  std::string name;

  [[nodiscard]] bool empty() const noexcept { return columns.empty() && units.empty(); }
};

/// Adds "t=time,x=x_mm" to `columns`. A part without "=" belongs to the name before it, as in "x=Position (x, mm)".
/// Throws Error(input) naming --columns if the text is not COLUMN=NAME, haptrace does not have the column, or a column
/// is given twice.
void add_columns(std::map<std::string, std::string>& columns, std::string_view text);

/// Throws Error(input) naming --columns or --units if the options are invalid: see add_columns(); a unit is unknown, or
/// there are two of one quantity.
void check(const CsvOptions& options);

}  // namespace haptrace
