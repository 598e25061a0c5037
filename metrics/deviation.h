// How far a movement was from what it should have been: at the same instant, from the curve, and in its forces.
#pragma once

#include "metrics/polyline.h"

#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Distances in m, or differences of forces in N.
struct Deviation {
  double rms = 0, peak = 0;
};

// Columns below have the length of `time` [s], which strictly increases and need not be even; Error(input) is thrown
// otherwise. A row counts for half of the time to its neighbours, so that figures do not depend on how a movement was
// sampled; rows that are not finite, and the time beside them, are left out. Undefined when no row is left.
//
// Threads: free functions without state. Real-time: no.

/// From the reference at the same instant: sqrt(integral of |x - r|^2 dt / integral of dt) and max |x - r|.
std::optional<Deviation> deviation(std::span<const double> time, std::span<const Vec3> position,
                                   std::span<const Vec3> reference);

/// From the curve (contour error): the same of the distance from the foot points, of which `arc` are the arc lengths
/// [m]; see foot_points(). Who is late on the path has none.
std::optional<Deviation> contour_deviation(std::span<const double> time, std::span<const Vec3> position,
                                           const Polyline& curve, std::span<const double> arc);

/// The share of time spent within a radius around the curve [m], which may vary with the arc length, from 0 to 1.
/// Between two rows, radius less distance is a straight line. The time of a row or radius that is not finite is left
/// out.
std::optional<double> share_in_tunnel(std::span<const double> time, std::span<const Vec3> position,
                                      const Polyline& curve, std::span<const double> arc,
                                      const std::function<double(double arc)>& radius);

/// Mean force in each of the cells of `spacing` [m] that a curve of `length` [m] is cut into, the last of which may be
/// shorter; NaN where none was. A step from one row to the next spreads its force, linear between the rows, over the
/// arc lengths that it passed: forwards, backwards and repeatedly, but standing still it has no weight. So neither
/// speed nor rate matters.
std::vector<Vec3> force_by_arc_length(std::span<const double> arc, std::span<const Vec3> force, double length,
                                      double spacing = 1e-3);

struct ForceDeviation {
  Deviation error;      ///< [N]
  double compared = 0;  ///< share of the cells that both have
};

/// The force of a trainee against that of an expert, cell by cell of force_by_arc_length() of the same curve.
/// Undefined when they have no cell in common. Throws Error(input) when they have different numbers of cells.
std::optional<ForceDeviation> force_deviation(std::span<const Vec3> trainee, std::span<const Vec3> expert);

}  // namespace haptrace
