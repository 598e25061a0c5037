// Rows of a session and their minima and maxima at every width, within a bound of memory. Private to view.
#pragma once

#include "view/pyramid_block.h"

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <vector>

namespace haptrace {

/// Rows as a page gets them: their times, and one plane of values for each column.
struct ViewRows {
  std::vector<std::int64_t> time_ns;
  std::vector<std::vector<float>> planes;

  ViewRows() = default;
  explicit ViewRows(std::size_t channels) : planes(channels) {}
  [[nodiscard]] std::size_t size() const noexcept { return time_ns.size(); }
  void add(std::int64_t time, std::span<const float> values);
  void add(const ViewRows& from, std::size_t first, std::size_t count);
  void clear() noexcept;
};

/// Bins of some columns. Bin k covers [first + k width, first + (k + 1) width).
struct ViewBins {
  std::int64_t first_ns = 0, width_ns = 1;
  std::size_t count = 0;
  std::vector<std::vector<PyramidBin>> channels;  ///< in the order asked
};

/// Keeps the rows of a session in blocks of PyramidBlock::kRows row periods. Each block has a pyramid. The rows
/// themselves are kept for the most recently used blocks. If the pyramids exceed their bound, the blocks that were not
/// used for longest lose their narrowest cells.
///
/// Threads: one.
class History {
 public:
  struct Bounds {
    std::size_t rows = std::size_t{64} << 20U;    ///< memory for rows [bytes]
    std::size_t cells = std::size_t{256} << 20U;  ///< memory for pyramids [bytes]
  };

  /// `period_ns`: row period, at least 1.
  History(std::size_t channels, std::int64_t period_ns, const Bounds& bounds);
  History(std::size_t channels, std::int64_t period_ns) : History(channels, period_ns, Bounds()) {}

  /// Appends a row. Ignores it unless its time is larger than that of the last row.
  void append(std::int64_t time_ns, std::span<const float> values);

  /// Stores all rows of a block, for readers of files. Their times increase.
  void put(std::int64_t block, ViewRows rows);

  /// Returns true if the cells of a block are known for bins of `width` row periods, or its rows.
  [[nodiscard]] bool has_cells(std::int64_t block, std::int64_t width) const;
  [[nodiscard]] bool has_rows(std::int64_t block) const;

  [[nodiscard]] std::int64_t block_of(std::int64_t time_ns) const noexcept;
  [[nodiscard]] std::int64_t block_begin(std::int64_t block) const noexcept { return block * block_ns_; }
  [[nodiscard]] std::int64_t period() const noexcept { return period_ns_; }
  [[nodiscard]] std::int64_t last_time() const noexcept { return last_ns_; }  ///< of the last appended row; -1: none

  /// Returns the width of the bins for a stretch [row periods]: the smallest power of two with at most `pixels` bins.
  [[nodiscard]] std::int64_t bin_width(std::int64_t from_ns, std::int64_t to_ns, std::size_t pixels) const noexcept;

  /// Computes bins that cover [from, to] for the columns `channels`. Bins narrower than a base cell come from the rows
  /// where these are kept, otherwise from the cells.
  [[nodiscard]] ViewBins bins(std::int64_t from_ns, std::int64_t to_ns, std::int64_t width,
                              std::span<const std::size_t> channels);

  /// Returns the kept rows in [from, to], at most `most`. `cut`: there are more, or some are no longer kept.
  [[nodiscard]] ViewRows rows(std::int64_t from_ns, std::int64_t to_ns, std::size_t most, bool& cut) const;

  [[nodiscard]] std::size_t row_memory() const noexcept { return row_bytes_; }
  [[nodiscard]] std::size_t cell_memory() const noexcept { return cell_bytes_; }

 private:
  struct Block {
    explicit Block(std::size_t channels) : pyramid(channels), rows(channels) {}
    PyramidBlock pyramid;
    ViewRows rows;
    bool kept = true;  ///< the rows are here
    bool thin = false;
    mutable std::uint64_t used = 0;
  };

  Block& block_at(std::int64_t index);
  void forget_rows(std::int64_t spare);
  void thin_cells(std::int64_t spare);
  [[nodiscard]] std::size_t bytes_per_row() const noexcept { return sizeof(std::int64_t) + sizeof(float) * channels_; }
  void add_rows(const Block& block, std::int64_t first_ns, std::int64_t width_ns, std::span<const std::size_t> channels,
                ViewBins& bins) const;
  [[nodiscard]] PyramidBin cell(std::int64_t from, std::int64_t width, std::size_t channel) const;

  std::size_t channels_;
  std::int64_t period_ns_, block_ns_;
  Bounds bounds_;
  std::map<std::int64_t, Block> blocks_;
  std::int64_t last_ns_ = -1;
  std::size_t row_bytes_ = 0, cell_bytes_ = 0;
  mutable std::uint64_t uses_ = 0;
};

}  // namespace haptrace
