// The low pass before samples are thinned out. Private to formats: resample() is the way in.
#pragma once

#include "control/sample.h"

#include <span>
#include <vector>

namespace haptrace {

/// Takes out of evenly sampled movement what a lower rate cannot hold. Left in, it would come back as slow movement
/// that never was (aliasing).
///
/// A symmetric kernel, so nothing is late: an ideal low pass under a Kaiser window (Oppenheim and Schafer,
/// Discrete-Time Signal Processing, 7.5 and 7.6). For a cut-off f: gain 1 to within 0.1 % up to 0.8 f, one half at f,
/// below 0.1 % from 1.2 f on. Near an end and beside values that are missing it reaches no farther than the shorter
/// side does; there it passes more.
///
/// Position, velocity, forces, torque, references and orientations are filtered; all else is the sample's own.
/// Threads: one thread at a time. Real-time: no.
class LowPass {
 public:
  /// 0 < cutoff_hz < rate_hz / 2.
  LowPass(double cutoff_hz, double rate_hz);

  /// How far samples influence each other, to either side [samples].
  [[nodiscard]] std::size_t reach() const noexcept { return reach_; }

  /// Sample `at` of `samples`, which follow each other at the rate without a gap, filtered. Those beyond reach() need
  /// not be there; nearer ones that are not there are taken not to exist.
  [[nodiscard]] Sample at(std::span<const Sample> samples, std::size_t at);

 private:
  void weigh(std::size_t reach);

  double step_;  ///< phase of the ideal low pass from sample to sample [rad]
  std::size_t reach_;
  std::vector<double> window_;   ///< by the distance over the reach
  std::vector<double> weights_;  ///< by the distance in samples, for the reach that weigh() was last told
};

}  // namespace haptrace
