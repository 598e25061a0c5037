#include "scene/shape/cylinder.h"

#include "base/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

enum : std::uint32_t { kBottom = 1, kTop, kSide };

}  // namespace

Cylinder::Cylinder(const CylinderSpec& spec) : Convex(spec.centre), radius_(spec.radius), half_(0.5 * spec.height) {
  check_range("radius", spec.radius, kMinLength, kMaxLength, "m");
  check_range("height", spec.height, kMinLength, kMaxLength, "m");
}

Convex::Face Cylinder::entered(const Vec3& from, const Vec3& to) const noexcept {
  const Vec3 step = to - from;
  const double rho = std::hypot(from.x(), from.y());
  Chord chord;
  chord.keep_slab(from.z(), step.z(), -half_, half_, kBottom, kTop);
  chord.keep_quadric(step.x() * step.x() + step.y() * step.y(), from.x() * step.x() + from.y() * step.y(),
                     (rho - radius_) * (rho + radius_), kSide);
  return chord.face();
}

Convex::Face Cylinder::face_at(const Vec3& place) const noexcept {
  const double side = radius_ - std::hypot(place.x(), place.y()), cap = half_ - std::abs(place.z());
  if (!(side > 0 && cap > 0)) return 0;
  if (side < cap) return kSide;
  return place.z() > 0 ? kTop : kBottom;
}

bool Cylinder::held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept {
  const Meridian seen(place, normal, radius_);
  if (face == kSide) {
    if (!(seen.rho < radius_ && std::abs(seen.z) <= half_)) return false;
    foot = {seen.vector(radius_, seen.z), seen.out, seen.rho - radius_};
    return true;
  }
  const double side = face == kTop ? 1 : -1;
  if (!(side * seen.z < half_ && seen.rho <= radius_)) return false;
  foot = {Vec3(place.x(), place.y(), side * half_), side * Vec3::UnitZ(), side * seen.z - half_};
  return true;
}

SurfacePoint Cylinder::outside(const Vec3& place) const noexcept {
  const Meridian seen(place, Vec3::Zero(), radius_);
  const double rho = std::min(seen.rho, radius_), z = std::clamp(seen.z, -half_, half_);
  const double distance = std::hypot(seen.rho - rho, seen.z - z);
  SurfacePoint foot{seen.vector(rho, z), seen.out, distance};
  if (distance > 0)
    foot.normal = seen.vector((seen.rho - rho) / distance, (seen.z - z) / distance);
  else if (seen.rho < radius_)
    foot.normal = (z > 0 ? 1 : -1) * Vec3::UnitZ();
  return foot;
}

Curvature Cylinder::curvature(const Vec3& proxy, const Vec3& normal) const noexcept {
  const double beyond = std::hypot(proxy.x(), proxy.y()) - radius_, above = std::abs(proxy.z()) - half_;
  return {.along = direction_around(proxy),
          .of_along = curvature_around(proxy, normal),
          .of_across = beyond > 0 && above > 0 ? 1 / std::hypot(beyond, above) : 0};
}

Box Cylinder::extent() const noexcept {
  const Vec3 reach(radius_, radius_, half_);
  return {-reach, reach};
}

bool Cylinder::overlaps(const Box& box) const noexcept {
  return box.min.z() < half_ && box.max.z() > -half_ && range_of_rho(box).first < radius_;
}

TriangleMesh Cylinder::mesh(double tolerance) const {
  const std::array<Vec3, 4> profile{Vec3(0, 0, -half_), Vec3(radius_, 0, -half_), Vec3(radius_, 0, half_),
                                    Vec3(0, 0, half_)};
  return revolved(profile, chords_of_circle(radius_, tolerance));
}

std::unique_ptr<Shape> read_cylinder(JsonReader& reader) {
  CylinderSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kFarthestCentre, kFarthestCentre);
  spec.radius = reader.require("radius").length("radius", 0, kMinLength, kMaxLength);
  spec.height = reader.require("height").length("height", 0, kMinLength, kMaxLength);
  return std::make_unique<Cylinder>(spec);
}

}  // namespace haptrace
