// Settings of a tracking law that can change while it runs.
#pragma once

#include "base/types.h"
#include "control/filters.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace haptrace {

/// Gains per axis of W.
struct PdGains {
  Vec3 kp = Vec3::Zero();  ///< proportional gain [N/m]
  Vec3 kd = Vec3::Zero();  ///< derivative gain [N s/m]
};

/// Gains that are equal in every direction: the inertia of a wrist is hardly known, and nearly isotropic.
struct OrientationGains {
  double kp = 0;  ///< [N m/rad]
  double kd = 0;  ///< [N m s/rad]

  bool operator==(const OrientationGains&) const = default;
};

/// Largest gains. Higher ones are a mistake: no device that a hand can hold withstands them.
inline constexpr double kLargestKp = 1e5;  // [N/m]
inline constexpr double kLargestKd = 1e3;  // [N s/m]

/// Throws Error(input) naming the gain that is negative, not finite, or beyond the largest.
void validate(const PdGains& gains);

/// Gains, and the share of each compensation that acts, from 0 (none) to 1 (all). Plain data, to be posted through a
/// Mailbox. The share of a compensation that the session does not contain has no effect.
struct Tuning {
  PdGains gains;
  double inertia = 1;       ///< feedforward of mass times the reference's acceleration
  double gravity = 1;       ///< feedforward of gravity along the reference
  double friction = 1;      ///< feedforward of friction along the reference's velocity
  double cogging = 1;       ///< feedforward of the force that repeats over the place, along the reference
  double observer = 1;      ///< disturbance observer
  double observer_hz = 12;  ///< bandwidth of the disturbance observer [Hz]
  double learning = 1;      ///< force learned in earlier repetitions

  /// Moves towards `target`, by all but 2 % of the difference in 0.2 s, so that a change makes no step in the force.
  /// Does not move if dt is not above 0.
  ///
  /// Real-time.
  void approach(const Tuning& target, double dt) noexcept {
    const double blend = setting_share(dt);
    gains.kp += blend * (target.gains.kp - gains.kp);
    gains.kd += blend * (target.gains.kd - gains.kd);
    for (const auto share : {&Tuning::inertia, &Tuning::gravity, &Tuning::friction, &Tuning::cogging, &Tuning::observer,
                             &Tuning::observer_hz, &Tuning::learning})
      this->*share += blend * (target.*share - this->*share);
  }
};

/// The compensations that a session is composed of. Only those can be tuned.
struct Compensations {
  bool inertia = false, gravity = false, friction = false, observer = false, learning = false, cogging = false;

  bool operator==(const Compensations&) const = default;
};

/// A compensation by its name in options, commands and reports.
struct CompensationTerm {
  const char* name;
  bool Compensations::*composed;
  double Tuning::*share;
  bool feedforward;
};
inline constexpr std::array<CompensationTerm, 6> kCompensationTerms{
    {{"inertia", &Compensations::inertia, &Tuning::inertia, true},
     {"gravity", &Compensations::gravity, &Tuning::gravity, true},
     {"friction", &Compensations::friction, &Tuning::friction, true},
     {"cogging", &Compensations::cogging, &Tuning::cogging, true},
     {"observer", &Compensations::observer, &Tuning::observer, false},
     {"learning", &Compensations::learning, &Tuning::learning, false}}};

/// Returns the names of the compensations that `composed` has, or that it lacks.
std::vector<std::string> names_of(const Compensations& composed, bool present = true);

}  // namespace haptrace
