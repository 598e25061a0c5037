// A tree of boxes over triangles.
#pragma once

#include "base/triangle_mesh.h"
#include "base/types.h"
#include "control/path/path.h"

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

namespace haptrace {

/// The closest point of a triangle.
struct TrianglePoint {
  /// The part of a triangle that holds the point: its inside, its edge from corner i to i + 1, or its corner i.
  enum class On : std::uint8_t { inside, edge, corner };
  Vec3 position = Vec3::Zero();
  On on = On::inside;
  std::uint8_t corner = 0;  ///< i
};

/// Returns the point of triangle abc that is closest to p (Ericson, Real-Time Collision Detection 5.1.5). Real-time.
TrianglePoint closest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) noexcept;

/// A bounding-volume hierarchy over the triangles of a mesh, built by the surface-area heuristic. Boxes are of single
/// precision and rounded outwards; the triangles are not rounded. No tolerance has a dimension.
///
/// Real-time: all queries. Threads: any number, after the construction. Borrows the mesh.
class TriangleTree {
 public:
  TriangleTree() = default;
  explicit TriangleTree(const TriangleMesh& mesh);

  struct Hit {
    double share = std::numeric_limits<double>::infinity();  ///< of the way from `from` to `to`; infinite: no hit
    std::uint32_t triangle = 0;
    [[nodiscard]] explicit operator bool() const noexcept { return share <= 1; }
  };
  /// Returns the first triangle that the way from `from` to `to` crosses from its front, edges and corners included:
  /// two triangles with a common edge leave no gap (Woop, Benthin and Wald 2013). `skips`: whether a triangle is left
  /// out.
  template <class Skips>
  [[nodiscard]] Hit sweep(const Vec3& from, const Vec3& to, const Skips& skips) const noexcept;
  [[nodiscard]] Hit sweep(const Vec3& from, const Vec3& to) const noexcept {
    return sweep(from, to, [](std::uint32_t) { return false; });
  }

  struct Nearest {
    double distance2 = std::numeric_limits<double>::infinity();  ///< [m^2]
    std::uint32_t triangle = 0;
    TrianglePoint point;
  };
  /// Returns the closest point of the mesh, if it is nearer than sqrt(`most2`) [m].
  [[nodiscard]] Nearest nearest(const Vec3& place,
                                double most2 = std::numeric_limits<double>::infinity()) const noexcept;

  /// Calls `visit(triangle, point)` for every triangle within `reach` [m] of the place, in no order.
  template <class Visit>
  void each_within(const Vec3& place, double reach, const Visit& visit) const noexcept;

  [[nodiscard]] const Vec3& corner(std::uint32_t triangle, std::size_t i) const noexcept {
    return mesh_->vertices[mesh_->triangles[triangle][i]];
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return nodes_.size() * sizeof(Node) + order_.size() * sizeof(std::uint32_t);
  }

 private:
  static constexpr int kDeepest = 64;
  struct Node {
    std::array<float, 3> min{}, max{};
    std::uint32_t first = 0;  ///< of the children, which are neighbours, or of the triangles in order_
    std::uint32_t count = 0;  ///< of triangles; 0: an inner node
  };
  struct Builder;

  static double distance2(const Node& node, const Vec3& place) noexcept {
    double sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double p = place[static_cast<int>(axis)];
      const double out = p < node.min[axis] ? node.min[axis] - p : p > node.max[axis] ? p - node.max[axis] : 0.0;
      sum += out * out;
    }
    return sum;
  }

  const TriangleMesh* mesh_ = nullptr;
  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;
};

// --- templates ---

/// The way from one place to another, prepared for tests against boxes and triangles.
class Segment {
 public:
  Segment(const Vec3& from, const Vec3& to) noexcept : from_(from) {
    const Vec3 way = to - from;
    for (int axis = 0; axis < 3; ++axis) inverse_[axis] = 1 / way[axis];
    way.cwiseAbs().maxCoeff(&z_);
    x_ = (z_ + 1) % 3;
    y_ = (z_ + 2) % 3;
    if (way[z_] < 0) std::swap(x_, y_);
    length_ = way[z_];
    shear_ = {way[x_] / way[z_], way[y_] / way[z_], 1 / way[z_]};
  }
  /// False where the places are the same.
  [[nodiscard]] bool moves() const noexcept { return length_ != 0; }

