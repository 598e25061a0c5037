// The force of a wall that is no longer there, while it goes.
#pragma once

#include "base/types.h"
#include "control/norm.h"

#include <algorithm>

namespace haptrace {

/// Takes over the force of a wall when the walls come to act elsewhere, so that the hand feels no step. It is a spring
/// that is as tense as the wall was, and slackens evenly within kTime. Along its force it holds
///
///     f(x) = f0 (1 - x / r) a,   E(x) = E0 (1 - x / r)^2 a,   r = 2 E0 / f0,   0 <= x <= r,
///
/// with x the movement of the hand since, and a falling from 1 to 0: it pushes no farther than the energy of the wall
/// reached, and gives no more than that. Against its force it stays at f0 a.
///
/// Real-time: all.
class WallRelease {
 public:
  static constexpr double kTime = 0.3;  ///< [s]

  WallRelease() = default;
  /// `force` [N] of the wall on a hand at `position` [m], and the `energy` that it held [J].
  WallRelease(const Vec3& force, const Vec3& position, double energy) noexcept
      : position_(position), energy_(energy), force_(norm_of(force)) {
    if (!(force_ > 0) || !(energy > 0)) return;
    direction_ = force / force_;
    left_ = 1;
  }

  /// Slackens for `dt` [s].
  void pass(double dt) noexcept { left_ = std::max(0.0, left_ - std::max(0.0, dt) / kTime); }

  /// Returns the force on a hand at `position` [N].
  [[nodiscard]] Vec3 force(const Vec3& position) const noexcept {
    if (!(left_ > 0)) return Vec3::Zero();
    return left_ * force_ * std::clamp(1 - share(position), 0.0, 1.0) * direction_;
  }
  /// Returns the energy that it holds [J].
  [[nodiscard]] double stored(const Vec3& position) const noexcept {
    if (!(left_ > 0)) return 0;
    const double x = share(position), slack = std::clamp(1 - x, 0.0, 1.0);
    return left_ * energy_ * (x < 0 ? 1 - 2 * x : slack * slack);
  }

 private:
  /// Returns the hand's movement along the force, as a share of the reach.
  [[nodiscard]] double share(const Vec3& position) const noexcept {
    return force_ * direction_.dot(position - position_) / (2 * energy_);
  }

  Vec3 position_ = Vec3::Zero(), direction_ = Vec3::Zero();
  double energy_ = 0, force_ = 0;  ///< [J], [N]
  double left_ = 0;                ///< a
};

}  // namespace haptrace
