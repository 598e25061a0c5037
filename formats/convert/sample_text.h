// Samples as rows of numbers in a text: what CSV and JSON lines share. Private to formats.
//
// A row is flat: a cell for every component of every column, in the order of text_columns().
#pragma once

#include "formats/recording/recording_layout.h"

#include <array>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A column of the layout in texts.
struct TextColumn {
  const layout::Column* column = nullptr;
  std::array<std::string_view, 4> names;  ///< of its components in a CSV header
  std::size_t first = 0;                  ///< cell of its first component

  [[nodiscard]] std::size_t width() const { return column->width; }
};

/// time, position, velocity, force, orientation, then the others. Cells 0 to 13 are
/// t,x,y,z,vx,vy,vz,fx,fy,fz,qw,qx,qy,qz.
std::span<const TextColumn> text_columns();
/// Which of them is that of a dataset of the layout.
std::size_t text_column(std::string_view name);
inline constexpr std::size_t kPathColumns = 5;

/// Cells of a row.
std::size_t cell_count();

/// What a cell holds when a file does not say: NaN for a float, zero for a whole number.
std::vector<double> unknown_cells();

/// Samples on their way into a text. Numbers have as many digits as bring them back, or `digits` significant ones where
/// they are float64; time is exact to the nanosecond.
class SamplePrinter {
 public:
  /// `none`: what stands for NaN.
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

/// Rows of cells on their way to samples.
class SampleParser {
 public:
  /// Adds a row. Calls `refuse(column, component, what)`, which throws, when a whole number is none.
  void add(std::span<const double> cells,
           const std::function<void(const TextColumn&, std::size_t, const std::string&)>& refuse);
  [[nodiscard]] std::size_t rows() const noexcept { return rows_; }
  /// The samples of the rows since the last call.
  std::span<const Sample> take();

 private:
  std::vector<std::vector<std::byte>> packed_;  ///< by text column
  std::vector<Sample> samples_;
  std::size_t rows_ = 0;
};

/// The header of a recording, its columns, its events and its readings of clocks as JSON, and back. The latter throw
/// Error(input) naming `where`; what is absent keeps its default.
nlohmann::json json_of(const RecordingHeader& header);
nlohmann::json json_of(const RecordingColumns& columns);
nlohmann::json json_of(const StoredEvent& event);
nlohmann::json json_of(const ClockReading& reading);
RecordingHeader header_from_json(const nlohmann::json& json, const std::string& where);
StoredEvent event_from_json(const nlohmann::json& json, const std::string& where);
ClockReading clock_from_json(const nlohmann::json& json, const std::string& where);

/// One line of JSON, whatever the texts in it.
std::string dump(const nlohmann::json& json);

}  // namespace haptrace
