// What a user says about a CSV file whose header does not say it.
#pragma once

#include <map>
#include <string>
#include <string_view>

namespace haptrace {

/// How a CSV file that haptrace did not write is to be read, where its header leaves it open or is wrong. Readers of
/// other formats refuse options that are not empty.
struct CsvOptions {
  /// By haptrace's own name of a column (t, x, vx, fx, qw, ...; docs/file-format.md): the name that the file gives it.
  /// Of a Motive export, `x` may be the name of a rigid body or marker: its position and orientation are then read.
  std::map<std::string, std::string> columns;
  /// Units of the file, separated by commas, at most one of each quantity: "mm,ms". They win over those that the
  /// header names.
  std::string units;
  /// What messages call the file; empty: its own name.
  std::string name;

  [[nodiscard]] bool empty() const noexcept { return columns.empty() && units.empty(); }
};

/// Adds "t=time,x=x_mm" to `columns`. A part without "=" belongs to the name before it, as in "x=Position (x, mm)".
/// Throws Error(input) naming --columns: not COLUMN=NAME, a column that haptrace does not have, one that is given
/// twice.
void add_columns(std::map<std::string, std::string>& columns, std::string_view text);

/// Throws Error(input) naming --columns or --units when options cannot be: see add_columns; a unit that is not known,
/// two of one quantity.
void check(const CsvOptions& options);

}  // namespace haptrace
