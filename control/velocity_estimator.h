// Velocity from quantised positions: a family, because each trades noise against delay.
#pragma once

#include "control/types.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// One estimator with its memory.
///
/// Laws that every member keeps (tests/control): a constant position gives exactly zero in the end; a ramp gives its
/// slope in the end; it is linear in scale where it says so; dt <= 0 or a position that is not finite changes nothing
/// and answers the previous estimate; the estimate is always finite; after reset it has forgotten everything.
///
/// Real-time: update and reset. Threads: one at a time.
class VelocityEstimator {
 public:
  virtual ~VelocityEstimator() = default;

  /// The estimate [m/s] after seeing `position` [m], `dt` [s] after the previous one.
  virtual Vec3 update(const Vec3& position, double dt) noexcept = 0;

  /// Forgets; the next position is the first, and its velocity is zero.
  virtual void reset() noexcept = 0;
};

/// Makes an estimator for a servo loop of `rate_hz` from `spec`, `name[:parameter]`:
///   difference            first difference, (x_k - x_{k-1}) / dt
///   lowpass[:100]         first difference through a two-pole Butterworth low pass, cut-off in Hz
///   foaw[:8]              first-order adaptive windowing, longest window in samples (Janabi-Sharifi, Hayward, Chen 2000)
///   least-squares[:8]     slope of the least-squares line over a window in samples
///   alpha-beta-gamma[:60] steady-state Kalman filter of a white-jerk model, bandwidth in Hz
/// `resolution` [m] is the position quantum, the noise band of foaw. Throws Error(input).
std::unique_ptr<VelocityEstimator> make_velocity_estimator(std::string_view spec, double rate_hz, double resolution);

/// What the spec's names are.
std::vector<std::string> velocity_estimator_names();

}  // namespace haptrace
