// Amplitudes of an experiment at given frequencies.
#pragma once

#include "control/design/identification.h"

#include <span>
#include <vector>

namespace haptrace {

/// Estimates amplitudes in windows of one period of an excitation signal, beside a movement that repeats every half
/// period, by least squares instead of correlation, so that missed ticks do no harm.
class SpectrumEstimator {
 public:
  /// `frequencies` [Hz] are multiples of 1 / `period` [s] and, since the movement takes the even ones up to
  /// `movement_hz`, odd ones there.
  SpectrumEstimator(std::vector<double> frequencies, double period, double rate_hz, double movement_hz = 40);

  /// Adds the whole windows in `rows`. Leaves out those that lack more than a twentieth of their ticks.
  void add(std::span<const TickRow> rows);

  /// Returns the amplitudes of every window.
  [[nodiscard]] const std::vector<std::vector<LineResponse>>& windows() const noexcept { return windows_; }

  /// Returns the mean over the windows; no lines without a window.
  [[nodiscard]] LineSpectrum mean() const;

 private:
  void add_window(std::span<const TickRow> rows);

  std::vector<double> frequencies_;
  double period_, rate_hz_, movement_hz_;
  std::vector<std::vector<LineResponse>> windows_;
  double residual_ = 0, samples_ = 0;
};

}  // namespace haptrace
