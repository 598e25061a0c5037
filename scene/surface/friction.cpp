#include "scene/surface/friction.h"

#include "base/error.h"
#include "scene/surface/hash.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kMostCoefficient = 10;
constexpr double kMostBristle = 1e9;                      // [N/m]
constexpr double kMostDamping = 1e4, kMostViscous = 100;  // [N s/m]

/// Returns a number of the standard normal distribution from random bits (Box and Muller 1958).
double normal_number(std::uint64_t bits) noexcept {
  const double radius = std::sqrt(-2 * std::log(1 - unit_number(bits)));
  return radius * std::cos(2 * std::numbers::pi * unit_number(mixed(bits)));
}

}  // namespace

Friction::Friction(const FrictionSpec& spec) : spec_(spec) {
  check_range("friction: dynamic", spec.dynamic, 0, kMostCoefficient);
  check_range("friction: static", spec.fixed, spec.dynamic, kMostCoefficient);
  check_range("friction: bristle", spec.bristle, 1e-3, kMostBristle, "N/m");
  check_range("friction: damping", spec.damping, 0, kMostDamping, "N s/m");
  check_range("friction: viscous", spec.viscous, 0, kMostViscous, "N s/m");
}

double Friction::variation(const Vec3& place) const noexcept {
  double share = 1;
  if (spec_.periodic)
    share *= 1 + spec_.periodic->amplitude *
                     std::sin(2 * std::numbers::pi * spec_.periodic->axis.dot(place) / spec_.periodic->period);
  if (spec_.sandpaper) {
    const std::uint64_t bits = hash_of_cell(cell_of(place / spec_.sandpaper->grain), spec_.sandpaper->seed);
    share *= std::max(0.0, 1 + spec_.sandpaper->sigma * normal_number(bits));
  }
  return share;
}

Vec3 Friction::pull(const Press& press, const Vec3& normal, double load, SurfaceMemory& memory) const noexcept {
  const bool first = !memory.used;
  memory.used = true;
  if (!(load > 0)) {
    memory.bristle.setZero();
    memory.slides = false;
    return Vec3::Zero();
  }
  // The first step of a contact came from outside: it stretches nothing.
  Vec3 step = first ? Vec3(Vec3::Zero()) : Vec3(press.step.to - press.step.from);
  if (!is_finite(step)) step.setZero();
  step -= step.dot(normal) * normal;
  const Vec3 held = memory.bristle - memory.bristle.dot(normal) * normal;
  const double damper = spec_.damping > 0 && press.dt > 0 ? spec_.damping / press.dt : 0;  // [N/m]
  Vec3 stretched = held + step;
  Vec3 pulled = spec_.bristle * stretched + damper * step;
  const double trial = pulled.norm();
  const double variation = spec_.periodic || spec_.sandpaper ? this->variation(press.proxy.position) : 1;
  const double limit = (memory.slides ? spec_.dynamic : spec_.fixed) * variation * load;
  if (trial > limit) {
    memory.slides = true;
    pulled *= spec_.dynamic * variation * load / trial;
    // The bristle z and its damper carry the force together, K z + B (z - held) / dt = pulled. So the rest of the
    // step, which slid, lies along the force and takes energy.
    stretched = (pulled + damper * held) / (spec_.bristle + damper);
  } else {
    memory.slides = false;
  }
  memory.bristle = stretched;
  Vec3 force = -pulled;
  if (spec_.viscous > 0) force -= spec_.viscous * (press.velocity - press.velocity.dot(normal) * normal);
  return force;
}

Friction read_friction(JsonReader reader, double stiffness) {
  FrictionSpec spec;
  spec.dynamic = reader.number("dynamic", reader.number("static", 0, 0, kMostCoefficient), 0, kMostCoefficient);
  spec.fixed = reader.number("static", spec.dynamic, 0, kMostCoefficient);
  if (spec.fixed < spec.dynamic)
    throw input_error(reader.where() + ".static: is below 'dynamic'; a tool that sticks holds at least as well");
  spec.bristle = reader.number("bristle", std::clamp(stiffness, 1e-3, kMostBristle), 1e-3, kMostBristle);
  spec.damping = reader.number("damping", 0, 0, kMostDamping);
  spec.viscous = reader.number("viscous", 0, 0, kMostViscous);
  if (std::optional<JsonReader> periodic = reader.object("periodic")) {
    PeriodicFriction& wave = spec.periodic.emplace();
    wave.period = periodic->require("period").number("period", 0, 1e-6, 10);
    wave.amplitude = periodic->require("amplitude").number("amplitude", 0, 0, 1);
    const Vec3 axis = periodic->vector("axis", wave.axis, -1e6, 1e6);
    if (!(axis.stableNorm() > 1e-6)) throw input_error(periodic->where() + ".axis: the vector has no direction");
    wave.axis = axis.stableNormalized();
    periodic->finish();
  }
  if (std::optional<JsonReader> paper = reader.object("sandpaper")) {
    SandpaperFriction& grains = spec.sandpaper.emplace();
    grains.sigma = paper->require("sigma").number("sigma", 0, 0, 10);
    grains.grain = paper->require("grain").number("grain", 0, 1e-6, 1);
    grains.seed = static_cast<std::uint64_t>(paper->integer("seed", 0, 0, 1'000'000'000));
    paper->finish();
  }
  reader.finish();
  return Friction(spec);
}

}  // namespace haptrace
