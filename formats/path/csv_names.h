// What the name of a column says. Private to formats.
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

  std::size_t cell = kUnknown;  ///< of a row; see sample_text.h
  /// How sure that is: 0, haptrace's own name; 1, a quantity and an axis; 2, with other words; 3, a guess.
  int rank = 0;
  std::string group;           ///< columns of one vector have the same
  const Unit* unit = nullptr;  ///< that the name states
  std::string unknown_unit;    ///< in square brackets, and no unit of this quantity
  bool date = false;           ///< of a day, perhaps with the time
};

/// Reads names such as "time", "Time [ms]", "x_mm", "Pos X (mm)", "field.pose.position.x", "Force_Z", "quat.w".
/// `own_only`: haptrace's own names alone.
CsvName read_csv_name(std::string_view name, bool own_only);

/// The SI unit of a cell: "m", "s", ...
std::string_view si_of_cell(std::size_t cell);

/// haptrace's names of all cells.
const std::vector<std::string_view>& cell_names();

}  // namespace haptrace
