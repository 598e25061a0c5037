// Dynamic time warping: similarity of two paths as shapes, whatever their speeds.
#pragma once

#include "metrics/polyline.h"

#include <optional>

namespace haptrace {

struct WarpingOptions {
  double spacing = 1e-3;  ///< spacing of the compared points [m]
  double band = 20e-3;    ///< Sakoe-Chiba band: largest difference in arc length between matched points [m]
};

/// Computes the mean distance of two paths along their best alignment [m].
///
/// Both are divided evenly by arc length, into I and J points. An alignment goes from (1, 1) to (I, J) in steps (1, 0),
/// (0, 1) and (1, 1) of weights 1, 1 and 2, and stays within |i - j| <= band / spacing. The metric is the smallest sum
/// of weighted distances, divided by I + J, the length of both paths (symmetric form without slope constraint of Sakoe
/// and Chiba 1978, Dynamic programming algorithm optimization for spoken word recognition). It is 0 for equal shapes,
/// does not depend on speed, and is symmetric. The points of paths of different lengths do not coincide; that alone
/// adds up to a quarter of the spacing.
///
/// Returns nothing when a path has no length. Throws Error(input) when the paths differ in length by more than the
/// band, and when spacing or band is invalid.
///
/// O(I band / spacing) time and O(I + J + band / spacing) memory. Threads: free function without state.
std::optional<double> warping_distance(const Polyline& a, const Polyline& b, const WarpingOptions& options = {});

}  // namespace haptrace
