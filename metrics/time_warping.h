// Dynamic time warping: how alike two paths are as shapes, whoever was faster where.
#pragma once

#include "metrics/polyline.h"

#include <optional>

namespace haptrace {

struct WarpingOptions {
  double spacing = 1e-3;  ///< of the points that are compared [m]
  double band = 20e-3;    ///< how far the two may be apart in arc length: the Sakoe-Chiba band [m]
};

/// The mean distance of two paths along their best alignment [m].
///
/// Both are cut evenly by arc length, into I and J points. An alignment goes from (1, 1) to (I, J) in steps (1, 0),
/// (0, 1) and (1, 1) of weights 1, 1 and 2, and stays within |i - j| <= band / spacing; the figure is the least sum of
/// weighted distances, divided by I + J: by the length of both paths (symmetric form without slope constraint of Sakoe
/// and Chiba 1978, Dynamic programming algorithm optimization for spoken word recognition). 0 for equal shapes. It does
/// not depend on speed, and is the same both ways. Where the paths differ in length their points do not meet: that
/// alone leaves up to a quarter of the spacing.
///
/// Undefined when a path has no length. Throws Error(input) when the band cannot join the ends: when the paths differ
/// in length by more than it; and when spacing or band mean nothing.
///
/// O(I band / spacing) time and O(I + J + band / spacing) memory. Threads: free function without state.
std::optional<double> warping_distance(const Polyline& a, const Polyline& b, const WarpingOptions& options = {});

}  // namespace haptrace
