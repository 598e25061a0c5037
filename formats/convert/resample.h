// An even time base for a log that has none. On request only: it makes up rows that were never measured.
#pragma once

#include "control/path/trajectory.h"
#include "formats/recording/recording_stream.h"

#include <optional>

namespace haptrace {

struct ResampleOptions {
  double rate_hz = 1000;
  Interpolation method = Interpolation::cubic;
  double max_gap = 0;  ///< [s] longest step that is bridged; 0: 20 median steps of the first thousands of rows

  /// Cut-off of the low pass [Hz]; 0: none. Without a value it is rate_hz / 2.4 when the new rate is lower than the old
  /// one, so that nothing above half the new rate is left, else none.
  std::optional<double> low_pass_hz = {};
};

/// What was done.
struct ResampleReport {
  std::uint64_t rows_in = 0, rows_out = 0;
  std::uint64_t duplicates = 0;        ///< rows dropped: their stamp equals that of the row before
  std::uint64_t backward = 0;          ///< rows dropped: their stamp lies before that of an earlier row
  std::uint64_t without_position = 0;  ///< rows dropped: their position is not finite
  std::uint64_t gaps = 0;              ///< steps that were too long to be bridged
  double longest_gap = 0;              ///< [s]
  double max_gap = 0;                  ///< [s] the longest step that would have been bridged
  double low_pass_hz = 0;              ///< cut-off; 0: none

  /// Of the new curve from the samples, at their stamps; with a low pass, of the new rows from what they would be
  /// without it [m].
  double rms_difference = 0;
  double max_difference = 0;   ///< [m]
  std::uint64_t compared = 0;  ///< samples, or rows, of which that was measured
};

/// Samples at t0 + k / rate, t0 the first stamp, tick = k. Between two samples
///   position     by a Trajectory of `method` through the positions. It sees 64 samples beyond those it is asked about,
///                and before a beginning and after an end their point reflection, so that it starts and ends without
///                acceleration. The influence of a sample on a cubic spline falls by 0.27 with every sample in between:
///                nothing of 64 is left in a double.
///   velocity     linear where there is one, else that of the trajectory
///   forces, torque, references, progress   linear; NaN unless both sides have them
///   orientation  slerp
///   phase, buttons, latency   the last sample's
/// `hold` takes everything from the last sample. Nothing is put into steps longer than max_gap: they stay gaps in time
/// and tick. A low pass (formats/convert/low_pass.h) works on a grid that is as many times as fine as the source needs,
/// and every n-th row of that is kept: movement and noise above half the new rate would fold back.
///
/// The source may have stamps in any order.
class ResampledSource : public RecordingSource {
 public:
  [[nodiscard]] virtual const ResampleReport& report() const = 0;  ///< complete once next() was empty
};

/// Throws Error(input) when the rate is not from 1 Hz to 1 MHz, max_gap is negative, or low_pass_hz is negative or not
/// below half the rate of the source and the new one.
std::unique_ptr<ResampledSource> resample(std::unique_ptr<RecordingSource> source, const ResampleOptions& options);

}  // namespace haptrace
