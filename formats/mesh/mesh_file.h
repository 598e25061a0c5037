// Meshes in files: OBJ, STL, PLY, glTF and what else assimp reads.
#pragma once

#include "base/triangle_mesh.h"

#include <string>
#include <vector>

namespace haptrace {

inline constexpr std::size_t kMostMeshTriangles = 20'000'000;

/// The contents of a mesh's file.
struct MeshReport {
  std::size_t vertices_in_file = 0, triangles_in_file = 0;
  std::size_t flat = 0;          ///< triangles without an area, left out
  std::size_t repeated = 0;      ///< triangles that were there twice, left out
  std::size_t turned = 0;        ///< triangles turned over, so that neighbours agree on the outside
  std::size_t open_edges = 0;    ///< edges of one triangle
  std::size_t shared_edges = 0;  ///< edges of more than two triangles
  std::size_t parts = 0;         ///< that no edge joins
  std::size_t parts_turned = 0;  ///< closed parts that were inside out, and what lies inside them: turned over
  std::size_t inwards = 0;       ///< open parts, almost closed, whose faces look inwards: left as they are
  std::size_t inwards_at = 0;    ///< a triangle of the first of them, from 0
  bool inside_out = false;       ///< the whole mesh was turned over
  double volume = 0;             ///< of a closed mesh [m^3]
  Vec3 size = Vec3::Zero();      ///< of its box [m]
  Vec3 open_at = Vec3::Zero();   ///< middle of an open edge, if there is one [m]
};

struct MeshLoad {
  TriangleMesh mesh;  ///< welded, without triangles of no area, consistently wound, normals outwards where it is closed
  MeshReport report;
  std::vector<std::string> remarks;  ///< notes for the user: what was changed, and what may surprise
};

/// Reads a mesh whose lengths are in `unit` ("m", "mm", "cm", "um", "in"). Vertices at the same place become one.
///
/// Throws Error(input) naming the file and what is wrong in it: it is missing, too large (4 GiB, 20 million triangles),
/// of no known format, has no triangles or a number that is not finite, or is a surface with only one side.
MeshLoad load_mesh(const std::string& file, const std::string& unit);

/// Does the same for triangles from elsewhere. `name` stands for the file in errors.
MeshLoad clean_mesh(TriangleMesh mesh, const std::string& name);

}  // namespace haptrace
