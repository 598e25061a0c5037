// Times of the protocol: seconds as numbers, whole nanoseconds inside. Private to view.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace haptrace {

/// Returns a time in seconds, rounded once: 1.001 s stays 1.001.
inline double seconds(std::int64_t time_ns) noexcept {
  return static_cast<double>(time_ns) / 1e9;
}

/// Returns a time in nanoseconds, limited to what fits; 0 if it is not finite.
inline std::int64_t nanoseconds(double time) noexcept {
  constexpr double kMost = 9.2e9;  // [s]
  return std::isfinite(time) ? std::llround(1e9 * std::clamp(time, -kMost, kMost)) : 0;
}

}  // namespace haptrace
