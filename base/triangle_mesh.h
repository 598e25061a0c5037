// A surface made of triangles.
#pragma once

#include "base/types.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace haptrace {

/// Triangles over shared vertices. Seen from outside, the corners of a triangle run anticlockwise.
struct TriangleMesh {
  std::vector<Vec3> vertices;                           ///< [m]
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices of vertices
};

/// Returns whether rounding decides on the normal of a triangle: two corners are the same, or it is 1e14 times longer
/// than wide.
inline bool is_flat(const TriangleMesh& mesh, const std::array<std::uint32_t, 3>& t) {
  constexpr double kFlat = 1e-14;
  if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return true;
  const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
  const double longest = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
  return !((b - a).cross(c - a).norm() > kFlat * longest);
}

}  // namespace haptrace
