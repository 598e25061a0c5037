// A low pass without lag, for signals that are known to their end.
#pragma once

#include "base/types.h"

#include <vector>

namespace haptrace {

/// The share of its cut-off at which a second-order Butterworth filter that runs twice has a gain of 1 / sqrt(2):
/// (sqrt(2) - 1)^(1/4) (Winter, Biomechanics and Motor Control of Human Movement, 2.2.4).
inline constexpr double kTwoPasses = 0.80225;

/// Low-passes each axis of `rows`, sampled at `rate_hz`, by a second-order Butterworth filter that runs forwards and
/// backwards: no lag, and a gain of 1 / sqrt(2) at `cutoff_hz` for both passes together. Less the straight line between
/// its ends, the signal continues beyond both as its point reflection, so that it neither starts nor stops there.
///
/// Leaves fewer than two rows as they are. O(N). Threads: free function without state. Real-time: no; it allocates.
void zero_phase_low_pass(std::vector<Vec3>& rows, double cutoff_hz, double rate_hz);

}  // namespace haptrace
