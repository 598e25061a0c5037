// The time of a virtual-time device.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace haptrace {

/// Counts a device's time in whole nanoseconds, so that hours of ticks do not drift and instants compare exactly.
/// What a step leaves below a nanosecond is carried to the next.
class NanoTime {
 public:
  [[nodiscard]] std::int64_t ns() const noexcept { return ns_; }

  /// Advances by `dt` [s] and returns the new time. A step that is not positive and finite does not advance; one longer
  /// than an hour is an hour.
  std::int64_t advance(double dt) noexcept {
    if (!(dt > 0) || !std::isfinite(dt)) return ns_;
    const double span = std::min(dt, 3600.0) * 1e9 + carry_;
    const auto whole = static_cast<std::int64_t>(std::floor(span + 0.5));
    carry_ = span - static_cast<double>(whole);
    return ns_ += whole;
  }

 private:
  std::int64_t ns_ = 0;
  double carry_ = 0;  ///< [ns], within half a nanosecond
};

}  // namespace haptrace
