// The place nearest to a goal that planes allow.
#pragma once

#include "base/types.h"

#include <array>
#include <cstddef>

namespace haptrace {

/// Up to four planes, of which a place must be in front.
struct ConstraintPlanes {
  std::array<Vec3, 4> normal{};
  std::array<double, 4> height{};  ///< normal . place >= height
  std::size_t count = 0;
};

/// Returns the place nearest to `goal` in front of all planes: the solution of the quadratic programme of the god
/// object, by trying the few sets of planes that can be active. Real-time.
Vec3 nearest_in_front(const Vec3& goal, const ConstraintPlanes& planes) noexcept;

}  // namespace haptrace
