// Length of a vector, at the cost of a square root, and vectors of at most a length.
#pragma once

#include "base/types.h"

#include <cmath>

namespace haptrace {

/// Returns |v|, in the unit of v, for every finite v. The square of a component may overflow or vanish where the length
/// does not; only then the vector is scaled first, which takes five times as long. Real-time.
[[nodiscard]] inline double norm_of(const Vec3& v) noexcept {
  constexpr double kSmallest = 1e-280, kLargest = 1e280;  // between them the sum of squares keeps all of its digits
  const double square = v.squaredNorm();
  if (square > kSmallest && square < kLargest) return std::sqrt(square);
  return v.x() == 0 && v.y() == 0 && v.z() == 0 ? 0 : v.stableNorm();
}

/// Returns `v`, shortened to the length `most` >= 0 if it is longer. Real-time.
[[nodiscard]] inline Vec3 shortened(const Vec3& v, double most) noexcept {
  const double length = norm_of(v);
  return length > most ? Vec3(most / length * v) : v;
}

}  // namespace haptrace
