// Width of a tunnel along a path.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// Radius over arc length: linear between the points, and constant before the first and after the last.
struct RadiusProfile {
  std::vector<double> s;       ///< arc lengths from the path's start, strictly increasing [m]
  std::vector<double> radius;  ///< radius at these arc lengths [m]

  [[nodiscard]] double at(double place) const;  ///< radius at an arc length [m]
};

/// Reads {"s": [...], "radius": [...]}, both in m. Throws Error(input) naming the file and the key if a value has the
/// wrong type, there is no value, the arrays differ in length, arc lengths do not increase, or a radius is not from 0
/// to 1 m.
RadiusProfile load_radius_profile(const std::string& file);

}  // namespace haptrace
