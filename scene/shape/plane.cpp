#include "scene/shape/plane.h"

#include "base/error.h"

#include <array>
#include <cmath>
#include <limits>

namespace haptrace {
namespace {

constexpr double kMaxPoint = 100;                      // [m], of each coordinate
constexpr double kMinNormal = 1e-6, kMaxNormal = 1e6;  // length

/// Returns the part of a convex polygon with d(corner) <= 0.
std::vector<Vec3> clipped(const std::vector<Vec3>& polygon, const std::function<double(const Vec3&)>& d) {
  std::vector<Vec3> kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec3 &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double at_a = d(a), at_b = d(b);
    if (at_a <= 0) kept.push_back(a);
    if ((at_a < 0 && at_b > 0) || (at_a > 0 && at_b < 0)) kept.push_back(a + at_a / (at_a - at_b) * (b - a));
  }
  return kept;
}

}  // namespace

Plane::Plane(const PlaneSpec& spec) {
  for (int axis = 0; axis < 3; ++axis) check_range("point", spec.point[axis], -kMaxPoint, kMaxPoint, "m");
  check_range("the length of normal", spec.normal.stableNorm(), kMinNormal, kMaxNormal);
  normal_ = spec.normal.stableNormalized();
  height_ = normal_.dot(spec.point);
}

void Plane::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  proxy.normal = normal_;
  proxy.depth = height_ + step.radius - normal_.dot(step.to);
  proxy.position = step.to + proxy.depth * normal_;
  const bool before = proxy.touching;
  proxy.touching = proxy.depth > (before ? -step.reach : 0);
  proxy.began_inside = proxy.touching && (before ? proxy.began_inside : !proxy.known && std::isnan(step.from.x()));
  proxy.known = true;
}

SurfacePoint Plane::nearest(const Vec3& place) const noexcept {
  const double distance = normal_.dot(place) - height_;
  return {place - distance * normal_, normal_, distance};
}

Box Plane::bounds() const noexcept {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  return {Vec3::Constant(-kInfinity), Vec3::Constant(kInfinity)};
}

bool Plane::meets(const Box& space) const noexcept {
  const Vec3 deepest = (normal_.array() > 0).select(space.min, space.max);
  return normal_.dot(deepest) < height_;
}

TriangleMesh Plane::tessellated(double, const Box& space) const {
  const Vec3 middle = space.center(), foot = middle + (height_ - normal_.dot(middle)) * normal_;
  const Vec3 across = normal_.unitOrthogonal(), along = normal_.cross(across);
  const double far = space.size().norm() + (foot - middle).norm();
  std::vector<Vec3> polygon{foot + far * (across + along), foot + far * (along - across), foot - far * (across + along),
                            foot + far * (across - along)};
  for (int axis = 0; axis < 3; ++axis) {
    polygon = clipped(polygon, [&](const Vec3& p) { return p[axis] - space.max[axis]; });
    polygon = clipped(polygon, [&](const Vec3& p) { return space.min[axis] - p[axis]; });
  }
  TriangleMesh mesh{.vertices = polygon, .triangles = {}};
  for (std::uint32_t i = 2; i < polygon.size(); ++i) mesh.triangles.push_back({0, i - 1, i});
  return mesh;
}

std::unique_ptr<Shape> read_plane(JsonReader& reader) {
  PlaneSpec spec;
  spec.point = reader.require("point").vector("point", spec.point, -kMaxPoint, kMaxPoint);
  spec.normal = reader.require("normal").vector("normal", spec.normal, -kMaxNormal, kMaxNormal);
  if (!(spec.normal.stableNorm() >= kMinNormal))
    throw input_error(reader.where() + ".normal: the vector has no direction");
  spec.normal.stableNormalize();
  return std::make_unique<Plane>(spec);
}

}  // namespace haptrace
