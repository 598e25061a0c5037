// High-pass filtered magnitude of a signal in space.
#pragma once

#include "control/filters.h"

namespace haptrace {

inline constexpr double kRippleCutoff = 25;  ///< forces and positions above it are ripple [Hz]

/// Applies a fourth-order Linkwitz-Riley high pass (two equal Butterworth sections) to each axis.
///
/// Real-time: all but the constructor.
class Ripple {
 public:
  Ripple(double cutoff_hz, double rate_hz)
      : first_(FilterKind::high_pass, cutoff_hz, rate_hz), second_(FilterKind::high_pass, cutoff_hz, rate_hz) {}

  /// The squared magnitude of what passes. To be called at every sample, so that it is settled when it counts.
  double update(const Vec3& x) noexcept { return second_.update(first_.update(x)).squaredNorm(); }

 private:
  BasicButterworth2<Vec3> first_, second_;
};

}  // namespace haptrace
