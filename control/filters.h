// Low and high passes: first order for any sampling period, and second-order Butterworth filters at a fixed rate.
#pragma once

#include "base/types.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <type_traits>

namespace haptrace {

/// Returns the share of its distance to a constant input that a first-order low pass moves in `dt`: 1 - exp(-dt / tau).
/// Both times have one unit, [s] or [ticks].
///
/// Real-time.
inline double low_pass_share(double dt, double time_constant) noexcept {
  return -std::expm1(-dt / time_constant);
}

/// Returns the same share of a low pass that is given by its cut-off [Hz], in `dt` [s].
///
/// Real-time.
inline double low_pass_share_at(double cutoff_hz, double dt) noexcept {
  return -std::expm1(-2 * std::numbers::pi * cutoff_hz * dt);
}

/// Returns the share of its distance to a new value that a setting moves in `dt` [s], so that a change makes no step in
/// the force: all but 2 % in 0.2 s. Returns 0 if `dt` is not above 0.
///
/// Real-time.
inline double setting_share(double dt) noexcept {
  constexpr double kTimeConstant = 0.05;  // [s]
  return low_pass_share(std::max(0.0, dt), kTimeConstant);
}

enum class FilterKind { low_pass, high_pass };

/// H(s) = 1 / (s^2 + sqrt(2) s + 1) or s^2 / (s^2 + sqrt(2) s + 1), s normalised to the cut-off, by the bilinear
/// transform with the cut-off prewarped (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1.2); transposed
/// direct form II. A cut-off at or beyond 0.49 of the rate is taken as 0.49 of it. `Signal` is double, or Vec3 for a
/// filter of each axis.
///
/// Real-time: update and reset. An input that is not finite leaves the memory unchanged and returns the last output.
template <class Signal>
class BasicButterworth2 {
 public:
  using Kind = FilterKind;

  BasicButterworth2(FilterKind kind, double cutoff_hz, double rate_hz) {
    const double k = std::tan(std::numbers::pi * std::clamp(cutoff_hz / rate_hz, 1e-9, 0.49));
    const double scale = 1 / (1 + std::numbers::sqrt2 * k + k * k);
    passes_constants_ = kind == FilterKind::low_pass;
    b0_ = (passes_constants_ ? k * k : 1) * scale;
    b1_ = (passes_constants_ ? 2 : -2) * b0_;
    a1_ = 2 * (k * k - 1) * scale;
    a2_ = (1 - std::numbers::sqrt2 * k + k * k) * scale;
    reset();
  }

  /// Coefficients of H(z) = (b0 + b1 / z + b0 / z^2) / (1 + a1 / z + a2 / z^2).
  struct Coefficients {
    double b0, b1, a1, a2;
  };
  [[nodiscard]] Coefficients coefficients() const noexcept { return {b0_, b1_, a1_, a2_}; }

  Signal update(const Signal& x) noexcept {
    if (!all_finite(x)) return y_;
    // Axis by axis: expressions of vectors take twice the instructions.
    if constexpr (kScalar)
      step(x, z1_, z2_, y_);
    else
      for (Eigen::Index axis = 0; axis < x.size(); ++axis) step(x[axis], z1_[axis], z2_[axis], y_[axis]);
    return y_;
  }

  /// Forgets everything, as if `x` had always been the input.
  void reset(const Signal& x = zero()) noexcept {
    y_ = passes_constants_ ? x : zero();
    z2_ = b0_ * x - a2_ * y_;
    z1_ = b1_ * x - a1_ * y_ + z2_;
  }

 private:
  static constexpr bool kScalar = std::is_arithmetic_v<Signal>;
  static Signal zero() noexcept {
    if constexpr (kScalar)
      return 0;
    else
      return Signal::Zero();
  }
  static bool all_finite(const Signal& x) noexcept {
    if constexpr (kScalar)
      return std::isfinite(x);
    else
      return is_finite(x);
  }

  void step(double x, double& z1, double& z2, double& y) const noexcept {
    const double out = b0_ * x + z1;
    z1 = b1_ * x - a1_ * out + z2;
    z2 = b0_ * x - a2_ * out;
    y = out;
  }

  double b0_, b1_, a1_, a2_;
  bool passes_constants_;
  Signal z1_, z2_, y_;
};

using Butterworth2 = BasicButterworth2<double>;

}  // namespace haptrace
