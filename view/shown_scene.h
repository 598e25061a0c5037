// The virtual scene of a session, as pages draw it.
#pragma once

#include "base/triangle_mesh.h"

#include <string>
#include <vector>

namespace haptrace {

class Scene;

/// One object of a scene for pages. Its mesh is in W.
struct ShownObject {
  std::string name, kind;
  TriangleMesh mesh;  ///< no triangles: the object is not drawn
};

/// Returns the objects of a scene with meshes that are fine enough for a picture and within the limits of the protocol.
/// Infinite objects are cut off around the others.
std::vector<ShownObject> shown_objects(const Scene& scene);

/// Returns a mesh of at most this many vertices and triangles: vertices of the same cell of a grid become one, in the
/// finest grid that suffices.
TriangleMesh thinned(const TriangleMesh& mesh, std::size_t vertices, std::size_t triangles);

}  // namespace haptrace
