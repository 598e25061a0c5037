#include "control/observer_pd.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kRestSpeed = 1e-4;   // of a reference that rests [m/s]
constexpr double kTransition = 0.05;  // over which rest begins and ends, a time constant [s]

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
      authority_(options.design.authority),
      rest_radius_(kRestCounts * options.position_resolution) {}

void ObserverPd::start(const State& first) noexcept {
  observer_.start(first.position);
  known_ = load_ = kept_ = Vec3::Zero();
  rested_ = 0;
  resting_ = false;
  gain_share_ = 1;
}

bool ObserverPd::rests(const State& state, const Reference& reference) noexcept {
  const double distance = (reference.position - state.position).stableNorm();
  const bool still = driven_.cwiseProduct(reference.velocity).stableNorm() < kRestSpeed;
  if (still && distance <= rest_radius_)
    rested_ += state.dt;
  else if (!still || distance > 2 * rest_radius_)
    rested_ = 0;
  return rested_ >= kRestTime;
}

Vec3 ObserverPd::force(const TermInput& input) noexcept {
  const auto& [state, reference, tuning, before] = input;
  observer_.update(state.position, state.dt, state.force_applied, known_);
  known_ = before;
  const StateObserver::Estimate estimate = observer_.ahead();

  load_ += blend(state.dt, 1 / (2 * std::numbers::pi * tuning.observer_hz)) * (estimate.load - load_);
  Vec3 load = load_;
  const bool was_resting = resting_;
  resting_ = rests(state, reference);
  if (resting_) {
    if (!was_resting) kept_ += load_;
    load = kept_;
  } else {
    if (was_resting) kept_ -= load_;
    kept_ *= std::exp(-state.dt / kTransition);
    load += kept_;
  }
  gain_share_ += blend(state.dt, kTransition) * ((resting_ ? kRestGains : 1) - gain_share_);
  if (const double magnitude = load.stableNorm(); magnitude > authority_) load *= authority_ / magnitude;

  const double lead = observer_.lead();
  const Vec3 position = reference.position + lead * reference.velocity + 0.5 * lead * lead * reference.acceleration;
  const Vec3 velocity = reference.velocity + lead * reference.acceleration;
  const Vec3 feedback = tuning.gains.kp.cwiseProduct(position - estimate.position) +
                        tuning.gains.kd.cwiseProduct(velocity - estimate.velocity);
  return gain_share_ * driven_.cwiseProduct(feedback) + tuning.observer * load;
}

}  // namespace haptrace
