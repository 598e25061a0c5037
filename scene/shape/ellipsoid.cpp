#include "scene/shape/ellipsoid.h"

#include "base/error.h"
#include "scene/shape/grid_mesh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

enum : std::uint32_t { kBelow = 1, kAbove };

constexpr int kMostSteps = 100;  // of Newton; a dozen is usual
constexpr double kSettled = 4e-16;

}  // namespace

Ellipsoid::Ellipsoid(const EllipsoidSpec& spec) : Convex(spec.centre), radii_(spec.radii) {
  for (int axis = 0; axis < 3; ++axis) check_range("radii", spec.radii[axis], kMinLength, kMaxLength, "m");
  const double c = radii_.minCoeff(&shortest_);
  gap_ = ((radii_.array() - c) * (radii_.array() + c)).matrix();
}

std::pair<double, double> Ellipsoid::excess(const Vec3& place, double shift) const noexcept {
  double sum = -1, slope = 0;
  for (int i = 0; i < 3; ++i) {
    const double u = radii_[i] * place[i] / (gap_[i] + shift);
    sum += u * u;
    slope -= 2 * u * u / (gap_[i] + shift);
  }
  return {sum, slope};
}

SurfacePoint Ellipsoid::at(const Vec3& surface, const Vec3& place) const noexcept {
  SurfacePoint point;
  // On the surface to the last bit, which a root of finite precision is not.
  point.position = surface / surface.cwiseQuotient(radii_).norm();
  point.normal = point.position.cwiseQuotient(radii_.cwiseAbs2()).stableNormalized();
  point.distance = point.normal.dot(place - point.position);
  return point;
}

SurfacePoint Ellipsoid::closest_to(const Vec3& place, const Vec3& normal, double side) const noexcept {
  // The excess falls with the shift, and is convex, so Newton's steps from its left end do not pass the root.
  double shift = 0;
  for (int i = 0; i < 3; ++i) shift = std::max(shift, radii_[i] * std::abs(place[i]) - gap_[i]);
  Vec3 surface = Vec3::Zero();
  if (shift > 0) {
    for (int step = 0; step < kMostSteps; ++step) {
      const auto [sum, slope] = excess(place, shift);
      if (!(sum > 0 && slope < 0)) break;
      const double next = shift - sum / slope;
      if (!(next > shift * (1 + kSettled))) break;
      shift = next;
    }
    for (int i = 0; i < 3; ++i) surface[i] = radii_[i] * radii_[i] * place[i] / (gap_[i] + shift);
    if (surface.squaredNorm() > 0) return at(surface, place);
  }
  // The place is so near the plane of the longer axes that it has no component along the shortest one.
  double rest = 1;
  Vec3 free = Vec3::Zero();
  for (int i = 0; i < 3; ++i) {
    if (gap_[i] > 0) {
      surface[i] = radii_[i] * radii_[i] * place[i] / gap_[i];
      rest -= std::pow(surface[i] / radii_[i], 2);
    } else {
      free[i] = normal[i];
    }
  }
  if (!(free.squaredNorm() > 0)) free = Vec3::Unit(shortest_);
  if (side * free[shortest_] < 0) free = -free;
  if (rest > 0) surface += std::sqrt(rest) * radii_[shortest_] * free.normalized();
  return at(surface, place);
}

bool Ellipsoid::beyond(const Vec3& place, SurfacePoint& foot) const noexcept {
  // l = -c^2 - shift. From the shift at which the shortest axis alone gives |x / a| = 1, Newton's steps do not pass the
  // least root; where the excess begins to rise, there is none.
  double next_gap = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i)
    if (i != shortest_) next_gap = std::min(next_gap, gap_[i]);
  double shift = radii_[shortest_] * std::abs(place[shortest_]);
  for (int step = 0; step < kMostSteps; ++step) {
    if (!(shift < next_gap)) return false;
    const auto [sum, slope] = excess(place, -shift);
    if (!(sum > 0)) break;
    if (!(slope > 0)) return false;  // with respect to l, which falls as the shift grows
    const double next = shift + sum / slope;
    if (!(next > shift * (1 + kSettled))) break;
    shift = next;
  }
  Vec3 surface;
  for (int i = 0; i < 3; ++i) surface[i] = radii_[i] * radii_[i] * place[i] / (gap_[i] - shift);
  foot = at(surface, place);
  return true;
}

