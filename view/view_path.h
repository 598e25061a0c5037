// A path as the live view shows it.
#pragma once

#include "base/types.h"

#include <vector>

namespace haptrace {

/// A path with its tunnel. All members have the same length.
struct ViewPath {
  std::vector<double> time;    ///< [s]
  std::vector<Vec3> position;  ///< in W [m]
  std::vector<double> radius;  ///< of the tunnel [m]; empty: no tunnel
};

}  // namespace haptrace
