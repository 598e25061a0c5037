// Triangles over a surface with two parameters.
#pragma once

#include "base/triangle_mesh.h"

#include <functional>

namespace haptrace {

/// How the edges of a parameter square meet.
struct GridEnds {
  bool wraps_u = false;  ///< u = 1 is u = 0
  bool wraps_v = false;  ///< v = 1 is v = 0
};

/// Returns the triangles of nu x nv cells over the points place(u, v), u and v from 0 to 1. The outward normal is
/// d place / du x d place / dv. Points that coincide, as at a pole, become one vertex, and triangles without an area
/// are left out, so that a closed surface gives a closed mesh.
TriangleMesh grid_mesh(int nu, int nv, const GridEnds& ends, const std::function<Vec3(double u, double v)>& place);

}  // namespace haptrace
