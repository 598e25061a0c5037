// Triangles over the zeros of a field.
#pragma once

#include "base/triangle_mesh.h"
#include "control/path/path.h"

#include <array>
#include <functional>

namespace haptrace {

/// Returns the surface between f < 0, which is inside, and the rest of a box, by marching tetrahedra on a grid of
/// `cells`. The mesh is closed where f >= 0 at the sides of the box, and has no triangles without an area. NaN is
/// outside.
TriangleMesh level_set(const std::function<double(const Vec3&)>& f, const Box& box, const std::array<int, 3>& cells);

}  // namespace haptrace
