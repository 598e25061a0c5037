#include "control/state_observer.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {

StateObserver::StateObserver(const Options& options)
    : mass_(options.mass),
      period_(1 / options.rate_hz),
      delay_ticks_(std::clamp(options.delay * options.rate_hz, 0.0, static_cast<double>(kLongestDelay))),
      lead_ticks_(static_cast<int>(std::lround(delay_ticks_))) {
  for (int axis = 0; axis < 3; ++axis) inverse_mass_[axis] = mass_[axis] > 0 ? 1 / mass_[axis] : 0;
  set_bandwidth(options.bandwidth_hz);
  start(Vec3::Zero());
}

void StateObserver::set_bandwidth(double bandwidth_hz) noexcept {
  const double p = std::exp(-2 * std::numbers::pi * bandwidth_hz * period_), q = 1 - p;
  l1_ = 1 - p * p * p;
  l2_ = 1.5 * q * q * (1 + p) / period_;
  l3_ = q * q * q / (period_ * period_);
}

void StateObserver::start(const Vec3& position) noexcept {
  forces_.fill(Vec3::Zero());
  x_ = position;
  v_ = d_ = Vec3::Zero();
}

void StateObserver::update(const Vec3& position, double dt, const Vec3& sent, const Vec3& known) noexcept {
  const bool passes = dt > 0, anew = dt > kLongestGap * period_;
  // While ticks are missed the force is held.
  const int ticks =
      passes ? std::max(1, static_cast<int>(std::lround(std::min<double>(dt / period_, kLongestDelay)))) : 1;
  const double step = dt / ticks;
  for (int tick = 0; tick < ticks; ++tick) {
    forces_.push(sent - known);
    if (!passes || anew) continue;
    const Vec3 a = forces_.acted(delay_ticks_).cwiseProduct(inverse_mass_) - d_;
    x_ += step * v_ + 0.5 * step * step * a;
    v_ += step * a;
  }
  if (!passes) return;
  if (anew) {
    x_ = position;
    v_.setZero();
    return;
  }

  const Vec3 e = position - x_;
  x_ += l1_ * e;
  v_ += l2_ * e;
  d_ -= l3_ * e;
  for (int axis = 0; axis < 3; ++axis) {
    if (inverse_mass_[axis] > 0) continue;
    x_[axis] = position[axis];
    v_[axis] = d_[axis] = 0;
  }
}

StateObserver::Estimate StateObserver::now() const noexcept {
  return {x_, v_, mass_.cwiseProduct(d_)};
}

StateObserver::Estimate StateObserver::ahead() const noexcept {
  Vec3 x = x_, v = v_;
  for (int tick = 0; tick < lead_ticks_; ++tick) {
    const Vec3 a = forces_.acted(std::max(delay_ticks_ - tick - 1, 0.0)).cwiseProduct(inverse_mass_) - d_;
    x += period_ * v + 0.5 * period_ * period_ * a;
    v += period_ * a;
  }
  return {x, v, mass_.cwiseProduct(d_)};
}

}  // namespace haptrace
