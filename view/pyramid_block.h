// Minima and maxima of a stretch of rows at several widths. Private to view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace haptrace {

/// Values of one column in the rows of a cell. NaN: no row of the cell has a value.
struct PyramidCell {
  float first, min, max, last;
};

/// A cell with the order of its extremes.
struct PyramidBin {
  PyramidCell cell;
  bool min_first = true;  ///< the minimum comes before the maximum

  PyramidBin() noexcept;
  void add(float value) noexcept;
  void add(const PyramidBin& later) noexcept;  ///< adds values that follow these; adding more of the same is allowed
};

/// The cells of one block of kRows row periods: 256 cells of 256 row periods, and cells of 4, 16, 64 and 256 of these.
/// Cells are anchored in time, not in rows: a stretch without rows has empty cells.
class PyramidBlock {
 public:
  static constexpr std::int64_t kBase = 256, kFanOut = 4, kRows = 65536;  ///< [row periods]
  static constexpr int kLevels = 5;

  explicit PyramidBlock(std::size_t channels);

  /// Adds rows in the order of time. `slot`: row period within the block.
  void add(std::int64_t slot, std::span<const float> values);

  /// Makes the wider cells complete up to the last row. Call it before bin().
  void settle();

  /// Returns the width of the cells of a level [row periods].
  [[nodiscard]] static constexpr std::int64_t width(int level) noexcept { return kBase << (2 * level); }

  [[nodiscard]] PyramidBin bin(int level, std::int64_t index, std::size_t channel) const noexcept;

  /// Removes the levels below `level`, which is most of the memory. bin() then returns the wider cell.
  void thin(int level);

  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  [[nodiscard]] std::size_t at(int level, std::int64_t index, std::size_t channel) const noexcept;
  void store(std::size_t place, const PyramidBin& bin) noexcept;
  [[nodiscard]] PyramidBin load(std::size_t place) const noexcept { return stored(cells_[place], min_first_[place]); }
  static PyramidBin stored(const PyramidCell& cell, bool min_first) noexcept;

  std::size_t channels_;
  int floor_ = 0;                   ///< lowest level that is stored
  std::vector<PyramidCell> cells_;  ///< empty until there is a row
  std::vector<bool> min_first_;
  std::int64_t open_ = -1;  ///< base cell of the last row, which the wider cells may lack
};

}  // namespace haptrace
