// Standard shapes as paths.
#pragma once

#include "control/path/path.h"

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace haptrace {

/// Settings of a shape. Lengths in m, times in s, angles in rad; ranges in brackets.
struct ShapeOptions {
  double size = 0.08;     ///< side of the square, diameter of circle and spiral, length of the others [1e-6, 10]
  double duration = 4;    ///< duration of one turn or one movement (line: out and back) [0.001, 1e6]
  double rate_hz = 1000;  ///< samples per second of the path [10, 20000]; at most 1e8 samples in total
  double blend = 0.005;   ///< corner radius of the square [0, size / 2]; 0 keeps sharp corners
  int turns = 1;          ///< turns of circle, figure eight and spiral; rounds of the square; round trips of the line
                          ///< [1, 10000]. Reach and script have one
  Vec3 centre = Vec3::Zero();   ///< [-10, 10] each
  std::string plane = "xy";     ///< "xy", "yz" or "zx": the first axis points right, the second up
  double angle = 0;             ///< direction of line and reach in the plane, from the first axis towards the second
  bool constant_speed = false;  ///< from the first sample to the last, instead of minimum-jerk movements along the arc
};

/// Returns the axes of W that point right and up in the plane "xy", "yz" or "zx". Throws Error(input) for another one.
std::pair<Vec3, Vec3> plane_axes(std::string_view plane);

/// Returns the names of the shapes:
///   square   the frame of Basdogan and Srinivasan's worked example, counterclockwise from its lower left corner; with
///            round corners it starts where the arc of that corner ends and the lower side starts
///   circle   counterclockwise from its rightmost point
///   line     from one end through the centre to the other and back; at rest at both ends, so one minimum-jerk movement
///            in each direction
///   figure8  the lemniscate of Gerono, x = size / 2 sin q, y = size / 2 sin q cos q, q from 0 to 2 pi
///   reach    a straight line from the centre
///   spiral   Archimedean, from the centre counterclockwise outwards; it ends to the right of the centre
///   script   eleven cursive loops along the first axis, counterclockwise, size / 6 wide, size / 4 high; the trochoid
///            x = c q + size / 12 sin q, y = -size / 8 cos q. The rate of q is constant, as in handwriting, except in
///            the first and last twelfth of the time, where it follows a minimum-jerk blend from and to rest. A script
///            of 0.108 m in 6 s has two loops per second, at most 0.17 m/s and 2.1 m/s^2
std::vector<std::string> shape_names();

/// Returns positions with exact velocities, at equal time steps. For all shapes but line and script, the arc length
/// follows one minimum-jerk movement over the whole duration * turns. Closed shapes end exactly where they start.
/// Throws Error(input) naming the option that is out of range, or the known shapes.
Path make_shape(std::string_view name, const ShapeOptions& options);

}  // namespace haptrace
