// Velocity estimation from quantised positions: several methods, because each trades noise against delay.
#pragma once

#include "base/types.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Largest coordinate that counts as a measurement [m]. Beyond it, the servo loop ends the session.
inline constexpr double kFarthestPosition = 1e6;

/// One estimator with its memory. Axes are independent. It works on steps of position and time, never on their sums, so
/// that it is as accurate after a day and metres away as in the first second at the origin.
///
/// All estimators obey these laws (tests/control). A constant position gives exactly zero in the end. A ramp gives its
/// slope in the end, whatever the steps of time. Estimates scale with the positions (foaw: and its resolution). If dt
/// <= 0 or the position is not finite, nothing changes and the previous estimate is returned. The estimate is always
/// finite. reset() forgets everything. To that end, a position farther than kFarthestPosition and a dt outside 1 ns to
/// 1e6 s are not measurements either. Steps and memories below 1e-100 are zero, long before they would cost denormal
/// arithmetic.
///
/// Real-time: update and reset. Threads: one at a time.
class VelocityEstimator {
 public:
  virtual ~VelocityEstimator() = default;

  /// Returns the estimate [m/s] after `position` [m], `dt` [s] after the previous one. For the first position since
  /// construction or reset, dt is ignored and the estimate is zero.
  virtual Vec3 update(const Vec3& position, double dt) noexcept = 0;

  /// Forgets everything; the next position is the first, and its velocity is zero.
  virtual void reset() noexcept = 0;
};

/// Makes an estimator for a servo loop of `rate_hz` from `spec`, `name[:parameter]`:
///
///   difference            first difference, (x_k - x_{k-1}) / dt. Lags by dt / 2
///   lowpass[:100]         first difference through a two-pole Butterworth low pass, cut-off f in Hz
///   foaw[:8]              first-order adaptive windowing with end fit, longest window in steps
///   least-squares[:8]     slope of the least-squares line through the last n positions. Lags by (n - 1) dt / 2
///   alpha-beta-gamma[:60] steady-state Kalman filter of white jerk and white position noise, bandwidth in Hz
///
/// lowpass is the exact response of the continuous filter to velocities that are constant between samples, for any dt.
/// It lags by sqrt(2) / (2 pi f) and turns into the difference as the cut-off passes the Nyquist frequency. foaw is
/// from Janabi-Sharifi, Hayward and Chen, IEEE Trans. Control Systems Technology 8(6), 2000. alpha-beta-gamma has
/// third-order Butterworth poles of that bandwidth as dt goes to zero, does not lag behind a constant acceleration, and
/// is the difference from the Nyquist frequency on. Its gains are those of Kalata, IEEE Trans. Aerospace and Electronic
/// Systems 20(2), 1984.
///
/// A frequency may have a unit, as in lowpass:1kHz. `resolution` [m] is the position resolution, the noise band of
/// foaw; with 0, foaw is the difference. Coefficients are computed for 1 / rate_hz, and again when dt changes. Throws
/// Error(input) naming the part of the spec, or the argument, that is out of its range.
std::unique_ptr<VelocityEstimator> make_velocity_estimator(std::string_view spec, double rate_hz, double resolution);

/// Returns the names that a spec may have.
std::vector<std::string> velocity_estimator_names();

}  // namespace haptrace
