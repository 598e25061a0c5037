// Meaning of the names of CSV columns. Private to formats.
#pragma once

#include "base/units.h"

#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A column of a CSV file as its name describes it.
struct CsvName {
  static constexpr std::size_t kUnknown = std::numeric_limits<std::size_t>::max();

  std::size_t cell = kUnknown;  ///< cell of a row; see sample_text.h
  /// Certainty: 0, haptrace's own name; 1, a quantity and an axis; 2, the same with other words; 3, a guess.
  int rank = 0;
  std::string group;           ///< the same for all columns of a vector
  const Unit* unit = nullptr;  ///< unit that the name states
  std::string unknown_unit;    ///< text in square brackets that is not a unit of this quantity
  bool date = false;           ///< a date, perhaps with the time
};

/// Reads names such as "time", "Time [ms]", "x_mm", "Pos X (mm)", "field.pose.position.x", "Force_Z", "quat.w".
/// `own_only`: accepts only haptrace's own names.
CsvName read_csv_name(std::string_view name, bool own_only);

/// Returns the SI unit of a cell: "m", "s", ...
std::string_view si_of_cell(std::size_t cell);

/// Returns haptrace's names of all cells.
const std::vector<std::string_view>& cell_names();

}  // namespace haptrace
