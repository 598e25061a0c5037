#include "control/observer_pd.h"

#include "control/norm.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kRestSpeed = 1e-4;  // speed below which the reference is at rest [m/s]
constexpr double kPatienceGrowth = 1.1, kMostPatience = 2;
constexpr double kNearCounts = 10;    // distance within which the device is on its target, or hunts for it [counts]
constexpr double kStandstill = 1.0;   // time at rest near the reference after which the load is followed slowly [s]
constexpr double kLeisure = 0.1;      // share of the bandwidth then
constexpr double kTransition = 0.05;  // time constant of the transition to standstill [s]
constexpr double kAwakening = 0.01;   // time constant of the transition back [s]

double blend(double dt, double time_constant) {
  return -std::expm1(-dt / time_constant);
}

}  // namespace

ObserverPd::ObserverPd(const Options& options)
    : observer_({.mass = options.design.mass,
                 .delay = options.design.delay,
                 .bandwidth_hz = options.design.observer_hz,
                 .rate_hz = options.rate_hz}),
      driven_((options.design.mass.array() > 0).cast<double>()),
      observer_hz_(options.design.observer_hz),
      authority_(options.design.authority),
      quantum_(options.position_resolution) {}

void ObserverPd::start(const State& first) noexcept {
  observer_.start(first.position);
  observer_.set_bandwidth(observer_hz_);
  known_ = load_ = kept_ = spring_ = Vec3::Zero();
  rested_ = 0;
  stood_ = 0;
  patience_ = 1;
  resting_ = false;
  gain_share_ = 1;
}

bool ObserverPd::rests(const State& state, const Reference& reference) noexcept {
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

Vec3 ObserverPd::force(const TermInput& input) noexcept {
  const auto& [state, reference, tuning, before] = input;
  observer_.update(state.position, state.dt, state.force_applied, known_);
  known_ = before;
  const StateObserver::Estimate estimate = observer_.ahead();

  const double lead = observer_.lead();
  const Vec3 position = reference.position + lead * reference.velocity + 0.5 * lead * lead * reference.acceleration;
  const Vec3 velocity = reference.velocity + lead * reference.acceleration;
  const Vec3 spring = tuning.gains.kp.cwiseProduct(position - estimate.position);
  const Vec3 damping = tuning.gains.kd.cwiseProduct(velocity - estimate.velocity);

  const bool was_resting = resting_;
  resting_ = rests(state, reference);
  const bool stands = stood_ > kStandstill;
  const double bandwidth = (stands ? kLeisure : 1.0) * tuning.observer_hz;  // [Hz]
  load_ += blend(state.dt, 1 / (2 * std::numbers::pi * bandwidth)) * (estimate.load - load_);
  Vec3 load = load_;
  if (resting_) {
    if (!was_resting) {
      kept_ += load_;
      spring_ = spring;
      rest_share_ = gain_share_;
    }
    load = kept_;
  } else {
    if (was_resting) kept_ -= load_;
    const double fade = std::exp(-state.dt / kAwakening);
    kept_ *= fade;
    spring_ *= fade;
    load += kept_;
  }
  gain_share_ += blend(state.dt, stands ? kTransition : kAwakening) * ((resting_ ? kRestGains
                                                                        : stands ? kStandingGains
                                                                                 : 1) -
                                                                       gain_share_);
  // The force is as noisy as under full gains, and a swing of the device on the friction bristles is noticed in half
  // the time.
  observer_.set_bandwidth(observer_hz_ / gain_share_);
  if (const double magnitude = norm_of(load); magnitude > authority_) load *= authority_ / magnitude;

  // Keep the force that the spring loses as its gain falls, so that the device stays where it rests.
  const Vec3 feedback = gain_share_ * (spring + damping) + (rest_share_ - gain_share_) * spring_;
  return driven_.cwiseProduct(feedback) + tuning.observer * load;
}

}  // namespace haptrace