  /// Returns whether the way up to `share` meets the box. A way within a side's plane counts.
  template <class Bounds>
  [[nodiscard]] bool meets(const Bounds& min, const Bounds& max, double share) const noexcept {
    double near = 0, far = share;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int i = static_cast<int>(axis);
      double a = (min[axis] - from_[i]) * inverse_[i], b = (max[axis] - from_[i]) * inverse_[i];
      if (a > b) std::swap(a, b);
      // 0 * infinity is NaN, which no comparison takes: such a side limits nothing.
      if (a > near) near = a;
      if (b < far) far = b;
    }
    // The bounds were rounded outwards, but not the division.
    return near <= far * (1 + 4 * std::numeric_limits<double>::epsilon()) + std::numeric_limits<double>::min();
  }

  /// Returns the share of the way at which it crosses the triangle from its front; infinity if it does not.
  [[nodiscard]] double crossing(const Vec3& a, const Vec3& b, const Vec3& c) const noexcept {
    constexpr double kNever = std::numeric_limits<double>::infinity();
    const Vec3 pa = a - from_, pb = b - from_, pc = c - from_;
    const double ax = pa[x_] - shear_[0] * pa[z_], ay = pa[y_] - shear_[1] * pa[z_];
    const double bx = pb[x_] - shear_[0] * pb[z_], by = pb[y_] - shear_[1] * pb[z_];
    const double cx = pc[x_] - shear_[0] * pc[z_], cy = pc[y_] - shear_[1] * pc[z_];
    const double u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
    // Seen from its front, a triangle runs anticlockwise: all three are positive or zero.
    if (u < 0 || v < 0 || w < 0) return kNever;
    const double sum = u + v + w;
    if (sum == 0) return kNever;
    const double share = (u * pa[z_] + v * pb[z_] + w * pc[z_]) / sum * shear_[2];
    return share >= 0 && share <= 1 ? share : kNever;
  }

 private:
  Vec3 from_, inverse_, shear_ = Vec3::Zero();
  int x_ = 0, y_ = 1, z_ = 2;
  double length_ = 0;
};

template <class Skips>
TriangleTree::Hit TriangleTree::sweep(const Vec3& from, const Vec3& to, const Skips& skips) const noexcept {
  Hit hit;
  const Segment segment(from, to);
  if (nodes_.empty() || !segment.moves()) return hit;
  // Written before it is read.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<std::uint32_t, kDeepest> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    if (!segment.meets(node.min, node.max, std::min(1.0, hit.share))) continue;
    if (node.count == 0) {
      stack[depth++] = node.first;
      stack[depth++] = node.first + 1;
      continue;
    }
    for (std::uint32_t i = 0; i < node.count; ++i) {
      const std::uint32_t triangle = order_[node.first + i];
      const double share = segment.crossing(corner(triangle, 0), corner(triangle, 1), corner(triangle, 2));
      if (share < hit.share && !skips(triangle)) hit = {share, triangle};
    }
  }
  return hit;
}

template <class Visit>
void TriangleTree::each_within(const Vec3& place, double reach, const Visit& visit) const noexcept {
  if (nodes_.empty()) return;
  const double most2 = reach * reach;
  // Written before it is read.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<std::uint32_t, kDeepest> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const Node& node = nodes_[stack[--depth]];
    if (distance2(node, place) > most2) continue;
    if (node.count == 0) {
      stack[depth++] = node.first;
      stack[depth++] = node.first + 1;
      continue;
    }
    for (std::uint32_t i = 0; i < node.count; ++i) {
      const std::uint32_t triangle = order_[node.first + i];
      const TrianglePoint point =
          closest_on_triangle(place, corner(triangle, 0), corner(triangle, 1), corner(triangle, 2));
      if ((point.position - place).squaredNorm() <= most2) visit(triangle, point);
    }
  }
}

}  // namespace haptrace
