// How wide a tunnel is along a path.
#pragma once

#include <string>
#include <vector>

namespace haptrace {

/// Straight lines between places; beyond the first and last as wide as there.
struct RadiusProfile {
  std::vector<double> s;       ///< arc lengths from the path's start, strictly increasing [m]
  std::vector<double> radius;  ///< there [m]

  [[nodiscard]] double at(double place) const;  ///< [m]
};

/// Reads {"s": [...], "radius": [...]}, both in m. Throws Error(input) naming the file and the key: another type, no
/// place, unequal numbers, places that do not increase, a radius that is not from 0 to 1 m.
RadiusProfile load_radius_profile(const std::string& file);

}  // namespace haptrace
