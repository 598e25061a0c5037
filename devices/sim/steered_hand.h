// The intent of a simulated hand that a person steers.
#pragma once

#include "control/limits.h"
#include "devices/sim/hand_steering.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {

/// Follows the intentions of a person as a hand can: through a critically damped low pass of second order, so that
/// neither the noise nor the steps of a mouse jerk the handle. The grip changes within kGrasp. A hand that takes hold
/// starts from where it is.
///
/// An intention that is not finite is ignored, and one that becomes stale lets go: the grip is 0 at
/// HandSteering::kStale after its arrival.
///
/// Real-time: all.
class SteeredHand {
 public:
  static constexpr double kBandwidth = 5;  ///< -3 dB [Hz]
  static constexpr double kGrasp = 0.05;   ///< [s]

  /// Advances by `dt` [s], at `now_ns` of CLOCK_MONOTONIC. `newest` is the newest intention, and `hand` the place of
  /// the hand [m], both in the same axes.
  void update(const HandIntention& newest, std::int64_t now_ns, const Vec3& hand, double dt) noexcept {
    if (is_finite(newest.position) && std::isfinite(newest.grip)) taken_ = newest;
    const bool fresh = now_ns - taken_.time_ns < HandSteering::kStale - kGraspNs;
    const double wanted = fresh && taken_.time_ns > 0 ? std::clamp(taken_.grip, 0.0, 1.0) : 0;
    if (grip_.value() == 0) {
      position_ = hand;
      velocity_ = Vec3::Zero();
    }
    if (grip_.advance(wanted, dt, kGrasp) == 0) return;
    // Critical damping: the error e obeys e'' + 2 w e' + w^2 e = 0 exactly while the intention stands still.
    const double decay = std::exp(-kRate * dt);
    const Vec3 error = position_ - taken_.position, slope = velocity_ + kRate * error;
    position_ = taken_.position + decay * (error + dt * slope);
    velocity_ = decay * (velocity_ - kRate * dt * slope);
  }

  [[nodiscard]] double grip() const noexcept { return grip_.value(); }       ///< 0 to 1
  [[nodiscard]] const Vec3& position() const noexcept { return position_; }  ///< intended [m]

 private:
  static constexpr std::int64_t kGraspNs = 50'000'000;
  /// Natural frequency of a critically damped low pass whose gain is -3 dB at kBandwidth: sqrt(sqrt(2) - 1) below
  /// [1/s].
  static constexpr double kRate = 2 * std::numbers::pi * kBandwidth / 0.6435942529055827;

  HandIntention taken_;
  Vec3 position_ = Vec3::Zero(), velocity_ = Vec3::Zero();
  Ramp grip_;
};

}  // namespace haptrace
