// The parts of a path that were walked.
#pragma once

#include <array>
#include <cstddef>

namespace haptrace {

/// A set of intervals of arc length [m]. It grows by the movement of a place, which leaves out what it jumps over.
///
/// It holds 32 separate intervals. A further one joins the two that are closest to each other: the gap between them
/// counts as walked. Real-time: all.
class WalkedSet {
 public:
  void clear() noexcept { count_ = 0; }
  /// Adds all between `a` and `b`, in either order. Returns the length of the part that was new [m].
  double add(double a, double b) noexcept;
  /// Returns the number of separate intervals.
  [[nodiscard]] std::size_t intervals() const noexcept { return count_; }

 private:
  struct Interval {
    double from = 0, to = 0;
  };
  static constexpr std::size_t kMost = 32;
  void join_closest() noexcept;

  std::array<Interval, kMost + 1> intervals_{};  ///< in order, apart from each other
  std::size_t count_ = 0;
};

}  // namespace haptrace
