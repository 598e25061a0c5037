// A force that excites many frequencies at once without ever being large.
#pragma once

#include "base/types.h"

#include <array>
#include <vector>

namespace haptrace {

/// One line of a multi-sine.
struct SpectralLine {
  double frequency_hz = 0;
  double amplitude = 0;  ///< share of the rms: the squares of an axis' lines sum to 2
  double phase = 0;      ///< [rad]
};

/// A sum of cosines for each axis of W, of rms 1 on every axis that has lines; no two axes share a frequency, so that
/// an axis' part in a response shows. Phases are Schroeder's (IEEE Trans. Information Theory 16(1), 1970), which keep
/// the peaks low. It repeats after period(), and no line is a multiple of 2 / period(), which is left to whatever moves
/// slowly meanwhile.
///
/// Real-time: value.
class Multisine {
 public:
  /// Lines at odd multiples of 1 / `period` from `low_hz` to `high_hz`, dealt to `axes` in turn; a line's velocity
  /// response of a mass falls as the square root of its frequency. Throws Error(input) when an axis would have fewer
  /// than four lines.
  Multisine(double low_hz, double high_hz, double period, const std::array<bool, 3>& axes);

  /// At `time` [s].
  [[nodiscard]] Vec3 value(double time) const noexcept;

  [[nodiscard]] const std::vector<SpectralLine>& lines(int axis) const { return lines_.at(static_cast<size_t>(axis)); }
  [[nodiscard]] double period() const noexcept { return period_; }

 private:
  std::array<std::vector<SpectralLine>, 3> lines_;
  double period_;
};

}  // namespace haptrace
