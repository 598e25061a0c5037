#include "scene/shape/bvh.h"

#include <cmath>
#include <numeric>

namespace haptrace {
namespace {

double area_of(const Box& box) {
  const Vec3 size = box.size();
  return size.x() < 0 ? 0 : size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
}

/// Returns the sign of a b - c d, exactly. The products are finite.
int sign_of_difference(double a, double b, double c, double d) noexcept {
  const double p = a * b, q = c * d;
  if (p > q) return 1;
  if (p < q) return -1;
  const double difference = std::fma(a, b, -p) - std::fma(c, d, -q);
  return difference > 0 ? 1 : difference < 0 ? -1 : 0;
}

/// Returns on which side of the line from a to b the origin is, in a plane: 1 if to its left. It never is on the line:
/// it counts as moved to x by next to nothing, and to y by next to nothing of that.
int side_of_line(double ax, double ay, double bx, double by) noexcept {
  const int sign = sign_of_difference(ax, by, ay, bx);
  if (sign != 0) return sign;
  if (ay != by) return ay > by ? 1 : -1;
  return bx > ax ? 1 : bx < ax ? -1 : 0;
}

/// Returns the closest point of the edge from one corner along `way` to the next.
inline TrianglePoint closest_on_edge(const Vec3& from, const Vec3& way, const Vec3& to, std::uint8_t corner,
                                     const Vec3& p) noexcept {
  using On = TrianglePoint::On;
  const double along = way.dot(p - from), length2 = way.squaredNorm();
  if (along <= 0) return {from, On::corner, corner};
  if (along >= length2) return {to, On::corner, static_cast<std::uint8_t>(corner == 2 ? 0 : corner + 1)};
  return {from + along / length2 * way, On::edge, corner};
}

inline TrianglePoint nearer(const TrianglePoint& one, const TrianglePoint& other, const Vec3& p) noexcept {
  return (other.position - p).squaredNorm() < (one.position - p).squaredNorm() ? other : one;
}

}  // namespace

Face make_face(const Vec3& a, const Vec3& b, const Vec3& c) noexcept {
  using Long = Eigen::Matrix<long double, 3, 1>;
  // From the corner between the shorter edges: their directions differ most.
  const double ab = (b - a).squaredNorm(), bc = (c - b).squaredNorm(), ca = (a - c).squaredNorm();
  const Vec3& first = bc >= ab && bc >= ca ? a : ca >= ab ? b : c;
  const Vec3& second = &first == &a ? b : &first == &b ? c : a;
  const Vec3& third = &first == &a ? c : &first == &b ? a : b;
  const Long origin = first.cast<long double>();
  const Long across = (second.cast<long double>() - origin).cross(third.cast<long double>() - origin);
  const long double size = across.norm();
  Face face;
  face.corners = {a, b, c};
  face.normal = size > 0 ? Vec3((across / size).cast<double>()) : Vec3(Vec3::Zero());
  face.double_area = static_cast<double>(size);
  return face;
}

TrianglePoint closest_on(const Face& face, const Vec3& p) noexcept {
  using On = TrianglePoint::On;
  const Vec3 &a = face.corners[0], &b = face.corners[1], &c = face.corners[2];
  const Vec3 ap = p - a, ab = b - a, ac = c - a;
  const Vec3 across = ap.cross(face.normal);
  // Twice the signed areas over the edges: negative beyond an edge.
  const double over_ab = ab.dot(across), over_ca = -ac.dot(across), over_bc = face.double_area - over_ab - over_ca;
  if (over_ab >= 0 && over_bc >= 0 && over_ca >= 0) return {p - face.normal.dot(ap) * face.normal, On::inside, 0};
  // It is on an edge that looks towards p, of which there are one or two.
  const auto on_ab = [&] { return closest_on_edge(a, ab, b, 0, p); };
  const auto on_bc = [&] { return closest_on_edge(b, c - b, c, 1, p); };
  const auto on_ca = [&] { return closest_on_edge(c, -ac, a, 2, p); };
  if (over_ab < 0 && over_bc >= 0 && over_ca >= 0) return on_ab();
  if (over_bc < 0 && over_ab >= 0 && over_ca >= 0) return on_bc();
  if (over_ca < 0 && over_ab >= 0 && over_bc >= 0) return on_ca();
  // Compared within the plane: the distances from a place far above it differ by less than their rounding.
  const Vec3 below = p - face.normal.dot(ap) * face.normal;
  if (over_ab >= 0) return nearer(on_bc(), on_ca(), below);
  return over_bc < 0 ? nearer(on_ab(), on_bc(), below) : nearer(on_ab(), on_ca(), below);
}

double Segment::doubtful(const Vec3& a, const Vec3& b, const Vec3& c) const noexcept {
  using Long = Eigen::Matrix<long double, 3, 1>;
  constexpr long double kRounding = 96 * std::numeric_limits<long double>::epsilon();
  const Long from = from_.cast<long double>();
  const Long pa = a.cast<long double>() - from, pb = b.cast<long double>() - from, pc = c.cast<long double>() - from;
  const long double length = way_[z_], sx = way_[x_] / length, sy = way_[y_] / length;
  const long double ax = pa[x_] - sx * pa[z_], ay = pa[y_] - sy * pa[z_];
  const long double bx = pb[x_] - sx * pb[z_], by = pb[y_] - sy * pb[z_];
  const long double cx = pc[x_] - sx * pc[z_], cy = pc[y_] - sy * pc[z_];
  const long double u = cx * by - cy * bx, v = ax * cy - ay * cx, w = bx * ay - by * ax;
  const long double far = std::max({pa.cwiseAbs().maxCoeff(), pb.cwiseAbs().maxCoeff(), pc.cwiseAbs().maxCoeff()});
  const long double doubt = kRounding * far * far, sum = u + v + w;
  // Edge on, it is not crossed: its neighbours are.
  if (std::min({u, v, w}) < -doubt || !(sum > 0)) return kNever;
  const long double share = (u * pa[z_] + v * pb[z_] + w * pc[z_]) / sum / length;
  // The share lies between those of the corners, however doubtful it is. The ends are places in double precision.
  const long double slack = (48 * static_cast<long double>(std::numeric_limits<double>::epsilon()) * far +
                             kRounding * far * far * far / sum) /
                            std::abs(length);
  if (share < -slack || share > 1 + slack) return kNever;
  return static_cast<double>(std::clamp(share, 0.0L, 1.0L));
}

/// Splits sets of triangles until they are small.
struct TriangleTree::Builder {
  static constexpr std::uint32_t kLeaf = 4;  // triangles
  static constexpr int kBins = 16;
  static constexpr int kHalvesFrom = 16;  // depth from which on halves keep the tree flat

