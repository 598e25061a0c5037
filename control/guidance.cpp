#include "control/guidance.h"

#include "base/error.h"
#include "control/filters.h"
#include "control/norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::array kTuned{&GuideTuning::radius_scale, &GuideTuning::radius_offset, &GuideTuning::stiffness,
                            &GuideTuning::damping,      &GuideTuning::force,         &GuideTuning::assist,
                            &GuideTuning::share};

constexpr double kUnnoticedStep = 0.2;  // of the walls' force [N]
constexpr double kWallsReturn = 0.3;    // in which the share of the walls rises from 0 to 1 [s]

/// Returns the foot with the radii in force instead of the path's own.
PathProjection::Foot tuned(PathProjection::Foot foot, const GuideTuning& tuning) noexcept {
  foot.place.radius = tuning.radius(foot.place.radius);
  foot.tube.radius = tuning.radius(foot.tube.radius);
  return foot;
}

const Guidance::Options& checked_guidance(const Guidance::Options& options) {
  check_range("the energy of guidance", options.energy, 1e-3, 100, "J");
  check_range("the width of the gate", options.gate_width, 1e-6, 1, "m");
  check_range("the delay", options.delay, 0, 0.1, "s");
  check_range("the rate", options.rate_hz, 10, 20000, "Hz");
  check_range("the damping of guidance", options.max_damping, 0, 1e4, "N s/m");
  return options;
}

}  // namespace

Guidance::Guidance(GuideTerms terms, const Options& options)
    : terms_(std::move(terms)),
      options_(checked_guidance(options)),
      tank_(options.energy),
      account_(options.delay, options.rate_hz),
      budget_(options.energy) {
  const auto restores = [](const auto& term) { return term->kind() == GuideTerm::Kind::restoring; };
  if (!terms_.empty() && std::none_of(terms_.begin(), terms_.end(), restores))
    throw input_error(
        "without walls, replayed forces would push the hand away from the path; give the tunnel a stiffness");
}

double Guidance::gate(const PathProjection::Foot& foot) const noexcept {
  const double width = std::max(options_.gate_width, foot.place.radius);
  const double u = std::clamp((foot.distance - foot.place.radius) / width, 0.0, 1.0);
  return 1 - u * u * (3 - 2 * u);
}

bool Guidance::is_active() const noexcept {
  return std::any_of(terms_.begin(), terms_.end(),
                     [](const auto& term) { return term->kind() == GuideTerm::Kind::active; });
}

double Guidance::stored(const PathProjection::Foot& foot, const PathProjection::Tube& tube,
                        const GuideTuning& tuning) const noexcept {
  PathProjection::Foot there = foot;
  there.tube = tube;
  there = tuned(there, tuning);
  double stored = 0;
  for (const auto& term : terms_) stored += term->stored(there, tuning);
  return tuning.share * stored;
}

Vec3 Guidance::springs(const State& state, const PathProjection::Foot& foot) const noexcept {
  const PathProjection::Foot in_force = tuned(foot, tuning_);
  const GuideInput input{state, in_force, gate(in_force), tuning_};
  Vec3 sum = Vec3::Zero();
  for (const auto& term : terms_)
    if (term->kind() == GuideTerm::Kind::restoring) sum += term->force(input);
  return tuning_.share * sum;
}

void Guidance::change_tunnels(const State& state, const PathProjection::Foot& foot) noexcept {
  tube_ = foot.tube;
  certainty_ = foot.certainty;
  if (foot.tube.centre == foot.tube_before.centre && foot.tube.radius == foot.tube_before.radius) return;
  const double before = wall_share_ * stored(foot, foot.tube_before, tuning_);
  const double now = wall_share_ * stored(foot, foot.tube, tuning_);
  const double share = now > before ? wall_share_ * before / now : wall_share_;
  if (norm_of(share * springs(state, foot) - spring_) > kUnnoticedStep) {
    const double held = before + release_.stored(state.position);
    release_ = {spring_ + release_.force(hand_), state.position, held};
    wall_share_ = 0;
    account_.discard(held - release_.stored(state.position));
    return;
  }
  wall_share_ = share;
  if (now < before) account_.discard(before - now);
}

