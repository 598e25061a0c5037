// A force that is locked to the place: cogging of motors, and cables that press from pulley to pulley.
#pragma once

#include "base/statistics.h"
#include "base/types.h"

#include <cmath>
#include <vector>

namespace haptrace {

/// One plane wave of such a force. It pushes along its own direction, since the force of a place has a potential.
struct CoggingWave {
  Vec3 wave_number = Vec3::Zero();       ///< k, in W [rad/m]
  double cosine = 0, sine = 0;           ///< amplitudes [N]
  Vec3 wave_number_half = Vec3::Zero();  ///< half widths of the 95 % confidence interval of k [rad/m]
  double amplitude_half = 0;             ///< the same of the amplitude [N]

  [[nodiscard]] double amplitude() const noexcept { return std::hypot(cosine, sine); }
};

/// The force of the mechanism that repeats over the place x,
///
///     sum_i s_i k_i / |k_i| (cosine_i cos(k_i d) + sine_i sin(k_i d)),   d = x - centre,
///
/// on the handle like gravity. The wave numbers are uncertain, so that far from the centre the phase is: s_i =
/// exp(-v / 2), with the variance v = sum_j (half_ij d_j / 1.96)^2 of the phase, leaves the smallest mean square error.
struct Cogging {
  Vec3 centre = Vec3::Zero();      ///< [m]
  std::vector<CoggingWave> waves;  ///< with k above zero

  /// Returns the force at `position` [N], of which the device is `off` [m]. A wave whose phase is another there fades
  /// by exp(-(k off)^2 / 2).
  ///
  /// Real-time.
  [[nodiscard]] Vec3 force(const Vec3& position, const Vec3& off = Vec3::Zero()) const noexcept {
    const Vec3 d = position - centre;
    Vec3 sum = Vec3::Zero();
    for (const CoggingWave& wave : waves) {
      const Vec3& k = wave.wave_number;
      const double phase = k.dot(d), other = k.dot(off);
      const double variance = (wave.wave_number_half / kInterval95).cwiseProduct(d).squaredNorm() + other * other;
      const double value = wave.cosine * std::cos(phase) + wave.sine * std::sin(phase);
      sum += std::exp(-0.5 * variance) * value / std::sqrt(k.squaredNorm()) * k;
    }
    return sum;
  }
};

}  // namespace haptrace
