#include "scene/shape/sphere.h"

#include "base/error.h"
#include "scene/shape/grid_mesh.h"

#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kMinRadius = 1e-6, kMaxRadius = 100;  // [m]
constexpr double kMaxCentre = 100;                     // [m], of each coordinate
constexpr double kCentre2 = 1e-24;                     // squared distance below which the tool is at the centre [m^2]

}  // namespace

Sphere::Sphere(const SphereSpec& spec) : spec_(spec) {
  for (int axis = 0; axis < 3; ++axis) check_range("centre", spec.centre[axis], -kMaxCentre, kMaxCentre, "m");
  check_range("radius", spec.radius, kMinRadius, kMaxRadius, "m");
  check_range("renew", spec.renew, 0, spec.radius, "m");
}

void Sphere::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (!((step.to - proxy.memory.place).squaredNorm() < proxy.memory.value[0])) renew(step.to, proxy);
  const double radius = spec_.radius + step.radius;
  proxy.depth = radius - proxy.normal.dot(step.to - spec_.centre);
  proxy.position = step.to + proxy.depth * proxy.normal;
  const bool before = proxy.touching;
  proxy.touching = proxy.depth > (before ? -step.reach : 0);
  proxy.began_inside = proxy.touching && (before ? proxy.began_inside : !proxy.known && std::isnan(step.from.x()));
  proxy.known = true;
}

void Sphere::renew(const Vec3& place, Proxy& proxy) const noexcept {
  const Vec3 radius = place - spec_.centre;
  const double square = radius.squaredNorm();
  proxy.memory.place = place;
  proxy.memory.value[0] = std::min(spec_.renew * spec_.renew, 0.25 * square);
  if (square > kCentre2)
    proxy.normal = radius / std::sqrt(square);
  else if (!proxy.known)
    proxy.normal = Vec3::UnitZ();
}

SurfacePoint Sphere::nearest(const Vec3& place) const noexcept {
  const Vec3 radius = place - spec_.centre;
  const double distance = radius.norm();
  const Vec3 normal = distance * distance > kCentre2 ? Vec3(radius / distance) : Vec3::UnitZ();
  return {spec_.centre + spec_.radius * normal, normal, distance - spec_.radius};
}

Eigen::Matrix3d Sphere::slide(const Proxy& proxy) const noexcept {
  const double radius = (proxy.position - spec_.centre).dot(proxy.normal), inside = radius - proxy.depth;
  const double share = spec_.renew > 0 ? 1 : radius / std::max(inside, 1e-3 * radius);
  return share * Shape::slide(proxy);
}

Box Sphere::bounds() const noexcept {
  return {spec_.centre - Vec3::Constant(spec_.radius), spec_.centre + Vec3::Constant(spec_.radius)};
}

bool Sphere::meets(const Box& space) const noexcept {
  return (spec_.centre - spec_.centre.cwiseMax(space.min).cwiseMin(space.max)).norm() < spec_.radius;
}

TriangleMesh Sphere::tessellated(double tolerance, const Box&) const {
  // The middle of an edge of angle a is R (1 - cos(a / 2)) inside; that of a cell is up to twice as far.
  const double angle = 2 * std::acos(1 - std::min(0.5, tolerance / (2 * spec_.radius)));
  const auto turns = static_cast<int>(std::ceil(2 * std::numbers::pi / angle));
  return grid_mesh(turns, (turns + 1) / 2, GridEnds{.wraps_u = true}, [&](double u, double v) -> Vec3 {
    const double along = 2 * std::numbers::pi * u, up = std::numbers::pi * (v - 0.5);
    return spec_.centre +
           spec_.radius * Vec3(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up));
  });
}

std::vector<Knob> Sphere::knobs() const {
  return {{"renew", "m", {spec_.radius / 5, spec_.radius / 20, 0}, spec_.renew, 0, spec_.radius}};
}

void Sphere::set(const std::string& knob, double level) {
  if (knob == "renew") spec_.renew = level;
}

std::unique_ptr<Shape> read_sphere(JsonReader& reader) {
  SphereSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kMaxCentre, kMaxCentre);
  spec.radius = reader.require("radius").length("radius", 0, kMinRadius, kMaxRadius);
  spec.renew = reader.number("renew", 0, 0, spec.radius);
  return std::make_unique<Sphere>(spec);
}

}  // namespace haptrace
