#include "scene/shape/box.h"

#include "base/error.h"

#include <cmath>

namespace haptrace {
namespace {

// Faces: 1 + 2 axis + (1: the one at the greater coordinate).
int axis_of(std::uint32_t face) noexcept {
  return static_cast<int>((face - 1) / 2);
}
double side_of(std::uint32_t face) noexcept {
  return (face - 1) % 2 == 1 ? 1 : -1;
}
std::uint32_t face_of(int axis, double side) noexcept {
  return 1 + 2 * static_cast<std::uint32_t>(axis) + (side > 0 ? 1 : 0);
}

}  // namespace

BoxShape::BoxShape(const BoxSpec& spec) : Convex(spec.centre), half_(0.5 * spec.size) {
  for (int axis = 0; axis < 3; ++axis) check_range("size", spec.size[axis], kMinLength, kMaxLength, "m");
}

Convex::Face BoxShape::entered(const Vec3& from, const Vec3& to) const noexcept {
  Chord chord;
  for (int axis = 0; axis < 3; ++axis)
    chord.keep_slab(from[axis], to[axis] - from[axis], -half_[axis], half_[axis], face_of(axis, -1), face_of(axis, 1));
  return chord.face();
}

Convex::Face BoxShape::face_at(const Vec3& place) const noexcept {
  int axis = 0;
  if (!((half_ - place.cwiseAbs()).minCoeff(&axis) > 0)) return 0;
  return face_of(axis, place[axis]);
}

bool BoxShape::held(Face& face, const Vec3& place, const Vec3&, SurfacePoint& foot) const noexcept {
  const int axis = axis_of(face), b = (axis + 1) % 3, c = (axis + 2) % 3;
  const double side = side_of(face), distance = side * place[axis] - half_[axis];
  if (!(distance < 0 && std::abs(place[b]) <= half_[b] && std::abs(place[c]) <= half_[c])) return false;
  foot.position = place;
  foot.position[axis] = side * half_[axis];
  foot.normal = side * Vec3::Unit(axis);
  foot.distance = distance;
  return true;
}

SurfacePoint BoxShape::outside(const Vec3& place) const noexcept {
  SurfacePoint foot;
  foot.position = place.cwiseMax(-half_).cwiseMin(half_);
  const Vec3 away = place - foot.position;
  foot.distance = away.norm();
  if (foot.distance > 0) {
    foot.normal = away / foot.distance;
  } else {
    int axis = 0;
    (place.cwiseAbs() - half_).maxCoeff(&axis);
    foot.normal = (place[axis] > 0 ? 1 : -1) * Vec3::Unit(axis);
  }
  return foot;
}

Curvature BoxShape::curvature(const Vec3& proxy, const Vec3& normal) const noexcept {
  // Each coordinate beyond the box rounds the surface: one over a face, two over an edge, three over a corner.
  const Vec3 away = proxy - proxy.cwiseMax(-half_).cwiseMin(half_);
  const double round = away.norm();
  const auto beyond = (away.array() != 0).count();
  if (beyond < 2) return {.along = normal.unitOrthogonal()};
  if (beyond == 3) return {.along = normal.unitOrthogonal(), .of_along = 1 / round, .of_across = 1 / round};
  int edge = 0;
  away.cwiseAbs().minCoeff(&edge);
  return {.along = Vec3::Unit(edge), .of_across = 1 / round};
}

Box BoxShape::extent() const noexcept {
  return {-half_, half_};
}

bool BoxShape::overlaps(const Box& box) const noexcept {
  return (box.min.array() < half_.array()).all() && (box.max.array() > -half_.array()).all();
}

TriangleMesh BoxShape::mesh(double) const {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.push_back(half_.cwiseProduct(Vec3(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1)));
  for (std::uint32_t axis = 0; axis < 3; ++axis) {
    const std::uint32_t a = 1U << axis, b = 1U << (axis + 1) % 3, c = 1U << (axis + 2) % 3;
    mesh.triangles.push_back({a, a | b, a | b | c});
    mesh.triangles.push_back({a, a | b | c, a | c});
    mesh.triangles.push_back({0, b | c, b});
    mesh.triangles.push_back({0, c, b | c});
  }
  return mesh;
}

std::unique_ptr<Shape> read_box(JsonReader& reader) {
  BoxSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kFarthestCentre, kFarthestCentre);
  spec.size = reader.require("size").vector("size", spec.size, kMinLength, kMaxLength);
  return std::make_unique<BoxShape>(spec);
}

}  // namespace haptrace
