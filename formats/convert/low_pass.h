// Low-pass filter for samples that are to be thinned out. Private to formats: use resample().
#pragma once

#include "control/sample.h"

#include <span>
#include <vector>

namespace haptrace {

/// Removes frequencies that a lower rate cannot represent from evenly sampled movement. Left in, they would alias: they
/// would look like slow movement that never happened.
///
/// The kernel is symmetric, so it adds no delay: an ideal low pass under a Kaiser window (Oppenheim and Schafer,
/// Discrete-Time Signal Processing, 7.5 and 7.6). For a cut-off f, the gain is 1 to within 0.1 % up to 0.8 f, one half
/// at f, and below 0.1 % from 1.2 f on. Near an end and beside missing values, the kernel shrinks to the shorter side
/// and attenuates less.
///
/// It filters position, velocity, forces, torque, references and orientations. All other values of a sample stay.
/// Threads: one thread at a time. Real-time: no.
class LowPass {
 public:
  /// Requires 0 < cutoff_hz < rate_hz / 2.
  LowPass(double cutoff_hz, double rate_hz);

  /// Returns the half-width of the kernel [samples].
  [[nodiscard]] std::size_t reach() const noexcept { return reach_; }

  /// Returns sample `at`, filtered. `samples` must follow each other at the rate without a gap. Samples farther away
  /// than reach() need not be present. If nearer ones are absent, the kernel shrinks.
  [[nodiscard]] Sample at(std::span<const Sample> samples, std::size_t at);

 private:
  void weigh(std::size_t reach);

  double step_;  ///< phase of the ideal low pass per sample [rad]
  std::size_t reach_;
  std::vector<double> window_;   ///< by distance / reach
  std::vector<double> weights_;  ///< by distance [samples], for the last reach that was passed to weigh()
};

}  // namespace haptrace
