// Time of a device that runs on virtual time.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace haptrace {

/// Counts a device's time in whole nanoseconds, so that hours of ticks do not drift and instants compare exactly. Each
/// step carries its remainder below a nanosecond to the next step.
class NanoTime {
 public:
  [[nodiscard]] std::int64_t ns() const noexcept { return ns_; }

  /// Advances by `dt` [s] and returns the new time. Ignores a step that is not positive and finite, and limits a step
  /// to one hour.
  std::int64_t advance(double dt) noexcept {
    if (!(dt > 0) || !std::isfinite(dt)) return ns_;
    const double span = std::min(dt, 3600.0) * 1e9 + carry_;
    const auto whole = static_cast<std::int64_t>(std::floor(span + 0.5));
    carry_ = span - static_cast<double>(whole);
    return ns_ += whole;
  }

 private:
  std::int64_t ns_ = 0;
  double carry_ = 0;  ///< remainder of the steps, at most half a nanosecond [ns]
};

}  // namespace haptrace
