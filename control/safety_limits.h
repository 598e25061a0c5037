// Limits on the forces and the speed of a session.
#pragma once

namespace haptrace {

/// Limits on the forces and the speed of a session. A limit of 0 is off.
struct SafetyLimits {
  double max_force = 0;             ///< magnitude [N]
  double max_continuous_force = 0;  ///< rms magnitude over continuous_time [N]
  double continuous_time = 10;      ///< time constant of the continuous limit [s]
  double max_torque = 0;            ///< magnitude [N m]
  double max_velocity = 0;          ///< tool speed beyond which the session stops [m/s]
  double soft_start = 0.25;         ///< time over which forces ramp up from zero at the start [s]
  double release = 0.25;            ///< time over which forces ramp down to zero at the end [s]
};

/// Throws Error(input) naming the limit that is negative or not finite.
void validate(const SafetyLimits& limits);

}  // namespace haptrace
