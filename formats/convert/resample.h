// Resampling of a log to an even time base. Only on request, since it creates samples that were never measured.
#pragma once

#include "control/path/trajectory.h"
#include "formats/recording/recording_stream.h"

#include <optional>

namespace haptrace {

struct ResampleOptions {
  double rate_hz = 1000;
  Interpolation method = Interpolation::cubic;
  double max_gap = 0;  ///< [s] longest step to interpolate; 0: 20 median steps of the first block of samples

  /// Cut-off of the low-pass filter [Hz]; 0: no filter. Absent: rate_hz / 2.4 if the new rate is lower than the old
  /// one, so that nothing above half the new rate remains; otherwise no filter.
  std::optional<double> low_pass_hz = {};
};

struct ResampleReport {
  std::uint64_t rows_in = 0, rows_out = 0;
  std::uint64_t duplicates = 0;        ///< rows dropped since their stamp equals that of the row before
  std::uint64_t backward = 0;          ///< rows dropped since their stamp lies before that of an earlier row
  std::uint64_t without_position = 0;  ///< rows dropped since their position is not finite
  std::uint64_t gaps = 0;              ///< steps that were too long to interpolate
  double longest_gap = 0;              ///< [s]
  double max_gap = 0;                  ///< [s] longest step that was allowed
  double low_pass_hz = 0;              ///< [Hz] cut-off; 0: no filter

  /// Rms distance of the new curve from the samples at their stamps. With a low-pass filter: of the new samples from
  /// the unfiltered ones [m].
  double rms_difference = 0;
  double max_difference = 0;   ///< [m]
  std::uint64_t compared = 0;  ///< number of distances measured
};

/// Resamples to t0 + k / rate, with t0 the first stamp and tick = k. Values between two samples:
///   position     from a Trajectory of `method` through the positions. It sees 64 samples beyond the evaluated ones.
///                Before a beginning and after an end it sees the samples' point reflection, so that it starts and
///                ends without acceleration. The influence of a sample on a cubic spline falls by a factor of 0.27
///                per sample, so after 64 samples nothing of it is left in a double.
///   velocity     linear if the source has it, otherwise from the trajectory
///   forces, torque, references, progress, tunnel radius   linear; NaN unless both sides have a value
///   orientation  slerp
///   phase, buttons, latency   from the last sample
/// `hold` takes everything from the last sample. Steps longer than max_gap are not filled: they stay gaps in time and
/// tick. A low-pass filter (formats/convert/low_pass.h) works on a finer grid, a multiple of the new rate that is at
/// least as fine as the source, and every n-th sample is kept. Otherwise movement and noise above half the new rate
/// would alias.
///
/// The source may have stamps in any order.
class ResampledSource : public RecordingSource {
 public:
  [[nodiscard]] virtual const ResampleReport& report() const = 0;  ///< complete once next() has returned no samples
};

/// Throws Error(input) if the rate is not from 1 Hz to 1 MHz, max_gap is negative, or low_pass_hz is negative or not
/// below half the rate of the grid that the filter works on.
std::unique_ptr<ResampledSource> resample(std::unique_ptr<RecordingSource> source, const ResampleOptions& options);

}  // namespace haptrace
