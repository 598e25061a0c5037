// The minimum-jerk movement (Flash and Hogan 1985): s(u) = 10 u^3 - 15 u^4 + 6 u^5, u = t / T in [0, 1].
#pragma once

namespace haptrace {

/// A rest-to-rest blend from 0 to 1 and its derivatives with respect to u.
struct MinJerk {
  double s, ds, dds;

  /// Largest ds over u: the peak speed is 15/8 of the mean speed.
  static constexpr double kPeakSpeed = 1.875;

  static constexpr MinJerk at(double u) noexcept {
    if (!(u > 0)) return {0, 0, 0};
    if (u >= 1) return {1, 0, 0};
    const double u2 = u * u, v = 1 - u;
    return {u2 * u * (10 + u * (6 * u - 15)), 30 * u2 * v * v, 60 * u * v * (1 - 2 * u)};
  }
};

}  // namespace haptrace
