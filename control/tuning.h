// What of a tracking law can be changed while it runs.
#pragma once

#include "base/types.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

/// Gains per axis of W.
struct PdGains {
  Vec3 kp = Vec3::Zero();  ///< proportional gain [N/m]
  Vec3 kd = Vec3::Zero();  ///< derivative gain [N s/m]
};

/// Gains beyond these are a mistake: no device that a hand can hold bears them.
inline constexpr double kLargestKp = 1e5;  // [N/m]
inline constexpr double kLargestKd = 1e3;  // [N s/m]

/// Throws Error(input) naming the gain that is negative, not finite, or beyond the largest.
void validate(const PdGains& gains);

/// Gains, and how much of each compensation acts: 0 none to 1 all. Plain data, to be posted through a Mailbox. A share
/// of a compensation that the session was not composed of means nothing.
struct Tuning {
  PdGains gains;
  double inertia = 1;       ///< feedforward of mass times the reference's acceleration
  double gravity = 1;       ///< feedforward of gravity along the reference
  double friction = 1;      ///< feedforward of friction along the reference's velocity
  double observer = 1;      ///< disturbance observer
  double observer_hz = 12;  ///< its bandwidth [Hz]
  double learning = 1;      ///< what was learned in earlier repetitions

  /// Moves towards `target`, by all but 2 % of the way in 0.2 s, so that a change is no step in the force; not
  /// at all where dt is not above 0.
  ///
  /// Real-time.
  void approach(const Tuning& target, double dt) noexcept {
    constexpr double kTimeConstant = 0.05;  // [s]
    const double blend = -std::expm1(-std::max(0.0, dt) / kTimeConstant);
    gains.kp += blend * (target.gains.kp - gains.kp);
    gains.kd += blend * (target.gains.kd - gains.kd);
    for (const auto share : {&Tuning::inertia, &Tuning::gravity, &Tuning::friction, &Tuning::observer,
                             &Tuning::observer_hz, &Tuning::learning})
      this->*share += blend * (target.*share - this->*share);
  }
};

}  // namespace haptrace