  struct Bounded {
    Box box;
    std::uint32_t triangle;
    [[nodiscard]] double centre(int axis) const { return 0.5 * (box.min[axis] + box.max[axis]); }
  };
  struct Range {
    std::uint32_t begin = 0, end = 0;
    int depth = 0;
    Box box, of_centres;
    [[nodiscard]] std::uint32_t size() const { return end - begin; }
  };

  Builder(TriangleTree& made, const TriangleMesh& mesh) : tree(made) {
    items.reserve(mesh.triangles.size());
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      Box box;
      for (const std::uint32_t corner : mesh.triangles[t]) box.include(mesh.vertices[corner]);
      items.push_back({box, t});
    }
    const Range all = range(0, static_cast<std::uint32_t>(items.size()), 0);
    tree.centre_ = all.box.center();
    // Wider than the roundings of boxes and places to single precision.
    tree.half_ = 0.5 * all.box.size();
    slack = std::ldexp(tree.half_.maxCoeff(), -20);
    tree.half_ += Vec3::Constant(slack);
    tree.nodes_.reserve(items.size() / 2);
    tree.nodes_.emplace_back();
    build(0, all);
  }

  [[nodiscard]] Range range(std::uint32_t begin, std::uint32_t end, int depth) const {
    Range made{begin, end, depth, {}, {}};
    for (std::uint32_t i = begin; i < end; ++i) {
      made.box.include(items[i].box);
      made.of_centres.include(0.5 * (items[i].box.min + items[i].box.max));
    }
    return made;
  }

