#include "scene/shape/grid_mesh.h"

#include <algorithm>
#include <map>
#include <tuple>

namespace haptrace {

TriangleMesh grid_mesh(int nu, int nv, const GridEnds& ends, const std::function<Vec3(double u, double v)>& place) {
  const int columns = nu + (ends.wraps_u ? 0 : 1), rows = nv + (ends.wraps_v ? 0 : 1);
  std::vector<Vec3> points;
  Vec3 least = Vec3::Constant(1e300), most = Vec3::Constant(-1e300);
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      points.push_back(place(static_cast<double>(i) / nu, static_cast<double>(j) / nv));
      least = least.cwiseMin(points.back());
      most = most.cwiseMax(points.back());
    }

  // Poles are computed several times, with rounding errors of the size of the surface.
  const double merged = 1e-12 * std::max(1e-300, (most - least).maxCoeff());
  TriangleMesh mesh;
  std::map<std::tuple<std::int64_t, std::int64_t, std::int64_t>, std::uint32_t> known;
  std::vector<std::uint32_t> index;
  for (const Vec3& point : points) {
    const Vec3 cell = (point - least) / merged;
    const auto key = std::tuple(std::llround(cell.x()), std::llround(cell.y()), std::llround(cell.z()));
    const auto [found, added] = known.emplace(key, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (added) mesh.vertices.push_back(point);
    index.push_back(found->second);
  }

  const auto at = [&](int i, int j) {
    return index[static_cast<std::size_t>(j % rows) * static_cast<std::size_t>(columns) +
                 static_cast<std::size_t>(i % columns)];
  };
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    if (a != b && b != c && c != a) mesh.triangles.push_back({a, b, c});
  };
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i) {
      add(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      add(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  return mesh;
}

}  // namespace haptrace