Convex::Face Ellipsoid::entered(const Vec3& from, const Vec3& to) const noexcept {
  const Vec3 u = from.cwiseQuotient(radii_), step = (to - from).cwiseQuotient(radii_);
  const double norm = u.norm();
  Chord chord;
  chord.keep_quadric(step.squaredNorm(), u.dot(step), (norm - 1) * (norm + 1), kAbove);
  if (!chord.entered()) return 0;
  return u[shortest_] + std::clamp(chord.in(), 0.0, 1.0) * step[shortest_] < 0 ? kBelow : kAbove;
}

Convex::Face Ellipsoid::face_at(const Vec3& place) const noexcept {
  if (!(place.cwiseQuotient(radii_).squaredNorm() < 1)) return 0;
  return place[shortest_] < 0 ? kBelow : kAbove;
}

bool Ellipsoid::held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept {
  const double side = face == kAbove ? 1 : -1;
  if (side * place[shortest_] < 0) {
    if (beyond(place, foot)) return true;
    face = face == kAbove ? kBelow : kAbove;
  }
  if (!(place.cwiseQuotient(radii_).squaredNorm() < 1)) return false;
  foot = closest_to(place, normal, face == kAbove ? 1 : -1);
  foot.distance = std::min(foot.distance, 0.0);
  return true;
}

SurfacePoint Ellipsoid::outside(const Vec3& place) const noexcept {
  SurfacePoint point = closest_to(place, Vec3::Zero(), 1);
  point.distance = std::max(point.distance, 0.0);
  return point;
}

Curvature Ellipsoid::curvature(const Vec3& proxy, const Vec3& normal) const noexcept {
  const SurfacePoint foot = closest_to(proxy, normal, 1);
  const double round = std::max(0.0, foot.distance);
  const Vec3 t = normal.unitOrthogonal(), s = normal.cross(t);
  const Vec3 bend = radii_.cwiseAbs2().cwiseInverse();
  const double slope = foot.position.cwiseProduct(bend).norm();
  const double tt = t.dot(bend.cwiseProduct(t)) / slope, ss = s.dot(bend.cwiseProduct(s)) / slope,
               ts = t.dot(bend.cwiseProduct(s)) / slope;
  const double half = 0.5 * (tt - ss), size = std::hypot(half, ts), angle = 0.5 * std::atan2(ts, half);
  const double most = 0.5 * (tt + ss) + size, least = 0.5 * (tt + ss) - size;
  return {.along = std::cos(angle) * t + std::sin(angle) * s,
          .of_along = most / (1 + round * most),
          .of_across = least / (1 + round * least)};
}

Box Ellipsoid::extent() const noexcept {
  return {-radii_, radii_};
}

bool Ellipsoid::overlaps(const Box& box) const noexcept {
  return Vec3::Zero().cwiseMax(box.min).cwiseMin(box.max).cwiseQuotient(radii_).squaredNorm() < 1;
}

TriangleMesh Ellipsoid::mesh(double tolerance) const {
  // On the unit sphere, of which the ellipsoid is the image; a cell errs up to twice as far as its edges.
  const int chords = chords_of_circle(radii_.maxCoeff(), 0.5 * tolerance);
  return grid_mesh(chords, (chords + 1) / 2, {.wraps_u = true}, [&](double u, double v) -> Vec3 {
    const double along = 2 * std::numbers::pi * u, up = std::numbers::pi * (v - 0.5);
    return radii_.cwiseProduct(Vec3(std::cos(up) * std::cos(along), std::cos(up) * std::sin(along), std::sin(up)));
  });
}

std::unique_ptr<Shape> read_ellipsoid(JsonReader& reader) {
  EllipsoidSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kFarthestCentre, kFarthestCentre);
  spec.radii = reader.require("radii").vector("radii", spec.radii, kMinLength, kMaxLength);
  return std::make_unique<Ellipsoid>(spec);
}

}  // namespace haptrace
