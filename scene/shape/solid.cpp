#include "scene/shape/solid.h"

#include "base/error.h"
#include "scene/shape/grid_mesh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {

Solid::Solid(const Vec3& centre) : centre_(centre) {
  for (int axis = 0; axis < 3; ++axis) check_range("centre", centre[axis], -kFarthestCentre, kFarthestCentre, "m");
}

void Solid::stand(const SurfacePoint& foot, const ToolStep& step, Proxy& proxy) const noexcept {
  proxy.normal = foot.normal;
  proxy.depth = step.radius - foot.distance;
  proxy.position = centre_ + foot.position + step.radius * foot.normal;
  const bool before = proxy.touching;
  proxy.touching = proxy.depth > (before ? -step.reach : 0);
  proxy.began_inside = proxy.touching && (before ? proxy.began_inside : !proxy.known && std::isnan(step.from.x()));
  proxy.known = true;
}

SurfacePoint Solid::nearest(const Vec3& place) const noexcept {
  SurfacePoint point = closest(place - centre_);
  point.position += centre_;
  return point;
}

Eigen::Matrix3d Solid::slide(const Proxy& proxy) const noexcept {
  constexpr double kLeast = 1e-3;  // the proxy runs away where the tool reaches the centre of curvature
  const Curvature bent = curvature(proxy.position - centre_, proxy.normal);
  const auto share = [&](double k) { return 1 / std::max(kLeast, 1 - proxy.depth * k); };
  const Vec3 across = proxy.normal.cross(bent.along);
  return share(bent.of_along) * bent.along * bent.along.transpose() +
         share(bent.of_across) * across * across.transpose();
}

Box Solid::bounds() const noexcept {
  const Box own = extent();
  return {own.min + centre_, own.max + centre_};
}

bool Solid::meets(const Box& space) const noexcept {
  return overlaps({space.min - centre_, space.max - centre_});
}

TriangleMesh Solid::tessellated(double tolerance, const Box&) const {
  TriangleMesh triangles = mesh(tolerance);
  for (Vec3& vertex : triangles.vertices) vertex += centre_;
  return triangles;
}

void Convex::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  const Vec3 place = step.to - centre_;
  Face& face = proxy.memory.index[0];
  if (face == 0) {
    if (!std::isnan(step.from.x())) face = entered(step.from - centre_, place);
    // Rounding: the step's end may be inside where its crossing was not seen.
    if (face == 0) face = face_at(place);
  }
  SurfacePoint foot;
  if (face == 0 || !held(face, place, proxy.normal, foot)) {
    face = 0;
    foot = outside(place);
  }
  stand(foot, step, proxy);
}

SurfacePoint Convex::closest(const Vec3& place) const noexcept {
  SurfacePoint foot;
  Face face = face_at(place);
  return face != 0 && held(face, place, Vec3::Zero(), foot) ? foot : outside(place);
}

void Chord::keep_slab(double place, double step, double least, double most, std::uint32_t face_least,
                      std::uint32_t face_most) noexcept {
  if (step > 0)
    keep((least - place) / step, (most - place) / step, face_least);
  else if (step < 0)
    keep((most - place) / step, (least - place) / step, face_most);
  else if (!(place > least && place < most))
    keep_nothing();
}

void Chord::keep_quadric(double a, double b, double c, std::uint32_t face) noexcept {
  const double square = b * b - a * c;
  if (!(a > 0) || !std::isfinite(square)) {
    if (!(c < 0)) keep_nothing();
    return;
  }
  if (!(square > 0)) return keep_nothing();
  const double sum = b < 0 ? -b + std::sqrt(square) : -b - std::sqrt(square);
  const double one = sum / a, other = c / sum;
  keep(std::min(one, other), std::max(one, other), face);
}

Meridian::Meridian(const Vec3& place, const Vec3& normal, double size) noexcept
    : rho(std::hypot(place.x(), place.y())), z(place.z()) {
  constexpr double kAxis = 1e-12;  // of the size: nearer to the axis, rounding decides about the direction
  const double across = std::hypot(normal.x(), normal.y());
  if (rho > kAxis * size)
    out = Vec3(place.x() / rho, place.y() / rho, 0);
  else if (across > kAxis)
    out = Vec3(normal.x() / across, normal.y() / across, 0);
  else
    out = rho > 0 ? Vec3(place.x() / rho, place.y() / rho, 0) : Vec3(Vec3::UnitX());
}

double curvature_around(const Vec3& place, const Vec3& normal) noexcept {
  const double square = place.x() * place.x() + place.y() * place.y();
  return square > 0 ? (place.x() * normal.x() + place.y() * normal.y()) / square : 0;
}

Vec3 direction_around(const Vec3& place) noexcept {
  const double rho = std::hypot(place.x(), place.y());
  return rho > 0 ? Vec3(-place.y() / rho, place.x() / rho, 0) : Vec3(Vec3::UnitY());
}

std::pair<double, double> range_of_rho(const Box& box) noexcept {
  const double x = std::max({0.0, box.min.x(), -box.max.x()}), y = std::max({0.0, box.min.y(), -box.max.y()});
  const double far_x = std::max(-box.min.x(), box.max.x()), far_y = std::max(-box.min.y(), box.max.y());
  return {std::hypot(x, y), std::hypot(far_x, far_y)};
}

int chords_of_circle(double radius, double tolerance) {
  constexpr int kLeast = 8, kMost = 8192;
  const double angle = 2 * std::acos(1 - std::min(0.5, std::max(0.0, tolerance / radius)));
  const double chords = angle > 0 ? std::ceil(2 * std::numbers::pi / angle) : kMost;
  return static_cast<int>(std::clamp<double>(chords, kLeast, kMost));
}

TriangleMesh revolved(std::span<const Vec3> profile, int chords) {
  const int parts = static_cast<int>(profile.size()) - 1;
  return grid_mesh(chords, parts, {.wraps_u = true}, [&](double u, double v) -> Vec3 {
    const Vec3& point = profile[static_cast<std::size_t>(std::lround(v * parts))];
    const double angle = 2 * std::numbers::pi * u;
    return {point.x() * std::cos(angle), point.x() * std::sin(angle), point.z()};
  });
}

}  // namespace haptrace
