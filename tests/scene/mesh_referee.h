// A referee of contacts with closed meshes, which shares no code with the tree of boxes and the proxies.
#pragma once

#include "base/triangle_mesh.h"
#include "scene/shape/mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace haptrace::test {

/// Decides whether a place is inside a closed mesh: by the signed crossings of rays along the axes, both ways, with a
/// majority of the six.
class MeshReferee {
 public:
  explicit MeshReferee(const TriangleMesh& mesh) : mesh_(mesh) {
    least_ = most_ = mesh.vertices.at(0);
    for (const Vec3& vertex : mesh.vertices) {
      least_ = least_.cwiseMin(vertex);
      most_ = most_.cwiseMax(vertex);
    }
    cells_ = std::clamp(static_cast<int>(std::sqrt(static_cast<double>(mesh.triangles.size()))), 1, 512);
    for (int axis = 0; axis < 3; ++axis) {
      auto& columns = columns_.at(static_cast<std::size_t>(axis));
      columns.resize(static_cast<std::size_t>(cells_) * static_cast<std::size_t>(cells_));
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
        std::array<int, 2> low{cells_, cells_}, high{-1, -1};
        for (const std::uint32_t corner : mesh.triangles[t]) {
          const Vec3& place = mesh.vertices[corner];
          low = {std::min(low[0], cell(place[u], u)), std::min(low[1], cell(place[v], v))};
          high = {std::max(high[0], cell(place[u], u)), std::max(high[1], cell(place[v], v))};
        }
        for (int i = low[0]; i <= high[0]; ++i)
          for (int j = low[1]; j <= high[1]; ++j) columns[index(i, j)].push_back(t);
      }
    }
  }

  [[nodiscard]] bool inside(const Vec3& place) const {
    if ((place.array() < least_.array()).any() || (place.array() > most_.array()).any()) return false;
    int votes = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      int above = 0, below = 0;
      for (const std::uint32_t t :
           columns_.at(static_cast<std::size_t>(axis))[index(cell(place[u], u), cell(place[v], v))]) {
        const Vec3 a = mesh_.vertices[mesh_.triangles[t][0]] - place, b = mesh_.vertices[mesh_.triangles[t][1]] - place,
                   c = mesh_.vertices[mesh_.triangles[t][2]] - place;
        const double fa = b[u] * c[v] - b[v] * c[u], fb = c[u] * a[v] - c[v] * a[u], fc = a[u] * b[v] - a[v] * b[u];
        const bool left = fa > 0 && fb > 0 && fc > 0, right = fa < 0 && fb < 0 && fc < 0;
        if (!left && !right) continue;
        const double height = (fa * a[axis] + fb * b[axis] + fc * c[axis]) / (fa + fb + fc);
        (height > 0 ? above : below) += left ? 1 : -1;
      }
      votes += (above != 0 ? 1 : 0) + (below != 0 ? 1 : 0);
    }
    return votes > 3;
  }

  /// Returns whether a triangle is in the straight way between two places, but for one that starts on it.
  [[nodiscard]] bool blocked(const Vec3& from, const Vec3& to) const {
    for (const double part : {0.5, 0.9, 0.1, 0.99})
      if (inside(from + part * (to - from))) return true;
    constexpr double kEdge = 1e-9;
    const Vec3 way = to - from;
    const double start = 1e-13 * size().maxCoeff() / way.norm();
    for (const auto& t : mesh_.triangles) {
      const Vec3 &a = mesh_.vertices[t[0]], ab = mesh_.vertices[t[1]] - a, ac = mesh_.vertices[t[2]] - a;
      const Vec3 p = way.cross(ac);
      const double determinant = ab.dot(p);
      if (determinant == 0) continue;
      const Vec3 s = from - a, q = s.cross(ab);
      const double u = s.dot(p) / determinant, v = way.dot(q) / determinant, share = ac.dot(q) / determinant;
      if (u >= -kEdge && v >= -kEdge && u + v <= 1 + kEdge && share > start && share < 1) return true;
    }
    return false;
  }

  [[nodiscard]] Vec3 middle() const { return 0.5 * (least_ + most_); }
  [[nodiscard]] Vec3 size() const { return most_ - least_; }

 private:
  [[nodiscard]] int cell(double value, int axis) const {
    return std::clamp(static_cast<int>((value - least_[axis]) / (most_[axis] - least_[axis]) * cells_), 0, cells_ - 1);
  }
  [[nodiscard]] std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(i) * static_cast<std::size_t>(cells_) + static_cast<std::size_t>(j);
  }

  const TriangleMesh& mesh_;
  Vec3 least_, most_;
  int cells_ = 1;
  std::array<std::vector<std::vector<std::uint32_t>>, 3> columns_;
};

/// The mistakes in a walk of a tool around a closed mesh.
struct WalkFaults {
  std::int64_t ticks = 0, touched = 0, begun = 0, released = 0;
  std::int64_t leaked = 0;  ///< the tool was free, though inside
  std::int64_t sunk = 0;    ///< the proxy was inside, or the ball overlapped the mesh
  std::int64_t astray = 0;  ///< the proxy was not on the surface, that of a ball after some ticks in the same place; or
                            ///< its numbers did not agree
  std::int64_t stuck = 0;   ///< the surface held a tool that was outside with a free way to it
  [[nodiscard]] std::int64_t all() const { return leaked + sunk + astray + stuck; }
};

