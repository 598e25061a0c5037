// Meshes of fewer triangles.
#pragma once

#include "scene/shape/bvh.h"
#include "scene/shape/mesh_topology.h"

namespace haptrace {

/// Fewest triangles that a mesh is simplified to: those of a tetrahedron.
inline constexpr std::size_t kFewestTriangles = 4;

/// Returns a mesh of at most `most` triangles that stands for the same surface, over some of its vertices. Its
/// triangles are those with the least quadric error (Garland and Heckbert 1997, by meshoptimizer).
///
/// The result is as sound as the mesh: no edge opens, no fan of triangles meets another in a vertex that was not there,
/// no triangle loses its area, no edge becomes a knife, no part vanishes, and on a closed mesh every triangle keeps the
/// outside in front and the inside behind. Where fewer triangles would break that, the result has more than `most`.
///
/// The result depends on the mesh only, to the bit.
TriangleMesh simplified(const TriangleMesh& mesh, const TriangleTree& tree, const MeshTopology& topology,
                        std::size_t most);

/// Distance between two surfaces: from points of each to the closest point of the other.
struct SurfaceDistance {
  double rms = 0;      ///< [m]
  double largest = 0;  ///< of those found, at corners as well [m]
};
SurfaceDistance distance_between(const TriangleTree& one, const TriangleTree& other);

}  // namespace haptrace
