// Excitation signal with many frequencies and low peaks.
#pragma once

#include "base/types.h"

#include <array>
#include <vector>

namespace haptrace {

/// One spectral line of a multisine.
struct SpectralLine {
  double frequency_hz = 0;
  double amplitude = 0;  ///< relative to the rms; the squares of the amplitudes of an axis sum to 2
  double phase = 0;      ///< [rad]
};

/// A sum of cosines for each axis of W, with rms 1 on every axis that has lines. No two axes share a frequency, so that
/// the contribution of each axis to a response is separable. The phases are Schroeder's (IEEE Trans. Information Theory
/// 16(1), 1970), which keep the peaks low. The signal repeats after period(). No line is a multiple of 2 / period(), so
/// that a slow movement of that period does not disturb the lines.
///
/// Real-time: value.
class Multisine {
 public:
  /// Places lines at odd multiples of 1 / `period` from `low_hz` to `high_hz`, at every other one above kDenseBelow,
  /// and assigns them to `axes` in turn. The amplitudes rise such that the velocity of a mass falls with the square
  /// root of the frequency. Throws Error(input) when an axis would have fewer than four lines.
  static constexpr double kDenseBelow = 15;  ///< [Hz]

  Multisine(double low_hz, double high_hz, double period, const std::array<bool, 3>& axes);

  /// Returns the signal at `time` [s].
  [[nodiscard]] Vec3 value(double time) const noexcept;

  [[nodiscard]] const std::vector<SpectralLine>& lines(int axis) const { return lines_.at(static_cast<size_t>(axis)); }
  /// Returns the frequencies of the lines of all axes, rising [Hz].
  [[nodiscard]] std::vector<double> frequencies() const;
  [[nodiscard]] double period() const noexcept { return period_; }

 private:
  std::array<std::vector<SpectralLine>, 3> lines_;
  double period_;
};

}  // namespace haptrace
