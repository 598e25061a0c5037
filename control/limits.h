// Safety limits on every force that the servo loop sends.
#pragma once

#include "base/types.h"
#include "control/filters.h"
#include "control/norm.h"
#include "control/safety_limits.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

/// Continuous limit of a device that states none: this share of its peak force, with this time constant. A constant
/// demand for the peak then lasts for 1.2 s, is below 1.5 times the continuous force after 2.6 s, and below 1.1 times
/// after 4.7 s. Haptic devices whose makers publish both forces state a quarter to 0.4 of the peak.
inline constexpr double kCautiousShare = 0.3;
inline constexpr double kCautiousTime = 20;  ///< [s]

/// Clamps the magnitude of a force, and keeps its direction, to the peak limit and to the force that the motors
/// withstand continuously.
///
/// The continuous limit works like the i^2 t protection of motor drives. q is the mean square of the sent force through
/// a first-order low pass of time constant tau. The allowed magnitude is F_max while q <= (0.8 F_c)^2, falls linearly
/// in q from there, and is F_c at q >= F_c^2. A constant demand therefore settles at or below F_c.
///
/// The class limits torques as well.
///
/// Real-time: all but the constructor. Forces must be finite.
class ForceLimiter {
 public:
  explicit ForceLimiter(const SafetyLimits& limits)
      : ForceLimiter(limits.max_force, limits.max_continuous_force, limits.continuous_time) {}
  /// Takes the magnitudes [N], 0 for none, and the time constant of the continuous limit [s].
  ForceLimiter(double peak, double continuous, double tau)
      : peak_(peak > 0 ? peak : std::numeric_limits<double>::infinity()),
        continuous_(continuous > 0 && continuous < peak_ ? continuous : std::numeric_limits<double>::infinity()),
        tau_(tau) {}

  enum class Verdict { free, peak, continuous };

  struct Result {
    Vec3 force;       ///< [N]
    double asked;     ///< magnitude [N]
    double allowed;   ///< magnitude [N]
    Verdict verdict;  ///< limit that applied
  };

  /// Returns the part of `force` that may be sent now.
  [[nodiscard]] Result limit(const Vec3& force) const noexcept {
    const double asked = norm_of(force);
    const double allowed = this->allowed();
    Result result{force, asked, allowed, Verdict::free};
    if (asked > allowed) {
      result.force = force * (allowed / asked);
      result.verdict = allowed < peak_ ? Verdict::continuous : Verdict::peak;
    }
    return result;
  }

  /// Accounts for a force that acted for `dt` [s] of real time, until another force replaced it.
  void acted(const Vec3& force, double dt) noexcept {
    if (!std::isfinite(continuous_)) return;
    mean_square_ += low_pass_share(dt, tau_) * (std::min(force.squaredNorm(), kLargest * kLargest) - mean_square_);
  }

  /// Takes the mean square that earlier forces left [N^2], `rested` [s] ago.
  void warm(double mean_square, double rested) noexcept {
    mean_square_ = std::min(mean_square, kLargest * kLargest);
    acted(Vec3::Zero(), rested);
  }
  /// Returns the mean square of the forces [N^2]; 0 without a continuous limit.
  [[nodiscard]] double mean_square() const noexcept { return mean_square_; }

  /// Returns true if `result` was reduced to a force that may act for long: by the continuous limit, or by the peak
  /// limit if no continuous limit is below it.
  [[nodiscard]] bool holds_back(const Result& result) const noexcept {
    return result.verdict == Verdict::continuous || (result.verdict == Verdict::peak && !std::isfinite(continuous_));
  }

  /// Returns the heat of the motors, q over (0.8 F_c)^2, beyond which the peak limit falls; 0 without a continuous
  /// limit.
  [[nodiscard]] double heat() const noexcept {
    return std::isfinite(continuous_) ? mean_square_ / (kKnee * continuous_ * continuous_) : 0;
  }

  /// Returns the time for which a force of this magnitude [N] can last until the peak limit begins to fall [s];
  /// infinity if for ever.
  [[nodiscard]] double time_left(double force) const noexcept {
    const double knee = kKnee * continuous_ * continuous_, demand = std::pow(std::min(force, kLargest), 2);
    if (!(demand > knee)) return std::numeric_limits<double>::infinity();
    return std::max(0.0, tau_ * std::log((demand - mean_square_) / (demand - knee)));
  }

  /// Returns the magnitude that the next force may have [N].
  [[nodiscard]] double allowed() const noexcept {
    if (!std::isfinite(continuous_)) return peak_;
    const double full = continuous_ * continuous_, knee = kKnee * full;
    const double peak = std::isfinite(peak_) ? peak_ : 10 * continuous_;
    const double u = std::clamp((mean_square_ - knee) / (full - knee), 0.0, 1.0);
    return u > 0 ? continuous_ + (1 - u) * (peak - continuous_) : peak_;
  }

 private:
  static constexpr double kKnee = 0.64;      ///< share of F_c^2
  static constexpr double kLargest = 1e150;  ///< largest force with a finite square [N]

  double peak_, continuous_, tau_;
  double mean_square_ = 0;  ///< [N^2]
};

/// A factor that moves linearly between 0 and 1 over a given time. It limits the slew of a force that begins or ends.
///
/// Real-time.
class Ramp {
 public:
  explicit Ramp(double value = 0) : value_(value) {}

  /// Moves towards `target` (0 or 1) by dt / duration and returns the new value. Jumps if the duration is 0; does not
  /// move if dt is not above 0.
  double advance(double target, double dt, double duration) noexcept {
    const double step = duration > 0 ? std::max(0.0, dt) / duration : 1;
    value_ += std::clamp(target - value_, -step, step);
    return value_;
  }
  [[nodiscard]] double value() const noexcept { return value_; }

 private:
  double value_;
};

}  // namespace haptrace
