// Options of a playback.
#pragma once

#include "control/tuning.h"

#include <array>
#include <optional>
#include <string_view>

namespace haptrace {

/// Reaction of a playback when the hand is farther from the reference than allowed.
enum class DeviationPolicy {
  stop,    ///< the session ends and the force fades
  pause,   ///< the reference waits, also during the approach, until the hand is back within half the limit
  soften,  ///< the reference continues; the force grows no further than at the limit
};

DeviationPolicy parse_deviation_policy(std::string_view name);  ///< throws Error(input)
const char* to_string(DeviationPolicy policy) noexcept;

struct PlaybackOptions {
  double speed = 1;             ///< speed relative to the path's own time
  int repetitions = 1;          ///< 0: until stopped
  double hold = 0.5;            ///< pause at the end of every repetition [s]
  double approach_speed = 0.1;  ///< peak speed of the movement to the start [m/s]
  double max_deviation = 0.03;  ///< largest distance from the reference [m]
  DeviationPolicy on_deviation = DeviationPolicy::stop;
  double rate_hz = 1000;  ///< rate of the servo loop [Hz]
  /// Largest feedback force while the session is softened, as a multiple of the share that is left [N]; 0: no limit.
  /// The deviation grows as the gains fall, so the gains alone would not soften the force.
  double softened_force = 0;
  std::array<bool, 3> axes{true, true, true};  ///< axes that the device can drive; the others have no reference
};

/// Throws Error(input) that names the option that is out of range.
void validate(const PlaybackOptions& options);

/// Settings for following a path's orientations. They apply if the path has orientations and the device takes torque
/// about every axis.
struct TurnOptions {
  bool off = false;
  std::optional<OrientationGains> gains;  ///< absent: cautious_orientation_gains
  double max_deviation = 1;               ///< angle to the reference orientation [rad]
};

/// Returns gains that reach `max_torque` [N m] at 20 degrees, with kd = 20 ms * kp.
OrientationGains cautious_orientation_gains(double max_torque);

/// Settings of the law that turns the tool along a path's orientations (OrientationFollower).
struct OrientationOptions {
  OrientationGains gains;
  double max_deviation = 1;  ///< largest angle to the reference [rad]
  double rate_hz = 1000;     ///< rate of the servo loop [Hz]
};

}  // namespace haptrace
