// Meshes for tests, made from formulas.
#pragma once

#include "base/triangle_mesh.h"
#include "formats/mesh/mesh_file.h"
#include "scene/shape/grid_mesh.h"
#include "scene/shape/mesh.h"

#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <numbers>
#include <string>

namespace haptrace::test {

/// Returns a sphere of about `triangles` triangles with a relief: closed, and without poles' slivers of no area.
inline TriangleMesh bumpy_sphere(double radius, double relief, int triangles) {
  const int turns = std::max(6, static_cast<int>(std::sqrt(triangles)));
  return grid_mesh(turns, turns / 2, {.wraps_u = true}, [&](double u, double v) -> Vec3 {
    using std::numbers::pi;
    const double along = 2 * pi * u, up = pi * (v - 0.5);
    const Vec3 out(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up));
    const double height = std::sin(7 * out.x() + 1) * std::sin(9 * out.y()) * std::cos(8 * out.z());
    return (radius + relief * height) * out;
  });
}

/// Returns a sphere of about `triangles` triangles with sharp teeth all around: every other ring is higher.
inline TriangleMesh toothed_sphere(double radius, double teeth, int triangles) {
  const int turns = std::max(8, static_cast<int>(std::sqrt(triangles)) / 4 * 4), rings = turns / 2;
  return grid_mesh(turns, rings, {.wraps_u = true}, [&](double u, double v) -> Vec3 {
    using std::numbers::pi;
    const double along = 2 * pi * u, up = pi * (v - 0.5);
    const bool high = std::lround(v * rings) % 2 == 1;
    return (radius + (high ? teeth : 0.0)) *
           Vec3(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up));
  });
}

/// Returns a bumpy sphere of about `triangles` triangles, every other of which is this much thinner than its
/// neighbour.
inline TriangleMesh sphere_with_slivers(double radius, double relief, int triangles, double thin) {
  const int turns = std::max(8, static_cast<int>(std::sqrt(triangles)) / 4 * 4), rings = turns / 2;
  const auto warped = [&](double share, int count) {
    const auto i = std::lround(share * count);
    return (static_cast<double>(i / 2) * (1 + thin) + static_cast<double>(i % 2)) / (0.5 * count * (1 + thin));
  };
  return grid_mesh(turns, rings, {.wraps_u = true}, [&](double u, double v) -> Vec3 {
    using std::numbers::pi;
    const double along = 2 * pi * warped(u, turns), up = pi * (warped(v, rings) - 0.5);
    const Vec3 out(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up));
    const double height = std::sin(7 * out.x() + 1) * std::sin(9 * out.y()) * std::cos(8 * out.z());
    return (radius + relief * height) * out;
  });
}

/// Returns a box of 12 triangles or, with `parts` above 1, of that many squares along each edge of a side.
inline TriangleMesh box_mesh(const Vec3& size, int parts = 1) {
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {-1.0, 1.0}) {
      const int a = (axis + 1) % 3, b = (axis + 2) % 3;
      const TriangleMesh side = grid_mesh(parts, parts, {}, [&](double u, double v) {
        Vec3 place;
        place[axis] = 0.5 * sign * size[axis];
        place[a] = (u - 0.5) * size[a] * sign;
        place[b] = (v - 0.5) * size[b];
        return place;
      });
      const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
      mesh.vertices.insert(mesh.vertices.end(), side.vertices.begin(), side.vertices.end());
      for (const auto& t : side.triangles) mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
  return mesh;
}

/// Returns the text of an OBJ file.
inline std::string obj_of(const TriangleMesh& mesh) {
  std::string text = "# made by a test\n";
  for (const Vec3& v : mesh.vertices) text += fmt::format("v {} {} {}\n", v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) text += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  return text;
}

/// Adds the triangles of another mesh, moved.
inline void join(TriangleMesh& mesh, const TriangleMesh& other, const Vec3& shift) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const Vec3& vertex : other.vertices) mesh.vertices.push_back(vertex + shift);
  for (const auto& t : other.triangles) mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
}

/// Returns a mesh that the hand can touch, loaded as from a file.
inline Mesh mesh_of(TriangleMesh triangles) {
  MeshLoad load = clean_mesh(std::move(triangles), "test");
  return {std::move(load.mesh), std::move(load.remarks)};
}

}  // namespace haptrace::test