  void build(std::uint32_t index, const Range& whole) {
    std::array<Range, kWide> parts{whole};
    std::size_t count = 1;
    while (count < kWide) {
      std::size_t largest = count;
      for (std::size_t i = 0; i < count; ++i)
        if (parts[i].size() > kLeaf && (largest == count || area_of(parts[i].box) * parts[i].size() >
                                                                area_of(parts[largest].box) * parts[largest].size()))
          largest = i;
      if (largest == count) break;
      const Range part = parts[largest];
      const std::uint32_t middle = split(part);
      parts[largest] = range(part.begin, middle, part.depth + 1);
      parts[count++] = range(middle, part.end, part.depth + 1);
    }
    constexpr float kNowhere = 1e30F;
    for (std::size_t i = 0; i < kWide; ++i) {
      const bool used = i < count && parts[i].size() > 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto lane = static_cast<int>(i), at = static_cast<int>(axis);
        Node& node = tree.nodes_[index];
        node.min[axis][lane] = used ? static_cast<float>(parts[i].box.min[at] - tree.centre_[at] - slack) : kNowhere;
        node.max[axis][lane] = used ? static_cast<float>(parts[i].box.max[at] - tree.centre_[at] + slack) : kNowhere;
      }
      if (!used) continue;
      if (parts[i].size() <= kLeaf) {
        tree.nodes_[index].first[i] = parts[i].begin;
        tree.nodes_[index].count[i] = parts[i].size();
        continue;
      }
      const auto child = static_cast<std::uint32_t>(tree.nodes_.size());
      tree.nodes_[index].first[i] = child;
      tree.nodes_.emplace_back();
      build(child, parts[i]);
    }
  }

  /// Orders the triangles of a set into two sets, and returns the first of the second.
  std::uint32_t split(const Range& part) {
    const auto first = items.begin() + part.begin, last = items.begin() + part.end;
    int axis = 0;
    const double size = part.of_centres.size().maxCoeff(&axis);
    if (size > 0 && part.depth < kHalvesFrom) {
      const double low = part.of_centres.min[axis], scale = kBins / size;
      const auto bin_of = [&](const Bounded& item) {
        return std::min(kBins - 1, static_cast<int>((item.centre(axis) - low) * scale));
      };
      std::array<Box, kBins> bins;
      std::array<std::uint32_t, kBins> counts{};
      for (auto at = first; at != last; ++at) {
        const auto bin = static_cast<std::size_t>(bin_of(*at));
        bins[bin].include(at->box);
        ++counts[bin];
      }
      std::array<double, kBins> left{};
      Box sum;
      std::uint32_t count = 0;
      for (std::size_t i = 0; i + 1 < kBins; ++i) {
        sum.include(bins[i]);
        count += counts[i];
        left[i] = area_of(sum) * count;
      }
      sum = {};
      count = 0;
      double best = std::numeric_limits<double>::infinity();
      int cut = -1;
      for (std::size_t i = kBins - 1; i > 0; --i) {
        sum.include(bins[i]);
        count += counts[i];
        const double cost = left[i - 1] + area_of(sum) * count;
        if (count == 0 || count == part.size() || !(cost < best)) continue;
        best = cost;
        cut = static_cast<int>(i);
      }
      if (cut > 0) {
        const auto middle = std::partition(first, last, [&](const Bounded& item) { return bin_of(item) < cut; });
        if (middle != first && middle != last) return static_cast<std::uint32_t>(middle - items.begin());
      }
    }
    const auto middle = first + (last - first) / 2;
    std::nth_element(first, middle, last,
                     [&](const Bounded& a, const Bounded& b) { return a.centre(axis) < b.centre(axis); });
    return static_cast<std::uint32_t>(middle - items.begin());
  }

  TriangleTree& tree;
  std::vector<Bounded> items;
  double slack = 0;
};

TriangleTree::TriangleTree(TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return;
  const Builder builder(*this, mesh);
  std::vector<std::array<std::uint32_t, 3>> sorted;
  sorted.reserve(mesh.triangles.size());
  faces_.reserve(mesh.triangles.size());
  for (const auto& item : builder.items) {
    const auto& t = sorted.emplace_back(mesh.triangles[item.triangle]);
    faces_.push_back(make_face(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
  }
  mesh.triangles = std::move(sorted);
}

TriangleTree::Nearest TriangleTree::nearest(const Vec3& place, double most2) const noexcept {
  Nearest best{.distance2 = most2, .triangle = 0, .point = {}};
  const Eigen::Vector3f at = local(place);
  float limit = rounded_up(most2);
  descend(
      limit, [&](const Node& node) { return distance2(node, at); },
      [&](std::uint32_t triangle) {
        const TrianglePoint point = closest_on(faces_[triangle], place);
        const double square = (point.position - place).squaredNorm();
        if (square < best.distance2) {
          best = {square, triangle, point};
          limit = rounded_up(square);
        }
        return limit;
      });
  return best;
}

int TriangleTree::winding(const Vec3& place) const noexcept {
  int sum = 0;
  const Eigen::Vector3f at = local(place);
  // A ray along z: of boxes that it meets, the key is 0.
  const auto keys = [&](const Node& node) {
    constexpr float kNever = std::numeric_limits<float>::infinity();
    return ((node.min[0] <= at.x()) && (node.max[0] >= at.x()) && (node.min[1] <= at.y()) && (node.max[1] >= at.y()) &&
            (node.max[2] >= at.z()))
        .select(Lanes::Zero(), Lanes::Constant(kNever));
  };
  descend(0.0F, keys, [&](std::uint32_t triangle) {
    const Face& face = faces_[triangle];
    const Vec3 a = face.corners[0] - place, b = face.corners[1] - place, c = face.corners[2] - place;
    const int over_ab = side_of_line(a.x(), a.y(), b.x(), b.y()), over_bc = side_of_line(b.x(), b.y(), c.x(), c.y());
    if (over_ab == 0 || over_bc != over_ab || side_of_line(c.x(), c.y(), a.x(), a.y()) != over_ab) return 0.0F;
    // The ray's line goes through: in front of the place, or behind it.
    const double wa = b.x() * c.y() - b.y() * c.x(), wb = c.x() * a.y() - c.y() * a.x(),
                 wc = a.x() * b.y() - a.y() * b.x();
    const double height = (wa * a.z() + wb * b.z() + wc * c.z()) * over_ab;
    sum += height >= 0 ? over_ab : 0;
    return 0.0F;
  });
  return sum;
}

}  // namespace haptrace
