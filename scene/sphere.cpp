#include "scene/sphere.h"

#include "base/error.h"

#include <cmath>

namespace haptrace {
namespace {

constexpr double kMinRadius = 1e-6, kMaxRadius = 100;  // [m]
constexpr double kMaxCentre = 100;                     // [m], of each coordinate
constexpr double kCentre2 = 1e-24;                     // squared distance below which the tool is at the centre [m^2]

}  // namespace

Sphere::Sphere(std::string name, const SphereSpec& spec)
    : name_(std::move(name)), spec_(spec), surface_(name_, spec.surface) {
  for (int axis = 0; axis < 3; ++axis) check_range(name_ + ": centre", spec.centre[axis], -kMaxCentre, kMaxCentre, "m");
  check_range(name_ + ": radius", spec.radius, kMinRadius, kMaxRadius, "m");
  check_range(name_ + ": renew", spec.renew, 0, spec.radius, "m");
}

void Sphere::reset() noexcept {
  normal_ = Vec3::UnitZ();
  from_ = nan3();
}

Contact Sphere::answer(const Touch& touch) noexcept {
  if (!touch.valid()) return {};
  const Vec3 place = surface_.place(touch);
  if (!((place - from_).squaredNorm() < reach2_)) renew(place);
  return surface_.contact(touch, place, normal_, spec_.radius - normal_.dot(place - spec_.centre));
}

void Sphere::renew(const Vec3& place) noexcept {
  const Vec3 radius = place - spec_.centre;
  const double square = radius.squaredNorm();
  from_ = place;
  reach2_ = std::min(spec_.renew * spec_.renew, 0.25 * square);
  if (square > kCentre2) normal_ = radius / std::sqrt(square);
}

bool Sphere::meets(const Box& space) const noexcept {
  return (spec_.centre - spec_.centre.cwiseMax(space.min).cwiseMin(space.max)).norm() < spec_.radius;
}

std::vector<Knob> Sphere::knobs() const {
  return {surface_.knob(), {"renew", "m", {spec_.radius / 5, spec_.radius / 20, 0}, spec_.renew}};
}

void Sphere::set(const std::string& knob, double level) {
  if (knob == "lead") return surface_.set_lead(name_, level);
  if (knob != "renew") throw unknown_knob(*this, knob);
  check_range(name_ + ": renew", level, 0, spec_.radius, "m");
  spec_.renew = level;
}

std::unique_ptr<SceneObject> read_sphere(JsonReader& reader, const std::string& name) {
  SphereSpec spec;
  spec.centre = reader.vector("centre", spec.centre, -kMaxCentre, kMaxCentre);
  spec.radius = reader.require("radius").number("radius", 0, kMinRadius, kMaxRadius);
  spec.surface = read_penalty(reader);
  spec.renew = reader.number("renew", 0, 0, spec.radius);
  return std::make_unique<Sphere>(name, spec);
}

}  // namespace haptrace
