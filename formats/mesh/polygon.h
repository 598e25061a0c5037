// Triangles of a polygon.
#pragma once

#include "base/types.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace haptrace {

/// Cuts a polygon into corners.size() - 2 triangles of indices into `corners`, which run the same way round. Every side
/// of the polygon belongs to one triangle and every cut to two, so that a closed mesh stays closed. A polygon that does
/// not cross itself is covered once, hollow or not, and no triangle is without an area unless all corners are on a
/// line. Fewer than three corners give none.
///
/// The time grows with the square of the number of corners, for unusual polygons with its third power.
std::vector<std::array<std::uint32_t, 3>> triangles_of(std::span<const Vec3> corners);

}  // namespace haptrace
