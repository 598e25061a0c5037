#include "control/rest.h"

#include "control/filters.h"
#include "control/norm.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

constexpr double kRestSpeed = 1e-4;  // speed below which the reference is at rest [m/s]
constexpr double kPatienceGrowth = 1.1, kMostPatience = 2;
constexpr double kNearCounts = 10;    // distance within which the device is on its target, or hunts for it [counts]
constexpr double kStandstill = 1.0;   // time at rest near the reference after which the load is followed slowly [s]
constexpr double kTransition = 0.05;  // time constant of the transition to standstill [s]

}  // namespace

void Rest::start() noexcept {
  *this = Rest(driven_, quantum_, standing_);
}

bool Rest::stands() const noexcept {
  return stood_ > kStandstill;
}

void Rest::watch(const State& state, const Reference& reference) noexcept {
  was_resting_ = resting_;
  resting_ = rests(state, reference);
}

bool Rest::rests(const State& state, const Reference& reference) noexcept {
  const double distance = norm_of(driven_.cwiseProduct(reference.position - state.position));
  const bool still = norm_of(driven_.cwiseProduct(reference.velocity)) < kRestSpeed;
  const double radius = patience_ * kRestCounts * quantum_;
  stood_ = still && distance <= kNearCounts * quantum_ ? stood_ + state.dt : 0;
  if (!still) patience_ = 1;
  if (!still || distance > 2 * radius) {
    rested_ = 0;
    anchor_ = state.position;
    return false;
  }
  if (resting_) return true;
  // The device must not only be near, but stay where it is: kept forces would carry on a movement.
  if (norm_of(driven_.cwiseProduct(state.position - anchor_)) > patience_ * kStillCounts * quantum_) {
    if (rested_ > 0) patience_ = std::min(patience_ * kPatienceGrowth, kMostPatience);
    rested_ = 0;
    anchor_ = state.position;
  }
  rested_ += state.dt;
  return rested_ >= kRestTime && distance <= radius;
}

Rest::Forces Rest::forces(const Feedback& moving, const Feedback& resting, const Vec3& load, double dt) noexcept {
  Forces forces{.load = load};
  if (resting_) {
    if (!was_resting_) {
      kept_ += load;
      spring_ = moving.spring - resting.spring;
      weight_then_ = weight_;
    }
    forces.load = kept_;
  } else {
    if (was_resting_) kept_ -= load;
    const double fade = std::exp(-dt / kAwakening);
    kept_ *= fade;
    spring_ *= fade;
    forces.load += kept_;
  }
  const double weight = resting_ ? 1 : stands() ? standing_ : 0;
  weight_ += low_pass_share(dt, stands() ? kTransition : kAwakening) * (weight - weight_);
  // Keep the force that a softer spring lacks, so that the device stays where it rests.
  forces.feedback = (1 - weight_) * (moving.spring + moving.other) + weight_ * (resting.spring + resting.other) +
                    (weight_ - weight_then_) * spring_;
  return forces;
}

}  // namespace haptrace
