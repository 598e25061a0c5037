// Thinning of curves for drawing. Private to report.
#pragma once

#include "base/types.h"
#include "report/session_report.h"

#include <span>
#include <vector>

namespace haptrace {

/// Returns the points of a curve that a picture needs. Omitted points are within 1/2000 of the curve's extent from the
/// lines between the remaining ones (Douglas and Peucker 1973). If more than `most` points would remain, the tolerance
/// doubles until there are not more. So peaks stay. Points that are not finite are left out.
std::vector<Vec3> thinned(std::span<const Vec3> points, std::size_t most);

/// Thins values along a path, each axis by its own extent.
ReportLine thinned(std::span<const double> arc, std::span<const double> value, std::size_t most);

}  // namespace haptrace
