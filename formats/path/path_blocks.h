// Statistics of a path in blocks, computed row by row.
#pragma once

#include "formats/path/path_source.h"

#include <algorithm>

namespace haptrace {

/// Computes the blocks of a path. It needs every row in order.
class PathBlocks {
 public:
  static constexpr std::uint64_t kRows = 8192;  ///< per block
  static constexpr double kSpeedWindow = 0.01;  ///< [s]

  void add(double time, const Vec3& position) {
    if (rows_ > 0) {
      PathBlock& before = blocks_.back();
      before.longest_interval = std::max(before.longest_interval, time - time_);
    }
    if (rows_ % kRows == 0) blocks_.push_back({.first = rows_});
    PathBlock& block = blocks_.back();
    block.bounds.include(position);
    ++block.rows;
    // Speeds are over a window, which may be a millionth shorter, since stamps are rounded.
    if (rows_++ == 0) {
      begin_window(time, position);
    } else if (const double elapsed = time - window_time_; elapsed >= (1 - 1e-6) * kSpeedWindow) {
      block.peak_speed = std::max(block.peak_speed, (position - window_position_).norm() / elapsed);
      begin_window(time, position);
    }
    time_ = time;
  }

  [[nodiscard]] const std::vector<PathBlock>& blocks() const noexcept { return blocks_; }

 private:
  void begin_window(double time, const Vec3& position) {
    window_time_ = time;
    window_position_ = position;
  }

  std::vector<PathBlock> blocks_;
  std::uint64_t rows_ = 0;
  double time_ = 0, window_time_ = 0;
  Vec3 window_position_ = Vec3::Zero();
};

/// Adds a block to the facts of the whole path: all but names, stamps and columns.
inline void join_block(PathFacts& facts, const PathBlock& block) {
  facts.rows += block.rows;
  facts.bounds.include(block.bounds.min);
  facts.bounds.include(block.bounds.max);
  facts.peak_speed = std::max(facts.peak_speed, block.peak_speed);
  facts.longest_interval = std::max(facts.longest_interval, block.longest_interval);
}

}  // namespace haptrace
