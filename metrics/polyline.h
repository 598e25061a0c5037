// A path as a curve: straight segments between points, by arc length and without time.
#pragma once

#include "base/types.h"

#include <span>
#include <vector>

namespace haptrace {

/// A curve of straight segments. Immutable. Points that are not finite, and points equal to the previous one, are left
/// out.
///
/// The noise of recorded positions makes a path longer: smooth it first (control/path/path_smoothing.h), or thin it.
///
/// Threads: const and safe to share.
class Polyline {
 public:
  /// Throws Error(input) when no point is finite. One point makes a curve of length 0.
  explicit Polyline(std::span<const Vec3> points);

  [[nodiscard]] double length() const noexcept { return arc_.back(); }  ///< [m]

  /// Returns the point at arc length s [m], clamped to the ends; NaN gives the start. O(log n).
  [[nodiscard]] Vec3 at(double s) const noexcept;

  /// Returns the arc length of the point nearest to `point` between the arc lengths `from` and `to` [m]; the first one
  /// if several are equally near. O(segments between) at worst; on a smooth curve most segments are skipped.
  [[nodiscard]] double nearest(const Vec3& point, double from, double to) const noexcept;

  /// Returns points about `spacing` apart, adjusted so that they are evenly spaced and include both ends. A curve of
  /// length 0 gives its start alone. Throws Error(input) when this would be more than 10^7 points.
  [[nodiscard]] std::vector<Vec3> resampled(double spacing) const;

  /// Returns a curve with fewer points, which keeps both ends. Every point left out is within `tolerance` [m] of the
  /// new segment. A recording at 1 kHz has a point every few micrometres; most say nothing about the shape. O(n).
  [[nodiscard]] Polyline simplified(double tolerance) const;

 private:
  [[nodiscard]] std::size_t segment_at(double s) const noexcept;

  std::vector<Vec3> points_;
  std::vector<double> arc_;  ///< arc lengths of the points, strictly increasing [m]
};

}  // namespace haptrace
