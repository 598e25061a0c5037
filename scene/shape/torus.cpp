#include "scene/shape/torus.h"

#include "base/error.h"
#include "scene/shape/grid_mesh.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

// Side of the hole from which the tool came.
enum : std::uint32_t { kNoSide = 0, kLower, kUpper };

constexpr double kNothing = 1e-12;  // of the tube: nearer to its middle, rounding decides about the direction

}  // namespace

Torus::Torus(const TorusSpec& spec) : Solid(spec.centre), radius_(spec.radius), tube_(spec.tube) {
  check_range("radius", spec.radius, kMinLength, kMaxLength, "m");
  check_range("tube", spec.tube, kMinLength, kMaxLength, "m");
  if (!(tube_ < radius_))
    throw input_error(fmt::format("tube is {} m; it must be less than the radius of the ring, {} m", tube_, radius_));
}

void Torus::follow(const ToolStep& step, Proxy& proxy) const noexcept {
  if (radius_ < tube_ + step.radius && rest(step, proxy)) return;
  std::uint32_t& side = proxy.memory.index[0];
  stand(foot(step.to - centre_, proxy.normal), step, proxy);
  side = !proxy.touching ? kNoSide : (proxy.position.z() < centre_.z() ? kLower : kUpper);
}

bool Torus::rest(const ToolStep& step, Proxy& proxy) const noexcept {
  const Vec3 place = step.to - centre_, from = step.from - centre_;
  std::uint32_t& side = proxy.memory.index[0];
  const auto side_of = [](double z) -> std::uint32_t { return z < 0 ? kLower : kUpper; };
  if (!std::isnan(from.x()) && side_of(from.z()) != side_of(place.z())) {
    const double share = from.z() / (from.z() - place.z());
    const Vec3 crossing = from + share * (place - from);
    const bool hole = std::hypot(crossing.x(), crossing.y()) < radius_;
    if (!hole)
      side = side_of(place.z());
    else if (side == kNoSide)
      side = side_of(from.z());
  } else if (side == kNoSide) {
    side = side_of(place.z());
  }

  // The ball in the mouth touches a whole circle of the ring. The directions in which the ring can push it from there
  // make a cone.
  const double up = side == kUpper ? 1 : -1, reach = tube_ + step.radius;
  const double mouth = std::sqrt((reach - radius_) * (reach + radius_)), below = mouth - up * place.z();
  const double rho = std::hypot(place.x(), place.y());
  if (!(below > 0 && rho * mouth <= radius_ * below)) return false;
  const Vec3 vertex(0, 0, up * mouth), away = vertex - place;
  const double depth = away.norm();
  SurfacePoint held{.position = vertex, .normal = up * Vec3::UnitZ(), .distance = step.radius - depth};
  if (depth > kNothing * reach) held.normal = away / depth;
  held.position -= step.radius * held.normal;
  stand(held, step, proxy);
  return true;
}

SurfacePoint Torus::foot(const Vec3& place, const Vec3& normal) const noexcept {
  const Meridian seen(place, normal, radius_);
  const double off = seen.rho - radius_, distance = std::hypot(off, seen.z);
  Vec3 out = seen.out;
  if (distance > kNothing * tube_) {
    out = seen.vector(off / distance, seen.z / distance);
  } else {
    const Vec3 last = seen.vector(normal.dot(seen.out), normal.z());
    if (const double norm = last.norm(); norm > kNothing) out = last / norm;
  }
  return {radius_ * seen.out + tube_ * out, out, distance - tube_};
}

SurfacePoint Torus::closest(const Vec3& place) const noexcept {
  return foot(place, Vec3::Zero());
}

Curvature Torus::curvature(const Vec3& proxy, const Vec3& normal) const noexcept {
  constexpr double kSharp = -1e300;  // in the mouth of a closed hole the ball does not move
  const double rho = std::hypot(proxy.x(), proxy.y());
  if (!(rho > kNothing * radius_)) return {.along = normal.unitOrthogonal(), .of_along = kSharp, .of_across = kSharp};
  return {.along = direction_around(proxy),
          .of_along = curvature_around(proxy, normal),
          .of_across = 1 / std::hypot(rho - radius_, proxy.z())};
}

Box Torus::extent() const noexcept {
  const Vec3 reach(radius_ + tube_, radius_ + tube_, tube_);
  return {-reach, reach};
}

bool Torus::overlaps(const Box& box) const noexcept {
  const auto [least, most] = range_of_rho(box);
  return std::hypot(radius_ - std::clamp(radius_, least, most), std::max({0.0, box.min.z(), -box.max.z()})) < tube_;
}

TriangleMesh Torus::mesh(double tolerance) const {
  // Half the tolerance for the circles around the axis, half for those around the tube.
  const int around = chords_of_circle(radius_ + tube_, 0.5 * tolerance),
            tube = chords_of_circle(tube_, 0.5 * tolerance);
  return grid_mesh(around, tube, {.wraps_u = true, .wraps_v = true}, [&](double u, double v) -> Vec3 {
    const double a = 2 * std::numbers::pi * u, b = 2 * std::numbers::pi * v, rho = radius_ + tube_ * std::cos(b);
    return {rho * std::cos(a), rho * std::sin(a), tube_ * std::sin(b)};
  });
}

std::unique_ptr<Shape> read_torus(JsonReader& reader) {
  TorusSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kFarthestCentre, kFarthestCentre);
  spec.radius = reader.require("radius").length("radius", 0, kMinLength, kMaxLength);
  spec.tube = reader.require("tube").length("tube", 0, kMinLength, kMaxLength);
  return std::make_unique<Torus>(spec);
}

}  // namespace haptrace
