// The objects near the tool.
#pragma once

#include "control/path/path.h"

#include <cstdint>
#include <span>
#include <vector>

namespace haptrace {

/// Finds the boxes that a box meets. Few boxes are compared one by one. If there are many, a hash grid finds the small
/// ones (Teschner et al. 2003), so that the cost depends on how many are near, not on how many there are.
///
/// Real-time: near. Threads: one at a time.
class BroadPhase {
 public:
  BroadPhase() = default;
  /// Boxes may be infinite; their sides are ordered.
  explicit BroadPhase(std::vector<Box> boxes);

  /// Returns the indices of the boxes that meet `space`, and of those in `also`, in ascending order and each once.
  /// Valid until the next call.
  [[nodiscard]] std::span<const std::uint32_t> near(const Box& space, std::span<const std::uint32_t> also) noexcept;

 private:
  struct Cell {
    std::int64_t x = 0, y = 0, z = 0;
    std::uint32_t first = 0, count = 0;  ///< in members_; no member: a free slot
  };

  void build_grid();
  [[nodiscard]] const Cell* find(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept;
  void consider(std::uint32_t box, const Box& space) noexcept;
  void take(std::uint32_t box) noexcept;

  std::vector<Box> boxes_;
  std::vector<std::uint32_t> large_;  ///< boxes that are compared one by one
  std::vector<std::uint32_t> members_;
  std::vector<Cell> cells_;  ///< hash table with open addressing; its size is a power of two, or zero
  double side_ = 0;          ///< of a cell [m]
  std::vector<std::uint32_t> found_, stamp_;
  std::uint32_t query_ = 0;  ///< number of the query, in the stamps of the boxes that it took
  std::size_t count_ = 0;
};

}  // namespace haptrace
