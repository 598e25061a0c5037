#include "scene/shape/level_set.h"

#include "scene/shape/sign_change.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <unordered_map>

namespace haptrace {
namespace {

/// A cube in six tetrahedra round its diagonal, in steps along the axes: neighbours share the diagonals of their sides.
constexpr std::array<std::array<unsigned, 4>, 6> kTetrahedra{
    {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}}};

constexpr double kFromCorner = 1e-3;  // of an edge, so that no triangle shrinks to a point

class Marching {
 public:
  Marching(const std::function<double(const Vec3&)>& f, const Box& box, const std::array<int, 3>& cells)
      : f_(f), box_(box), cells_(cells) {
    for (int k = 0; k <= cells_[2]; ++k)
      for (int j = 0; j <= cells_[1]; ++j)
        for (int i = 0; i <= cells_[0]; ++i) values_.push_back(f_(place({i, j, k})));
  }

  TriangleMesh mesh() {
    for (int k = 0; k < cells_[2]; ++k)
      for (int j = 0; j < cells_[1]; ++j)
        for (int i = 0; i < cells_[0]; ++i) cube(i, j, k);
    return std::move(mesh_);
  }

 private:
  using Corner = std::array<int, 3>;

  [[nodiscard]] std::size_t index(const Corner& c) const {
    return static_cast<std::size_t>(c[0]) +
           static_cast<std::size_t>(cells_[0] + 1) *
               (static_cast<std::size_t>(c[1]) +
                static_cast<std::size_t>(cells_[1] + 1) * static_cast<std::size_t>(c[2]));
  }
  [[nodiscard]] Vec3 place(const Corner& c) const {
    return box_.min +
           box_.size().cwiseProduct(Vec3(static_cast<double>(c[0]) / cells_[0], static_cast<double>(c[1]) / cells_[1],
                                         static_cast<double>(c[2]) / cells_[2]));
  }
  [[nodiscard]] bool inside(const Corner& c) const { return values_[index(c)] < 0; }

  void cube(int i, int j, int k) {
    std::array<Corner, 8> corners{};
    unsigned in = 0;
    for (unsigned c = 0; c < 8; ++c) {
      corners[c] = {i + static_cast<int>(c & 1U), j + static_cast<int>(c >> 1U & 1U), k + static_cast<int>(c >> 2U)};
      in |= (inside(corners[c]) ? 1U : 0U) << c;
    }
    if (in == 0 || in == 255) return;
    for (const auto& four : kTetrahedra) {
      std::array<Corner, 4> t{};
      std::size_t count = 0;  // inside, first in t
      for (const unsigned c : four)
        if ((in >> c & 1U) != 0) t[count++] = corners[c];
      std::size_t out = count;
      for (const unsigned c : four)
        if ((in >> c & 1U) == 0) t[out++] = corners[c];
      if (count == 1) {
        triangle(t, on(t[0], t[1]), on(t[0], t[2]), on(t[0], t[3]));
      } else if (count == 3) {
        triangle(t, on(t[0], t[3]), on(t[1], t[3]), on(t[2], t[3]));
      } else if (count == 2) {
        const std::uint32_t a = on(t[0], t[2]), b = on(t[0], t[3]), c = on(t[1], t[3]), d = on(t[1], t[2]);
        triangle(t, a, b, c);
        triangle(t, a, c, d);
      }
    }
  }

  /// Adds a triangle that looks from the first corner, which is inside, to the last, which is outside.
  void triangle(const std::array<Corner, 4>& t, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const Vec3 &p = mesh_.vertices[a], &q = mesh_.vertices[b], &r = mesh_.vertices[c];
    const Vec3 normal = (q - p).cross(r - p);
    // The inside corner is behind the plane, or the outside one in front of it.
    const double side = normal.dot(place(t[3]) - p) - normal.dot(place(t[0]) - p);
    if (side < 0) std::swap(b, c);
    mesh_.triangles.push_back({a, b, c});
  }

  /// Returns the vertex on an edge of the grid, from a corner inside to one outside.
  std::uint32_t on(const Corner& in, const Corner& out) {
    const std::uint64_t a = index(in), b = index(out);
    const auto [entry, is_new] = vertices_.try_emplace(std::min(a, b) << 32U | std::max(a, b),
                                                       static_cast<std::uint32_t>(mesh_.vertices.size()));
    if (!is_new) return entry->second;
    const Vec3 from = place(in), way = place(out) - from;
    const auto [inside, outside] =
        narrow([&](double t) { return f_(from + t * way); }, {.in = 0, .out = 1}, values_[a], values_[b], 1e-9, 40);
    mesh_.vertices.push_back(from + std::clamp(0.5 * (inside + outside), kFromCorner, 1 - kFromCorner) * way);
    return entry->second;
  }

  const std::function<double(const Vec3&)>& f_;
  Box box_;
  std::array<int, 3> cells_;
  std::vector<double> values_;
  std::unordered_map<std::uint64_t, std::uint32_t> vertices_;
  TriangleMesh mesh_;
};

}  // namespace

TriangleMesh level_set(const std::function<double(const Vec3&)>& f, const Box& box, const std::array<int, 3>& cells) {
  return Marching(f, box, cells).mesh();
}

}  // namespace haptrace
