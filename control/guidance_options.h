// Options of guidance along a path.
#pragma once

#include <optional>

namespace haptrace {

/// Help along the path, see PaceHelp.
struct PaceHelpOptions {
  double pace = 1;       ///< factor on the expert's speed
  double margin = 0.2;   ///< share of that speed by which the trainee may be slower without help
  double gain = 20;      ///< [N s/m]
  double max_force = 1;  ///< [N]
};

/// Back wall, see BackWall.
struct BackWallOptions {
  double wait = 2;         ///< time for which it waits for the trainee to start [s]
  double stiffness = 150;  ///< [N/m]
  double max_force = 2;    ///< [N]
  double pace = 0.8;       ///< speed of the wall, relative to the expert's
};

/// Course of a session of guidance, see GuidanceController.
struct GuidanceOptions {
  bool cursor = false;      ///< the place on the path is a cursor that moves in the expert's time, else the trainee's
  bool allow_back = false;  ///< the walls let the trainee go back
  double speed = 1;         ///< speed of the cursor, relative to the expert's
  double wait = 0;          ///< distance at which the cursor waits for the trainee [m]; 0: never
  int repetitions = 1;      ///< 0: until stopped
  double hold = 0.5;        ///< pause at the end of every repetition [s]
  double approach_speed = 0.1;  ///< peak speed of the movement to the start [m/s]
  double time_limit = 0;        ///< time limit of a repetition [s]; 0: none
  double max_deviation = 0.1;   ///< distance from the path beyond which the session stops [m]
  /// Distance from the reference during the approach beyond which the session stops [m]; max_deviation when absent.
  std::optional<double> max_approach_deviation;
  bool tunnel = true;   ///< samples have the radius of the tunnel
  bool led = true;      ///< a force leads the hand to the start; else no force is sent during the approach
  double patience = 0;  ///< how long a hand may resist on the path [s], see Command; kPatience during the approach
  double rate_hz = 1000;
  double resolution = 0;  ///< position resolution of the device [m]
};

/// Throws Error(input) that names the option that is out of range.
void validate(const GuidanceOptions& options);
void validate(const BackWallOptions& options);

}  // namespace haptrace
