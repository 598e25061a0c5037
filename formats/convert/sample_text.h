// Samples as rows of numbers in a text, shared by CSV and JSON lines. Private to formats.
//
// A row is flat: one cell per component of every column, in the order of text_columns().
#pragma once

#include "formats/recording/recording_layout.h"

#include <array>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

inline constexpr std::size_t kMostComponents = 6;  ///< of a column

/// A column of the layout as texts contain it.
struct TextColumn {
  const layout::Column* column = nullptr;
  std::array<std::string_view, kMostComponents> names;  ///< names of the components in a CSV header
  std::size_t first = 0;                                ///< cell of the first component

  [[nodiscard]] std::size_t width() const { return column->width; }
};

/// Returns the columns: time, position, velocity, force, orientation, then the others. Cells 0 to 13 are
/// t,x,y,z,vx,vy,vz,fx,fy,fz,qw,qx,qy,qz.
std::span<const TextColumn> text_columns();
/// Returns the index in text_columns() of a dataset of the layout.
std::size_t text_column(std::string_view name);
inline constexpr std::size_t kPathColumns = 5;

/// Returns the number of cells in a row.
std::size_t cell_count();

/// Returns a row of values that a file does not state: NaN for float64, otherwise zero.
std::vector<double> unknown_cells();

/// Prints samples into a text. Numbers have enough digits to be read back exactly; with `digits` > 0, float64 ones have
/// that many significant digits. Time is exact to the nanosecond.
class SamplePrinter {
 public:
  /// `none`: text for NaN.
  SamplePrinter(std::string_view none, int digits) : none_(none), digits_(digits) {}

  void take(std::span<const Sample> samples);
  void append(std::string& text, std::size_t row, const TextColumn& column, std::size_t component) const;
  [[nodiscard]] bool all_nan(std::size_t row, const TextColumn& column) const;

 private:
  std::string_view none_;
  int digits_;
  std::span<const Sample> samples_;
  std::vector<std::vector<std::byte>> packed_;  ///< by text column
};

/// Collects rows of cells and converts them to samples.
class SampleParser {
 public:
  /// Adds a row. If a value of an integer column is not an integer, calls `refuse(column, component, what)`, which
  /// throws.
  void add(std::span<const double> cells,
           const std::function<void(const TextColumn&, std::size_t, const std::string&)>& refuse);
  [[nodiscard]] std::size_t rows() const noexcept { return rows_; }
  /// Returns the samples of the rows since the last call.
  std::span<const Sample> take();

 private:
  std::vector<std::vector<std::byte>> packed_;  ///< by text column
  std::vector<Sample> samples_;
  std::size_t rows_ = 0;
};

/// Convert the header, columns, events and clock readings of a recording to JSON and back. Readers throw Error(input)
/// naming `where`. Absent keys keep their defaults, except those of a clock reading, which are required.
nlohmann::json json_of(const RecordingHeader& header);
nlohmann::json json_of(const RecordingColumns& columns);
nlohmann::json json_of(const StoredEvent& event);
nlohmann::json json_of(const ClockReading& reading);
RecordingHeader header_from_json(const nlohmann::json& json, const std::string& where);
StoredEvent event_from_json(const nlohmann::json& json, const std::string& where);
ClockReading clock_from_json(const nlohmann::json& json, const std::string& where);

/// Returns JSON on one line, with invalid UTF-8 in texts replaced.
std::string dump(const nlohmann::json& json);

}  // namespace haptrace