/// Moves a tool at random for so many ticks: along the surface, in jumps, exactly through vertices and edges, exactly
/// along edges, and in the planes of triangles.
inline WalkFaults walk_around(const Mesh& mesh, double radius, std::int64_t ticks, unsigned seed) {
  const TriangleMesh& triangles = mesh.triangles();
  const MeshReferee referee(triangles);
  const double size = referee.size().maxCoeff(), rounding = 1e-12 * size;
  std::mt19937 random(seed);
  std::normal_distribution<double> push;
  std::uniform_real_distribution<double> share(0, 1);
  WalkFaults faults;
  Proxy proxy;
  Vec3 at = referee.middle() + Vec3(0, 0, size), velocity = Vec3::Zero();

  enum class Seen : std::uint8_t { right, held, in_the_air };
  const auto step_to = [&](const Vec3& place) {
    const bool before = proxy.touching;
    mesh.follow({.from = at, .to = place, .radius = radius}, proxy);
    at = place;
    ++faults.ticks;
    faults.touched += proxy.touching ? 1 : 0;
    faults.begun += !before && proxy.touching ? 1 : 0;
    faults.released += before && !proxy.touching ? 1 : 0;
    const SurfacePoint near = mesh.nearest(at);
    const double away = std::abs(near.distance);
    if (!proxy.touching) {
      if (referee.inside(at) ? away > rounding : radius > 0 && away < radius * (1 - 1e-6)) ++faults.leaked;
      return Seen::right;
    }
    const SurfacePoint under = mesh.nearest(proxy.position);
    const double gap = std::abs(under.distance);
    if (radius > 0 ? referee.inside(proxy.position) || gap < radius * (1 - 1e-6)
                   : gap > rounding && referee.inside(proxy.position))
      ++faults.sunk;
    if (radius == 0 && gap > rounding) ++faults.astray;
    if (!is_finite(proxy.position) || !(std::abs(proxy.normal.norm() - 1) < 1e-9) || !(proxy.depth >= 0) ||
        !((proxy.position - at - proxy.depth * proxy.normal).norm() <= rounding))
      ++faults.astray;
    if (radius > 0 && gap > radius * (1 + 1e-5)) return Seen::in_the_air;
    if (referee.inside(at)) return Seen::right;
    // Outside: held only if something is in the way back.
    if (radius > 0 ? away < radius * (1 + 1e-6) : away < rounding) return Seen::right;
    if (radius == 0) return referee.blocked(proxy.position, at) ? Seen::right : Seen::held;
    constexpr int kParts = 24;
    for (int i = 1; i < kParts; ++i) {
      const Vec3 between = proxy.position + static_cast<double>(i) / kParts * (at - proxy.position);
      if (std::abs(mesh.nearest(between).distance) < radius * (1 + 1e-6) || referee.inside(between)) return Seen::right;
    }
    return (at - proxy.position).norm() > 0.5 * kParts * radius ? Seen::right : Seen::held;  // too far for samples
  };
  const auto move_to = [&](const Vec3& place) {
    Seen seen = step_to(place);
    // A proxy may need some ticks to arrive.
    for (int i = 0; i < 8 && seen != Seen::right; ++i) seen = step_to(place);
    if (seen != Seen::right) ++(seen == Seen::held ? faults.stuck : faults.astray);
  };
  const auto any_corner = [&] { return triangles.vertices[random() % triangles.vertices.size()]; };
  const auto outside = [&](const Vec3& towards) -> Vec3 {
    return referee.middle() + 1.5 * size * (towards - referee.middle()).normalized();
  };

  while (faults.ticks < ticks) {
    const double kind = share(random);
    if (kind < 0.01) {
      move_to(referee.middle() +
              0.75 * size * Vec3(2 * share(random) - 1, 2 * share(random) - 1, 2 * share(random) - 1));
      velocity.setZero();
    } else if (kind < 0.02) {
      // Exactly at a vertex or at a point of an edge, then on; slowly or at once.
      const auto& t = triangles.triangles[random() % triangles.triangles.size()];
      const double part = std::array{0.0, 0.5, 1e-9, share(random)}.at(random() % 4);
      const Vec3 aim = triangles.vertices[t[0]] + part * (triangles.vertices[t[1]] - triangles.vertices[t[0]]);
      const Vec3 from = outside(aim);
      move_to(from);
      const double near = std::pow(10.0, -12 * share(random));
      move_to(aim + near * (from - aim) / 30);
      if (random() % 2 == 0) move_to(aim);
      move_to(aim - near * (from - aim) / 30);
      if (random() % 2 == 0) move_to(aim + near * (from - aim) / 30);
      velocity.setZero();
    } else if (kind < 0.03) {
      // Along an edge from end to end, and within the plane of its triangle.
      const auto& t = triangles.triangles[random() % triangles.triangles.size()];
      move_to(outside(triangles.vertices[t[0]]));
      move_to(triangles.vertices[t[0]]);
      move_to(triangles.vertices[t[1]]);
      move_to(0.5 * (triangles.vertices[t[1]] + triangles.vertices[t[2]]));
      move_to((triangles.vertices[t[0]] + triangles.vertices[t[1]] + triangles.vertices[t[2]]) / 3);
      velocity.setZero();
    } else if (kind < 0.035) {
      move_to(any_corner());
      velocity.setZero();
    } else if (kind < 0.04) {
      move_to(outside(at + 1e-3 * size * Vec3(push(random), push(random), push(random))));
      velocity.setZero();
    } else {
      // As a hand: some hundred ticks around the surface, in and out.
      const Vec3 target = any_corner() + 0.02 * size * Vec3(push(random), push(random), push(random));
      const int length = 20 + static_cast<int>(random() % 200);
      for (int i = 0; i < length && faults.ticks < ticks; ++i) {
        velocity += 1e-3 * (Vec3(push(random), push(random), push(random)) * 300 * size - 400 * (at - target)) -
                    0.02 * velocity;
        move_to(at + 1e-3 * velocity);
      }
    }
  }
  return faults;
}

}  // namespace haptrace::test