void Guidance::rest(double dt) noexcept {
  release_ = {};
  spring_.setZero();
  const double share = setting_share(dt);
  for (const auto value : kTuned) tuning_.*value += share * (target_.*value - tuning_.*value);
}

void Guidance::approach(const PathProjection::Foot& foot, double dt) noexcept {
  const double share = setting_share(dt);
  double spare = std::max(0.0, tank_.level());
  if (wall_share_ < 1) {
    const double next = std::min(1.0, wall_share_ + dt / kWallsReturn), holds = stored(foot, foot.tube, tuning_);
    // Where the walls hold nothing, they return at once.
    if (!(holds > 0)) {
      wall_share_ = 1;
    } else if (const double rise = (next - wall_share_) * holds; rise <= spare) {
      spare -= rise;
      wall_share_ = next;
    }
  }
  double held = wall_share_ * stored(foot, foot.tube, tuning_);
  // One value at a time: an affordable change does not wait for one that is not.
  for (const auto value : kTuned) {
    if (tuning_.*value == target_.*value) continue;
    GuideTuning next = tuning_;
    next.*value += share * (target_.*value - tuning_.*value);
    const double holds = wall_share_ * stored(foot, foot.tube, next);
    if (holds - held > spare) continue;
    spare -= std::max(0.0, holds - held);
    held = holds;
    tuning_ = next;
  }
}

void Guidance::credit(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept {
  double allowance = 0;
  for (const auto& term : terms_) allowance += tuning_.share * term->allowance(foot, tuning_);
  // Nobody walked what a relocated place passes over.
  const double walked = foot.relocated ? 0 : walked_.add(s_, foot.s);
  double credit = allowance * (cursor ? walked : std::min(walked, (state.position - hand_).norm()));
  if (cursor) credit += std::max(spring_.dot(foot.place.position - place_), 0.0);
  budget_ += credit;
  tank_.credit(credit);
}

void Guidance::account(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept {
  if (const std::optional<double> given =
          account_.update(state.position, state.force_applied - state.force_touched,
                          wall_share_ * stored(foot, foot.tube_before, tuning_) + release_.stored(state.position))) {
    given_ += *given;
    tank_.charge(*given);
    credit(state, foot, cursor);
  }
  change_tunnels(state, foot);
  place_ = foot.place.position;
  s_ = foot.s;
  hand_ = state.position;
  // Energy that goes as it slackens is lost, not given.
  const double held = release_.stored(state.position);
  release_.pass(state.dt);
  if (held > 0) account_.discard(held - release_.stored(state.position));
}

Vec3 Guidance::update(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept {
  if (!is_finite(state.position) || !is_finite(state.velocity) || !is_finite(state.force_applied)) {
    account_.begin();
    return Vec3::Zero();
  }
  account(state, foot, cursor);
  approach(foot, state.dt);
  const PathProjection::Foot in_force = tuned(foot, tuning_);
  const GuideInput input{state, in_force, gate(in_force), tuning_};
  Vec3 spring = Vec3::Zero(), passive = Vec3::Zero(), active = Vec3::Zero();
  for (const auto& term : terms_) {
    Vec3& sum = term->kind() == GuideTerm::Kind::restoring     ? spring
                : term->kind() == GuideTerm::Kind::dissipative ? passive
                                                               : active;
    sum += term->force(input);
  }
  spring_ = tuning_.share * wall_share_ * spring;
  Vec3 force = spring_ + release_.force(state.position) + tuning_.share * (passive + tank_.share() * active);
  // If the tank is overdrawn, damping takes the energy back within a tick, up to what the device withstands.
  if (const double damping = recovering_damping(-tank_.level(), state.velocity, options_.rate_hz, options_.max_damping);
      damping > 0)
    force -= damping * state.velocity;
  return force;
}

}  // namespace haptrace
