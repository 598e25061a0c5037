#include "view/shown_scene.h"

#include "scene/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace haptrace {
namespace {

// Limits of the protocol.
constexpr std::size_t kMostVertices = 65'536, kMostTriangles = 131'072, kMostObjects = 256;
constexpr double kTolerance = 1e-3;  // of a picture, as a share of the scene's size
constexpr double kAlone = 0.2;  // size of the part of an infinite object that is drawn if nothing else is there [m]

Box space_around(const Scene& scene) {
  Box space;
  for (std::size_t i = 0; i < scene.size(); ++i)
    if (const Box box = scene.object(i).bounds(); is_finite(box.min) && is_finite(box.max)) {
      space.include(box.min);
      space.include(box.max);
    }
  if (!(space.min.x() <= space.max.x())) return {Vec3::Constant(-kAlone / 2), Vec3::Constant(kAlone / 2)};
  const Vec3 around = Vec3::Constant(0.3 * space.size().maxCoeff());
  return {space.min - around, space.max + around};
}

}  // namespace

TriangleMesh thinned(const TriangleMesh& mesh, std::size_t vertices, std::size_t triangles) {
  if (mesh.vertices.size() <= vertices && mesh.triangles.size() <= triangles) return mesh;
  Vec3 least = mesh.vertices.front(), most = least;
  for (const Vec3& vertex : mesh.vertices) {
    least = least.cwiseMin(vertex);
    most = most.cwiseMax(vertex);
  }
  const double size = std::max((most - least).maxCoeff(), 1e-300);
  for (double cells = 2048;; cells /= 1.4) {
    TriangleMesh thin;
    std::map<std::array<int, 3>, std::uint32_t> known;
    std::vector<std::uint32_t> index;
    for (const Vec3& vertex : mesh.vertices) {
      const Vec3 cell = (vertex - least) * (cells / size);
      const std::array key{static_cast<int>(cell.x()), static_cast<int>(cell.y()), static_cast<int>(cell.z())};
      const auto [found, added] = known.emplace(key, static_cast<std::uint32_t>(thin.vertices.size()));
      if (added) thin.vertices.push_back(vertex);
      index.push_back(found->second);
    }
    for (const auto& t : mesh.triangles) {
      const std::array moved{index[t[0]], index[t[1]], index[t[2]]};
      if (moved[0] != moved[1] && moved[1] != moved[2] && moved[2] != moved[0]) thin.triangles.push_back(moved);
    }
    if (cells < 4 || (thin.vertices.size() <= vertices && thin.triangles.size() <= triangles)) return thin;
  }
}

std::vector<ShownObject> shown_objects(const Scene& scene) {
  const Box space = space_around(scene);
  std::vector<ShownObject> objects;
  for (std::size_t i = 0; i < std::min(scene.size(), kMostObjects); ++i) {
    const Object& object = scene.object(i);
    objects.push_back(
        {object.name(), object.kind(),
         thinned(object.tessellated(kTolerance * space.size().norm(), space), kMostVertices, kMostTriangles)});
  }
  return objects;
}

}  // namespace haptrace
