#include "control/reach_forces.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

ReachForces::ReachForces(const ReachGeometry& geometry, const Options& options)
    : geometry_(geometry),
      along_(options.clamp && options.clamp->locks ? Vec3(Vec3::Zero()) : geometry.along()),
      options_(options),
      tank_(options.energy),
      account_(options.delay, options.rate_hz) {
  check_range("the distance of the target", geometry.distance(), 1e-3, 10, "m");
  check_range("the field's largest entry", options.field.cwiseAbs().maxCoeff(), 0, 1000, "N s/m");
  check_range("the largest force of the reach", options.max_force, 0, 1000, "N");
  check_range("the energy of the reach", options.energy, 1e-3, 100, "J");
  if (!options.clamp) return;
  check_range("the stiffness of the clamp", options.clamp->stiffness, 1, 1e6, "N/m");
  check_range("the damping of the clamp", options.clamp->damping, 0, 1000, "N s/m");
  check_range("the rise time of the clamp", options.clamp->rise, 0.05, 60, "s");
  check_range("the break-out distance of the clamp", options.clamp->break_out, 1e-3, 1, "m");
  check_range("the time for which the clamp holds", options.clamp->holds, 0.1, 60, "s");
}

void ReachForces::begin() noexcept {
  on_ = Ramp(0);
  holding_ = Ramp(1);
  gain_ = still_ = 0;
  force_.setZero();
  broken_ = false;
  account_.begin();
}

Vec3 ReachForces::limited(const Vec3& force) const noexcept {
  // Most forces are small; the inverse of the tiniest ones would overflow in their norm.
  if (force.cwiseAbs().maxCoeff() <= 0.5 * options_.max_force) return force;
  const double size = norm_of(force);
  return size > options_.max_force ? Vec3(options_.max_force / size * force) : force;
}

double ReachForces::stored(const Vec3& position, double gain) const noexcept {
  if (!options_.clamp) return 0;
  const double k = options_.clamp->stiffness, d = norm_of(off(position - geometry_.start));
  const double linear = options_.max_force / k;
  return gain * (d <= linear ? 0.5 * k * d * d : options_.max_force * (d - 0.5 * linear));
}

double ReachForces::advance(const State& state, bool acts, double share) noexcept {
  const double speed = norm_of(state.velocity);
  if (speed >= kMoves)
    still_ = 0;
  else if (speed < kStill && force_.cwiseAbs().maxCoeff() > kHeld)
    still_ += state.dt;
  holding_.advance(lets_go() ? 0 : 1, state.dt, lets_go() ? kDecay : rise());
  on_.advance(acts && !broken_ ? 1 : 0, state.dt, acts && !broken_ ? rise() : fall());
  const double next = share * on_.value() * holding_.value();
  // A stiffer spring holds more energy at the same place; the tank must be able to pay.
  if (next <= gain_ || stored(state.position, next - gain_) <= std::max(0.0, tank_.level())) gain_ = next;
  return gain_;
}

Vec3 ReachForces::update(const State& state, bool acts, double share, bool alone) noexcept {
  if (!(state.dt > 0) || !is_finite(state.position) || !is_finite(state.velocity) || !is_finite(state.force_applied)) {
    account_.begin();
    force_.setZero();
    return force_;
  }
  if (!alone) account_.begin();
  // The spring's energy has the gain of this tick, so that a rise of the gain is charged.
  const double gain = advance(state, acts, share);
  if (const std::optional<double> given =
          account_.update(state.position, state.force_applied - state.force_touched, stored(state.position, gain))) {
    given_ += *given;
    tank_.charge(*given);
  }
  if (options_.clamp) {
    const Vec3 d = off(state.position - geometry_.start), v = off(state.velocity);
    if (acts && on_.value() > 0 && norm_of(d) > options_.clamp->break_out) broken_ = true;
    force_ = -gain * limited(options_.clamp->stiffness * d + options_.clamp->damping * v);
  } else {
    force_ = gain * tank_.share() * limited(options_.field * state.velocity);
  }
  if (const double damping = recovering_damping(-tank_.level(), state.velocity, options_.rate_hz, options_.max_damping);
      damping > 0)
    force_ -= damping * state.velocity;
  return force_;
}

}  // namespace haptrace
