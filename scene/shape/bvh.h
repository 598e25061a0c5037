// A tree of boxes over triangles.
#pragma once

#include "base/triangle_mesh.h"
#include "base/types.h"
#include "control/path/path.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <utility>
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

/// A triangle with all that a contact reads of it, in two cache lines.
struct alignas(64) Face {
  static constexpr std::uint32_t kNone = 0xffffffff;
  std::array<Vec3, 3> corners;
  Vec3 normal;                                                   ///< unit
  double double_area = 0;                                        ///< [m^2]
  std::array<std::uint32_t, 3> vertices{};                       ///< of the topology
  std::array<std::uint32_t, 3> neighbours{kNone, kNone, kNone};  ///< beyond the edge from corner i to i + 1
};

/// Returns a face without vertices and neighbours. Its normal is right to the last digits for slivers, too.
Face make_face(const Vec3& a, const Vec3& b, const Vec3& c) noexcept;

/// Returns the point of a face that is closest to p. Its error is some roundings of |p - corner|, however thin the
/// triangle is: regions are decided by distances from the edges and not by products of areas. Real-time.
TrianglePoint closest_on(const Face& face, const Vec3& p) noexcept;

/// A bounding-volume hierarchy over the triangles of a mesh, built by the surface-area heuristic. Every node has four
/// children, whose boxes are of single precision around the mesh's centre and wider than the triangles by more than
/// all roundings; the triangles are not rounded. No tolerance has a dimension.
///
/// Real-time: all queries. Threads: any number, after the construction.
class TriangleTree {
 public:
  TriangleTree() = default;
  /// Sorts the triangles of the mesh, so that those of a box are neighbours in memory.
  explicit TriangleTree(TriangleMesh& mesh);

  struct Hit {
    double share = std::numeric_limits<double>::infinity();  ///< of the way from `from` to `to`; infinite: no hit
    std::uint32_t triangle = 0;
    [[nodiscard]] explicit operator bool() const noexcept { return share <= 1; }
  };
  /// Returns the first triangle that the way from `from` to `to` crosses from its front, edges, corners and both ends
  /// included. Where rounding decides, the triangle counts as crossed: no way through a closed mesh is missed, and a
  /// way that grazes an edge may be found. `skips`: whether a triangle is left out.
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

  /// Calls `visit(triangle)` for the triangles whose boxes are within `reach` [m] of the place, in no order: all that
  /// are within the reach, and some others.
  template <class Visit>
  void each_near(const Vec3& place, double reach, const Visit& visit) const noexcept;

  /// Calls `visit(triangle)` for the triangles whose boxes are within `reach` [m] of the way from `from` to `to`, up
  /// to the share that it returned last.
  template <class Visit>
  void each_along(const Vec3& from, const Vec3& to, double reach, const Visit& visit) const noexcept;

  /// Returns how many times a closed mesh winds around a place: 0 outside. The signs are exact for vertices that are
  /// rounded relative to the place, so it is right from the distance of some roundings on.
  [[nodiscard]] int winding(const Vec3& place) const noexcept;

  [[nodiscard]] const Face& face(std::uint32_t triangle) const noexcept { return faces_[triangle]; }
  [[nodiscard]] Face& face(std::uint32_t triangle) noexcept { return faces_[triangle]; }
  [[nodiscard]] const Vec3& corner(std::uint32_t triangle, std::size_t i) const noexcept {
    return faces_[triangle].corners[i];
  }
  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(faces_.size()); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return nodes_.size() * sizeof(Node) + faces_.size() * sizeof(Face);
  }

 private:
  static constexpr std::size_t kStack = 192;  // three more entries for each level, of which there are fewer than 50
  static constexpr int kWide = 4;
  using Lanes = Eigen::Array<float, kWide, 1>;
  struct alignas(64) Node {
    std::array<Lanes, 3> min, max;             // of no child: far away
    std::array<std::uint32_t, kWide> first{};  // the child, or the first triangle
    std::array<std::uint32_t, kWide> count{};  // of triangles; 0: an inner node
  };
  struct Entry {
    float key;  // lower bound of the distance or of the share
    std::uint32_t first, count;
  };
  struct Builder;

  /// The part of a way within the box of the mesh, prepared for tests against boxes.
  class Slab;

  /// Visits the triangles of the boxes for which `keys(node)` gives a key of at most `limit`, the least first.
  /// `visit(triangle)` returns the limit from then on.
  template <class Keys, class Visit>
  void descend(float limit, const Keys& keys, const Visit& visit) const noexcept;
  /// Places far away are taken nearer, which leaves lower bounds what they are.
  [[nodiscard]] Eigen::Vector3f local(const Vec3& place) const noexcept {
    return (place - centre_).cwiseMax(-1e15).cwiseMin(1e15).cast<float>();
  }
  /// Returns a finite limit for distance2(), which is infinite for no child.
  static float rounded_up(double square) noexcept { return static_cast<float>(std::min(square * (1 + 1e-5), 1e37)); }
  static Lanes distance2(const Node& node, const Eigen::Vector3f& place) noexcept {
    Lanes sum = Lanes::Zero();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float p = place[static_cast<int>(axis)];
      const Lanes out = (node.min[axis] - p).max(p - node.max[axis]).max(0.0F);
      sum += out * out;
    }
    return sum;
  }

  Vec3 centre_ = Vec3::Zero(), half_ = Vec3::Zero();
  std::vector<Node> nodes_;
  std::vector<Face> faces_;
};

