#include "formats/mesh/polygon.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace haptrace {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double kFlat = 1e-12;  // area over the square of the size, below which rounding decides

double cross(const Vec2& a, const Vec2& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// Returns the corners in the plane of the polygon, anticlockwise.
std::vector<Vec2> flattened(std::span<const Vec3> corners) {
  Vec3 normal = Vec3::Zero();  // Newell's: the largest of the polygon's shadows
  for (std::size_t i = 0; i < corners.size(); ++i)
    normal += (corners[i] - corners[0]).cross(corners[(i + 1) % corners.size()] - corners[0]);
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  const double turn = normal[axis] < 0 ? -1 : 1;
  std::vector<Vec2> flat;
  flat.reserve(corners.size());
  for (const Vec3& corner : corners) {
    const Vec3 from = corner - corners[0];
    flat.emplace_back(from[(axis + 1) % 3], turn * from[(axis + 2) % 3]);
  }
  return flat;
}

}  // namespace

std::vector<std::array<std::uint32_t, 3>> triangles_of(std::span<const Vec3> corners) {
  std::vector<std::array<std::uint32_t, 3>> triangles;
  if (corners.size() < 3) return triangles;
  if (corners.size() == 3) return {{0, 1, 2}};
  const std::vector<Vec2> flat = flattened(corners);
  std::vector<std::uint32_t> left(corners.size());
  std::iota(left.begin(), left.end(), 0U);

  // An ear is a convex corner whose triangle holds no other corner. Points on its sides count, too: a cut through a
  // corner would leave a triangle without an area.
  const auto is_ear = [&](std::size_t at) {
    const std::size_t n = left.size();
    const Vec2 &a = flat[left[(at + n - 1) % n]], &b = flat[left[at]], &c = flat[left[(at + 1) % n]];
    const double slack = kFlat * std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
    if (!(cross(b - a, c - b) > slack)) return false;
    return std::none_of(left.begin(), left.end(), [&](std::uint32_t other) {
      const Vec2& p = flat[other];
      if (p == a || p == b || p == c) return false;
      return cross(b - a, p - a) >= -slack && cross(c - b, p - b) >= -slack && cross(a - c, p - c) >= -slack;
    });
  };
  // A quadrilateral is cut along its shorter diagonal, where it is convex.
  std::size_t at = corners.size() == 4 && (corners[0] - corners[2]).norm() < (corners[1] - corners[3]).norm() ? 1 : 0;
  while (left.size() > 3) {
    const std::size_t n = left.size();
    std::size_t ear = at;
    for (std::size_t tries = 0; tries < n && !is_ear(ear); ++tries) ear = (ear + 1) % n;
    triangles.push_back({left[(ear + n - 1) % n], left[ear], left[(ear + 1) % n]});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(ear));
    at = ear % left.size();
  }
  triangles.push_back({left[0], left[1], left[2]});
  return triangles;
}

}  // namespace haptrace
