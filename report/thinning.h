// Curves for drawing. Private to report.
#pragma once

#include "base/types.h"
#include "report/session_report.h"

#include <span>
#include <vector>

namespace haptrace {

/// The points of a curve that a picture needs: what is left out is within 1/2000 of the curve's extent of the lines
/// between those that stay (Douglas and Peucker 1973), or, where more than `most` points were left, within the least
/// power-of-two multiple of that for which there are not. So peaks stay. Points that are not finite are left out.
std::vector<Vec3> thinned(std::span<const Vec3> points, std::size_t most);

/// The same of values along a path, each axis by its own extent.
ReportLine thinned(std::span<const double> arc, std::span<const double> value, std::size_t most);

}  // namespace haptrace
