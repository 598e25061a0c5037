// Shapes to follow, as paths.
#pragma once

#include "control/path.h"

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// What every shape understands. Lengths in m, times in s, angles in rad.
struct ShapeOptions {
  double size = 0.08;      ///< side of the square, diameter of circle and spiral, length of line, reach and figure eight
  double duration = 4;     ///< of one turn, or of the movement there (and back, for the line)
  double rate_hz = 1000;   ///< samples per second of the path
  double blend = 0.005;    ///< corner radius of the square; 0 keeps sharp corners
  int turns = 1;           ///< of circle, figure eight and spiral; times round the square; times along the line
  Vec3 center = Vec3::Zero();
  std::string plane = "xy";  ///< "xy", "yz" or "zx": first axis to the right, second upwards
  double angle = 0;          ///< of line and reach in the plane
  bool constant_speed = false;  ///< instead of one minimum-jerk movement along the arc
};

/// square: the frame of Basdogan and Srinivasan's worked example, from its lower left corner, counterclockwise;
/// circle: counterclockwise from its rightmost point; line: there and back through the centre; figure8: the lemniscate
/// of Gerono; reach: a minimum-jerk reach from the centre; spiral: Archimedean, from the centre outwards.
std::vector<std::string> shape_names();

/// Positions with exact velocities. Equal steps of time; arc length follows one minimum-jerk movement over the whole
/// duration * turns unless constant_speed. Throws Error(input) naming the option that is out of its range, or the
/// nearest shape.
Path make_shape(std::string_view name, const ShapeOptions& options);

}  // namespace haptrace
