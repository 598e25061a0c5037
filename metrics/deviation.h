// Deviation of a movement from its reference at the same instant, from a curve, and in its forces.
#pragma once

#include "metrics/polyline.h"

#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Distances in m, or force differences in N.
struct Deviation {
  double rms = 0, peak = 0;
};

// Columns below have the length of `time` [s], which strictly increases; the steps may vary. The functions throw
// Error(input) otherwise. A row is weighted by half of the time to its neighbours, so that metrics do not depend on the
// sampling of a movement. Rows that are not finite, and the time beside them, are left out. The functions return
// nothing when no row is left.
//
// Threads: free functions without state. Real-time: no.

/// Computes the deviation from the reference at the same instant: sqrt(integral of |x - r|^2 dt / integral of dt) and
/// max |x - r|.
std::optional<Deviation> deviation(std::span<const double> time, std::span<const Vec3> position,
                                   std::span<const Vec3> reference);

/// Computes the deviation from the curve (contour error), with the distances from the foot points. `arc` holds the arc
/// lengths of these [m]; see align_with_path(). Being late on the path does not count.
std::optional<Deviation> contour_deviation(std::span<const double> time, std::span<const Vec3> position,
                                           const Polyline& curve, std::span<const double> arc);

/// Divides a curve of `length` [m] into cells of `spacing` [m] and returns the mean force in each; the last cell may be
/// shorter. Cells without force are NaN. A step from one row to the next spreads its force, linear between the rows,
/// over the arc lengths it passes, forwards, backwards or repeatedly. Standing still has no weight. So neither speed
/// nor rate matters. A step to a row in `jumps` (in order, see PathAlignment) passes nothing.
std::vector<Vec3> force_by_arc_length(std::span<const double> arc, std::span<const Vec3> force, double length,
                                      double spacing = 1e-3, std::span<const std::size_t> jumps = {});

struct ForceDeviation {
  Deviation error;      ///< [N]
  double compared = 0;  ///< fraction of the cells in which both have a force
};

/// Compares the force of a trainee with that of an expert, cell by cell of force_by_arc_length() on the same curve.
/// Returns nothing when they have no cell in common. Throws Error(input) when they have different numbers of cells.
std::optional<ForceDeviation> force_deviation(std::span<const Vec3> trainee, std::span<const Vec3> expert);

}  // namespace haptrace
