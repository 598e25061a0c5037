#include "scene/shape/bvh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace haptrace {
namespace {

float rounded_down(double value) {
  const auto near = static_cast<float>(value);
  return near <= value ? near : std::nextafter(near, -std::numeric_limits<float>::infinity());
}

float rounded_up(double value) {
  const auto near = static_cast<float>(value);
  return near >= value ? near : std::nextafter(near, std::numeric_limits<float>::infinity());
}

double area_of(const Box& box) {
  const Vec3 size = box.size();
  return size.x() < 0 ? 0 : size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
}

void include(Box& box, const Box& other) {
  box.min = box.min.cwiseMin(other.min);
  box.max = box.max.cwiseMax(other.max);
}

}  // namespace

TrianglePoint closest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  using On = TrianglePoint::On;
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return {a, On::corner, 0};
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return {b, On::corner, 1};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return {a + d1 / (d1 - d3) * ab, On::edge, 0};
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return {c, On::corner, 2};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return {a + d2 / (d2 - d6) * ac, On::edge, 2};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), On::edge, 1};
  const double scale = 1 / (va + vb + vc);
  return {a + vb * scale * ab + vc * scale * ac, On::inside, 0};
}

/// Splits sets of triangles in two until they are small.
struct TriangleTree::Builder {
  static constexpr std::uint32_t kLeaf = 4;  // triangles
  static constexpr int kBins = 16;

  Builder(TriangleTree& made, const TriangleMesh& mesh) : tree(made) {
    boxes.reserve(mesh.triangles.size());
    for (const auto& triangle : mesh.triangles) {
      Box box;
      for (const std::uint32_t corner : triangle) box.include(mesh.vertices[corner]);
      boxes.push_back(box);
      centres.push_back(box.center());
    }
    tree.order_.resize(mesh.triangles.size());
    std::iota(tree.order_.begin(), tree.order_.end(), 0U);
    tree.nodes_.reserve(mesh.triangles.size());
    tree.nodes_.emplace_back();
    build(0, 0, static_cast<std::uint32_t>(tree.order_.size()), 1);
  }

  void build(std::uint32_t index, std::uint32_t begin, std::uint32_t end, int depth) {
    Box box, of_centres;
    for (std::uint32_t i = begin; i < end; ++i) {
      include(box, boxes[tree.order_[i]]);
      of_centres.include(centres[tree.order_[i]]);
    }
    Node& node = tree.nodes_[index];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      node.min[axis] = rounded_down(box.min[static_cast<int>(axis)]);
      node.max[axis] = rounded_up(box.max[static_cast<int>(axis)]);
    }
    const std::uint32_t count = end - begin;
    if (count <= kLeaf || depth >= kDeepest / 2 - 1) {
      node.first = begin;
      node.count = count;
      return;
    }
    const std::uint32_t middle = split(begin, end, of_centres, depth);
    const auto children = static_cast<std::uint32_t>(tree.nodes_.size());
    tree.nodes_[index].first = children;
    tree.nodes_[index].count = 0;
    tree.nodes_.emplace_back();
    tree.nodes_.emplace_back();
    build(children, begin, middle, depth + 1);
    build(children + 1, middle, end, depth + 1);
  }

  /// Orders the triangles of a set into two sets, and returns the first of the second.
  std::uint32_t split(std::uint32_t begin, std::uint32_t end, const Box& of_centres, int depth) {
    const auto first = tree.order_.begin() + begin, last = tree.order_.begin() + end;
    int axis = 0;
    const double size = of_centres.size().maxCoeff(&axis);
    // Near the largest depth, halves keep the tree within it.
    constexpr int kHalvesFrom = kDeepest / 4;
    if (size > 0 && depth < kHalvesFrom) {
      const double low = of_centres.min[axis], scale = kBins / size;
      const auto bin_of = [&](std::uint32_t triangle) {
        return std::min(kBins - 1, static_cast<int>((centres[triangle][axis] - low) * scale));
      };
      std::array<Box, kBins> bins;
      std::array<std::uint32_t, kBins> counts{};
      for (auto at = first; at != last; ++at) {
        const auto bin = static_cast<std::size_t>(bin_of(*at));
        include(bins[bin], boxes[*at]);
        ++counts[bin];
      }
      std::array<double, kBins> left{};
      Box sum;
      std::uint32_t count = 0;
      for (std::size_t i = 0; i + 1 < kBins; ++i) {
        include(sum, bins[i]);
        count += counts[i];
        left[i] = area_of(sum) * count;
      }
      sum = {};
      count = 0;
      double best = std::numeric_limits<double>::infinity();
      int cut = -1;
      for (std::size_t i = kBins - 1; i > 0; --i) {
        include(sum, bins[i]);
        count += counts[i];
        const double cost = left[i - 1] + area_of(sum) * count;
        if (count == 0 || count == end - begin || !(cost < best)) continue;
        best = cost;
        cut = static_cast<int>(i);
      }
      if (cut > 0) {
        const auto middle = std::partition(first, last, [&](std::uint32_t triangle) { return bin_of(triangle) < cut; });
        if (middle != first && middle != last) return static_cast<std::uint32_t>(middle - tree.order_.begin());
      }
    }
    const auto middle = first + (last - first) / 2;
    std::nth_element(first, middle, last,
                     [&](std::uint32_t a, std::uint32_t b) { return centres[a][axis] < centres[b][axis]; });
    return static_cast<std::uint32_t>(middle - tree.order_.begin());
  }

  TriangleTree& tree;
  std::vector<Box> boxes;
  std::vector<Vec3> centres;
};

TriangleTree::TriangleTree(const TriangleMesh& mesh) : mesh_(&mesh) {
  if (!mesh.triangles.empty()) Builder(*this, mesh);
}

TriangleTree::Nearest TriangleTree::nearest(const Vec3& place, double most2) const noexcept {
  Nearest best{.distance2 = most2, .triangle = 0, .point = {}};
  if (nodes_.empty()) return best;
  struct Entry {
    std::uint32_t node;
    double distance2;
  };
  // Written before it is read.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<Entry, kDeepest> stack;
  std::size_t depth = 0;
  stack[depth++] = {0, distance2(nodes_[0], place)};
  while (depth > 0) {
    const Entry entry = stack[--depth];
    if (!(entry.distance2 < best.distance2)) continue;
    const Node& node = nodes_[entry.node];
    if (node.count == 0) {
      Entry near{node.first, distance2(nodes_[node.first], place)};
      Entry far{node.first + 1, distance2(nodes_[node.first + 1], place)};
      if (far.distance2 < near.distance2) std::swap(near, far);
      stack[depth++] = far;
      stack[depth++] = near;
      continue;
    }
    for (std::uint32_t i = 0; i < node.count; ++i) {
      const std::uint32_t triangle = order_[node.first + i];
      const TrianglePoint point =
          closest_on_triangle(place, corner(triangle, 0), corner(triangle, 1), corner(triangle, 2));
      const double square = (point.position - place).squaredNorm();
      if (square < best.distance2) best = {square, triangle, point};
    }
  }
  return best;
}

}  // namespace haptrace
