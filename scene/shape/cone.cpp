#include "scene/shape/cone.h"

#include "base/error.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace haptrace {
namespace {

enum : std::uint32_t { kBase = 1, kFlank };

}  // namespace

Cone::Cone(const ConeSpec& spec)
    : Convex(spec.centre),
      radius_(spec.radius),
      height_(spec.height),
      length_(std::hypot(spec.radius, spec.height)),
      out_(spec.height / length_),
      up_(spec.radius / length_) {
  check_range("radius", spec.radius, kMinLength, kMaxLength, "m");
  check_range("height", spec.height, kMinLength, kMaxLength, "m");
}

double Cone::over(const Meridian& seen) const noexcept {
  return out_ * (seen.rho - radius_) + up_ * seen.z;
}

double Cone::along(const Meridian& seen) const noexcept {
  return up_ * (radius_ - seen.rho) + out_ * seen.z;
}

Convex::Face Cone::entered(const Vec3& from, const Vec3& to) const noexcept {
  const Vec3 step = to - from;
  // Along the step, the cone is as wide as w(t) = width + t narrower; only its nappe below the apex counts, w > 0.
  const double rho = std::hypot(from.x(), from.y());
  const double width = radius_ * (1 - from.z() / height_), narrower = -radius_ / height_ * step.z();
  const double a = step.x() * step.x() + step.y() * step.y() - narrower * narrower;
  const double b = from.x() * step.x() + from.y() * step.y() - width * narrower;
  const double c = (rho - width) * (rho + width);
  Chord chord;
  chord.keep_slab(from.z(), step.z(), 0, height_, kBase, kFlank);
  if (a > 0 || narrower == 0) {
    chord.keep_quadric(a, b, c, kFlank);
    return chord.face();
  }
  // A step that is steeper than the flank is inside from where it crosses the flank, or up to there.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double root = std::sqrt(std::max(0.0, b * b - a * c));
  const double sum = b < 0 ? -b + root : -b - root;
  const double one = a < 0 ? sum / a : (narrower > 0 ? -kInfinity : kInfinity), other = sum != 0 ? c / sum : 0;
  if (narrower > 0)
    chord.keep(std::max(one, other), kInfinity, kFlank);
  else
    chord.keep(-kInfinity, std::min(one, other), kFlank);
  return chord.face();
}

Convex::Face Cone::face_at(const Vec3& place) const noexcept {
  const double flank = -over(Meridian(place, Vec3::Zero(), radius_)), base = place.z();
  if (!(flank > 0 && base > 0)) return 0;
  return flank <= base ? kFlank : kBase;
}

bool Cone::held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept {
  const Meridian seen(place, normal, radius_);
  if (face == kBase) {
    if (!(seen.z > 0 && seen.rho <= radius_)) return false;
    foot = {Vec3(place.x(), place.y(), 0), -Vec3::UnitZ(), -seen.z};
    return true;
  }
  const double distance = over(seen);
  if (!(distance < 0 && along(seen) >= 0)) return false;
  foot.normal = seen.vector(out_, up_);
  foot.position = place - distance * foot.normal;
  foot.distance = distance;
  return true;
}

SurfacePoint Cone::outside(const Vec3& place) const noexcept {
  const Meridian seen(place, Vec3::Zero(), radius_);
  const double s = along(seen);
  if (seen.z <= 0 && seen.rho <= radius_) return {Vec3(place.x(), place.y(), 0), -Vec3::UnitZ(), -seen.z};
  const Vec3 flank = seen.vector(out_, up_);
  if (s > 0 && s < length_) {
    const double distance = std::max(0.0, over(seen));
    return {place - distance * flank, flank, distance};
  }
  const double rho = s > 0 ? 0 : radius_, z = s > 0 ? height_ : 0;
  const double distance = std::hypot(seen.rho - rho, seen.z - z);
  return {seen.vector(rho, z), distance > 0 ? seen.vector((seen.rho - rho) / distance, (seen.z - z) / distance) : flank,
          distance};
}

Curvature Cone::curvature(const Vec3& proxy, const Vec3& normal) const noexcept {
  const Meridian seen(proxy, normal, radius_);
  const double s = along(seen);
  Curvature bent{.along = direction_around(proxy), .of_along = curvature_around(proxy, normal)};
  const bool base = seen.z <= 0 && seen.rho <= radius_;
  if (s <= 0 && !base) {
    if (const double round = std::hypot(seen.rho - radius_, seen.z); round > 0) bent.of_across = 1 / round;
  } else if (s > length_) {
    if (const double round = std::hypot(seen.rho, seen.z - height_); round > 0) bent.of_across = 1 / round;
    if (seen.rho == 0) bent.of_along = bent.of_across;
  }
  return bent;
}

Box Cone::extent() const noexcept {
  return {Vec3(-radius_, -radius_, 0), Vec3(radius_, radius_, height_)};
}

bool Cone::overlaps(const Box& box) const noexcept {
  const double lowest = std::max(0.0, box.min.z());
  return lowest < height_ && box.max.z() > 0 && range_of_rho(box).first < radius_ * (1 - lowest / height_);
}

TriangleMesh Cone::mesh(double tolerance) const {
  const std::array<Vec3, 3> profile{Vec3(0, 0, 0), Vec3(radius_, 0, 0), Vec3(0, 0, height_)};
  return revolved(profile, chords_of_circle(radius_, tolerance));
}

std::unique_ptr<Shape> read_cone(JsonReader& reader) {
  ConeSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kFarthestCentre, kFarthestCentre);
  spec.radius = reader.require("radius").length("radius", 0, kMinLength, kMaxLength);
  spec.height = reader.require("height").length("height", 0, kMinLength, kMaxLength);
  return std::make_unique<Cone>(spec);
}

}  // namespace haptrace
