// Shapes to follow, as paths.
#pragma once

#include "control/path/path.h"

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// What every shape understands. Lengths in m, times in s, angles in rad. Ranges in brackets.
struct ShapeOptions {
  double size = 0.08;          ///< side of the square, diameter of circle and spiral, length of the others [1e-6, 10]
  double duration = 4;         ///< of one turn, or of the movement there (and back, for the line) [0.001, 1e6]
  double rate_hz = 1000;       ///< samples per second of the path [10, 20000]; at most 1e8 samples altogether
  double blend = 0.005;        ///< corner radius of the square [0, size / 2]; 0 keeps sharp corners
  int turns = 1;               ///< of circle, figure eight and spiral; times round the square; times along the line and
                               ///< back [1, 10000]. Reach and script have one
  Vec3 center = Vec3::Zero();  ///< [-10, 10] each
  std::string plane = "xy";    ///< "xy", "yz" or "zx": first axis to the right, second upwards
  double angle = 0;            ///< of line and reach in the plane, from the first axis to the second
  bool constant_speed = false;  ///< from the first sample to the last, instead of minimum-jerk movements along the arc
};

/// The names of the shapes:
///   square   the frame of Basdogan and Srinivasan's worked example, counterclockwise from its lower left corner; with
///            round corners from where that corner's arc ends and the lower side begins
///   circle   counterclockwise from its rightmost point
///   line     from one end through the centre to the other and back; at rest at both ends, so a minimum-jerk movement
///            each way
///   figure8  the lemniscate of Gerono, x = size / 2 sin q, y = size / 2 sin q cos q, q from 0 to 2 pi
///   reach    from the centre
///   spiral   Archimedean, from the centre counterclockwise outwards, ending to the right of the centre
///   script   eleven cursive loops along the first axis, counterclockwise, size / 6 wide and size / 4 high: the
///   trochoid
///            x = c q + size / 12 sin q, y = -size / 8 cos q. q runs evenly, as a hand writes, but for a first and a
///            last twelfth of the time in which its rate follows a minimum-jerk blend from and to rest: two loops a
///            second, 0.17 m/s at most and 2.1 m/s^2 for 0.108 m in 6 s
std::vector<std::string> shape_names();

/// Positions with exact velocities, at equal steps of time. But for line and script, the arc length follows one
/// minimum-jerk movement over the whole duration * turns. Closed shapes end exactly where they began. Throws
/// Error(input) naming the option that is out of its range, or the known shapes.
Path make_shape(std::string_view name, const ShapeOptions& options);

}  // namespace haptrace
