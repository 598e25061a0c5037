// A path as a curve: straight lines between points, by their arc length. When it was where does not matter.
#pragma once

#include "base/types.h"

#include <span>
#include <vector>

namespace haptrace {

/// Immutable. Points that are not finite are left out, and so are those that repeat the one before.
///
/// The noise of recorded positions makes a path longer: smooth it first (control/path/path_smoothing.h), or thin it.
///
/// Threads: const and safe to share.
class Polyline {
 public:
  /// Throws Error(input) when no point is finite. One point makes a curve of length 0.
  explicit Polyline(std::span<const Vec3> points);

  [[nodiscard]] double length() const noexcept { return arc_.back(); }  ///< [m]

  /// The point at arc length s [m], an end beyond the ends; the start for NaN. O(log n).
  [[nodiscard]] Vec3 at(double s) const noexcept;

  /// The arc length of the point nearest to `point` among those from arc length `from` to `to` [m]; of equally near
  /// ones the first. O(segments between) at worst; of a smooth curve, most segments are passed over.
  [[nodiscard]] double nearest(const Vec3& point, double from, double to) const noexcept;

  /// Points `spacing` apart, or a little nearer or farther so that they are evenly apart and both ends are among them;
  /// the start alone for a curve of length 0. Throws Error(input) when that were more than 10^7 points.
  [[nodiscard]] std::vector<Vec3> resampled(double spacing) const;

 private:
  [[nodiscard]] std::size_t segment_at(double s) const noexcept;

  std::vector<Vec3> points_;
  std::vector<double> arc_;  ///< of the points, strictly increasing [m]
};

/// Where along the curve a hand is looked for, as arc length.
struct FootSearch {
  double start = 0;      ///< where first [m]
  double back = 5e-3;    ///< behind the farthest that it was found [m]
  double ahead = 10e-3;  ///< of where it was last, beside twice what it moved since [m]
};

/// Arc lengths of the foot points of a hand: for each of its positions the nearest point of the curve, looked for only
/// around the one before. So it stays on its branch where the curve crosses or retraces itself; the nearest point of
/// the whole curve jumps there. A hand that goes back by more than `back`, or leaves out more of the curve than
/// `ahead`, is waited for.
/// NaN where the position is not finite. Throws Error(input) when the search leads nowhere (`ahead` not positive,
/// `back` negative). O(positions * segments within the search).
std::vector<double> foot_points(const Polyline& curve, std::span<const Vec3> position, const FootSearch& search = {});

}  // namespace haptrace
