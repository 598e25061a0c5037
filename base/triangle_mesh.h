// A surface made of triangles.
#pragma once

#include "base/types.h"

#include <array>
#include <cstdint>
#include <vector>

namespace haptrace {

/// Triangles over shared vertices. Seen from outside, the corners of a triangle run anticlockwise.
struct TriangleMesh {
  std::vector<Vec3> vertices;                           ///< [m]
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices of vertices
};

}  // namespace haptrace
