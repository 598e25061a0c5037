// How the triangles of a mesh are joined.
#pragma once

#include "base/triangle_mesh.h"
#include "scene/shape/bvh.h"

#include <cstdint>
#include <vector>

namespace haptrace {

/// The vertices of a mesh, each with the triangles around it.
///
/// Where parts of a surface touch, each keeps an edge and a vertex of its own: at an edge of four or more triangles
/// those are joined that look at each other through the space outside, and a vertex at which fans of triangles meet
/// only in this point is one vertex for each fan. So every closed mesh is a surface without branches.
struct MeshTopology {
  MeshTopology() = default;
  /// Joins the faces of the tree: sets their vertices and neighbours. `mesh` must have consistent winding.
  MeshTopology(const TriangleMesh& mesh, TriangleTree& tree);

  std::vector<std::uint32_t> first_of;  ///< of a vertex's triangles in `around`; one more than there are vertices
  std::vector<std::uint32_t> around;
  std::vector<Vec3> vertex_normals;  ///< weighted with the angles of the triangles (Thuermer and Wuethrich 1998), unit
  std::size_t open_edges = 0;
};

}  // namespace haptrace