// --- templates ---

/// The way from one place to another, prepared for tests against triangles.
class Segment {
 public:
  Segment(const Vec3& from, const Vec3& to) noexcept : from_(from), way_(to - from) {
    way_.cwiseAbs().maxCoeff(&z_);
    x_ = (z_ + 1) % 3;
    y_ = (z_ + 2) % 3;
    if (way_[z_] < 0) std::swap(x_, y_);
    inverse_ = 1 / way_[z_];
    shear_x_ = way_[x_] * inverse_;
    shear_y_ = way_[y_] * inverse_;
  }
  /// False where the places are the same.
  [[nodiscard]] bool moves() const noexcept { return way_[z_] != 0; }

  /// Returns the share of the way at which it crosses the triangle from its front; infinity if it does not. Where
  /// rounding decides, it does.
  [[nodiscard]] double crossing(const Vec3& a, const Vec3& b, const Vec3& c) const noexcept {
    constexpr double kRounding = 48 * std::numeric_limits<double>::epsilon();
    const Vec3 pa = a - from_, pb = b - from_, pc = c - from_;
    const double ax = pa[x_] - shear_x_ * pa[z_], ay = pa[y_] - shear_y_ * pa[z_];
    const double bx = pb[x_] - shear_x_ * pb[z_], by = pb[y_] - shear_y_ * pb[z_];
    const double cx = pc[x_] - shear_x_ * pc[z_], cy = pc[y_] - shear_y_ * pc[z_];
    const double u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
    // Seen from its front, a triangle runs anticlockwise: all three are positive or zero.
    const double least = std::min(std::min(u, v), w);
    const double far = std::max(std::max(pa.cwiseAbs().maxCoeff(), pb.cwiseAbs().maxCoeff()), pc.cwiseAbs().maxCoeff());
    const double doubt = kRounding * far * far;
    if (least < -doubt) return kNever;
    if (least <= doubt) return doubtful(a, b, c);
    const double sum = u + v + w;
    const double share = (u * pa[z_] + v * pb[z_] + w * pc[z_]) / sum * inverse_;
    const double slack = kRounding * far * far * far / sum * std::abs(inverse_);
    if (share < -slack || share > 1 + slack) return kNever;
    return std::clamp(share, 0.0, 1.0);
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  /// The same with a longer mantissa, near an edge or a corner.
  [[nodiscard]] double doubtful(const Vec3& a, const Vec3& b, const Vec3& c) const noexcept;

  Vec3 from_, way_;
  double inverse_ = 0, shear_x_ = 0, shear_y_ = 0;
  int x_ = 0, y_ = 1, z_ = 2;
};

class TriangleTree::Slab {
 public:
  /// `reach`: how far from the way a box may be.
  Slab(const TriangleTree& tree, const Vec3& from, const Vec3& to, double reach) noexcept
      : reach_(static_cast<float>(reach * (1 + 1e-6))) {
    // Clipped in double precision, so that a start far away loses no digits.
    const Vec3 way = to - from;
    for (int axis = 0; axis < 3; ++axis) {
      const double low = tree.centre_[axis] - tree.half_[axis] - 2 * reach - from[axis];
      const double high = tree.centre_[axis] + tree.half_[axis] + 2 * reach - from[axis];
      if (way[axis] == 0) {
        if (low > 0 || high < 0) end_ = -1;
        continue;
      }
      const double a = low / way[axis], b = high / way[axis];
      begin_ = std::max(begin_, std::min(a, b));
      end_ = std::min(end_, std::max(a, b));
    }
    if (!(begin_ <= end_)) return;
    const Eigen::Vector3f start = tree.local(from + begin_ * way);
    const Eigen::Vector3f part = ((end_ - begin_) * way).cast<float>();
    constexpr float kLeast = 1e-30F;
    for (int axis = 0; axis < 3; ++axis) {
      start_[static_cast<std::size_t>(axis)] = start[axis];
      inverse_[static_cast<std::size_t>(axis)] =
          1 / (std::abs(part[axis]) < kLeast ? std::copysign(kLeast, part[axis]) : part[axis]);
    }
  }
  [[nodiscard]] bool meets() const noexcept { return begin_ <= end_; }
  /// Returns the share of the clipped way for one of the whole way, rounded up.
  [[nodiscard]] float clipped(double share) const noexcept {
    return end_ > begin_ ? static_cast<float>((share - begin_) / (end_ - begin_)) + 1e-6F : 2.0F;
  }
  /// Returns lower bounds of the shares at which the way enters the boxes of the children; infinity: never.
  [[nodiscard]] Lanes operator()(const Node& node) const noexcept {
    Lanes near = Lanes::Zero(), far = Lanes::Constant(1.0F);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Lanes a = (node.min[axis] - (start_[axis] + reach_)) * inverse_[axis];
      const Lanes b = (node.max[axis] - (start_[axis] - reach_)) * inverse_[axis];
      near = near.max(a.min(b));
      far = far.min(a.max(b));
    }
    constexpr float kRounding = 1e-6F;
    return (near * (1 - kRounding) <= far * (1 + kRounding) + kRounding)
        .select(near * (1 - kRounding) - kRounding, Lanes::Constant(std::numeric_limits<float>::infinity()));
  }

 private:
  double begin_ = 0, end_ = 1;
  std::array<float, 3> start_{}, inverse_{};
  float reach_ = 0;
};

template <class Keys, class Visit>
void TriangleTree::descend(float limit, const Keys& keys, const Visit& visit) const noexcept {
  if (nodes_.empty()) return;
  // Written before it is read.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<Entry, kStack> stack;
  std::size_t depth = 0;
  stack[depth++] = {-std::numeric_limits<float>::infinity(), 0, 0};
  while (depth > 0) {
    const Entry entry = stack[--depth];
    if (entry.key > limit) continue;
    if (entry.count > 0) {
      for (std::uint32_t i = 0; i < entry.count; ++i) limit = visit(entry.first + i);
      continue;
    }
    const Node& node = nodes_[entry.first];
    const Lanes key = keys(node);
    const std::size_t base = depth;
    for (int i = 0; i < kWide; ++i) {
      if (!(key[i] <= limit)) continue;
      // The least comes last, and is taken first.
      std::size_t at = depth++;
      for (; at > base && stack[at - 1].key < key[i]; --at) stack[at] = stack[at - 1];
      stack[at] = {key[i], node.first[static_cast<std::size_t>(i)], node.count[static_cast<std::size_t>(i)]};
    }
  }
}

template <class Skips>
TriangleTree::Hit TriangleTree::sweep(const Vec3& from, const Vec3& to, const Skips& skips) const noexcept {
  Hit hit;
  const Segment segment(from, to);
  if (!segment.moves()) return hit;
  const Slab slab(*this, from, to, 0);
  if (!slab.meets()) return hit;
  float limit = 2;
  descend(limit, slab, [&](std::uint32_t triangle) {
    const Face& face = faces_[triangle];
    const double share = segment.crossing(face.corners[0], face.corners[1], face.corners[2]);
    if (share < hit.share && !skips(triangle)) {
      hit = {share, triangle};
      limit = slab.clipped(share);
    }
    return limit;
  });
  return hit;
}

template <class Visit>
void TriangleTree::each_near(const Vec3& place, double reach, const Visit& visit) const noexcept {
  const Eigen::Vector3f at = local(place);
  const float limit = rounded_up(reach * reach);
  descend(
      limit, [&](const Node& node) { return distance2(node, at); },
      [&](std::uint32_t triangle) {
        visit(triangle);
        return limit;
      });
}

template <class Visit>
void TriangleTree::each_along(const Vec3& from, const Vec3& to, double reach, const Visit& visit) const noexcept {
  const Slab slab(*this, from, to, reach);
  if (!slab.meets()) return;
  descend(2.0F, slab, [&](std::uint32_t triangle) { return slab.clipped(visit(triangle)); });
}

}  // namespace haptrace
