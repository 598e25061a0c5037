// Second-order Butterworth filters for signals sampled at a fixed rate.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {

/// H(s) = 1 / (s^2 + sqrt(2) s + 1) or s^2 / (s^2 + sqrt(2) s + 1), s normalised to the cut-off, by the bilinear
/// transform with the cut-off prewarped (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.1.2); transposed
/// direct form II. A cut-off at or beyond 0.49 of the rate is taken as 0.49 of it.
///
/// Real-time: update and reset. An input that is not finite leaves the memory as it was and answers the last output.
class Butterworth2 {
 public:
  enum class Kind { low_pass, high_pass };

  Butterworth2(Kind kind, double cutoff_hz, double rate_hz) {
    const double k = std::tan(std::numbers::pi * std::clamp(cutoff_hz / rate_hz, 1e-9, 0.49));
    const double scale = 1 / (1 + std::numbers::sqrt2 * k + k * k);
    passes_constants_ = kind == Kind::low_pass;
    b0_ = (kind == Kind::low_pass ? k * k : 1) * scale;
    b1_ = (kind == Kind::low_pass ? 2 : -2) * b0_;
    a1_ = 2 * (k * k - 1) * scale;
    a2_ = (1 - std::numbers::sqrt2 * k + k * k) * scale;
  }

  double update(double x) noexcept {
    if (!std::isfinite(x)) return y_;
    y_ = b0_ * x + z1_;
    z1_ = b1_ * x - a1_ * y_ + z2_;
    z2_ = b0_ * x - a2_ * y_;
    return y_;
  }

  /// Forgets everything, as if `x` had always been the input.
  void reset(double x = 0) noexcept {
    y_ = passes_constants_ ? x : 0;
    z2_ = b0_ * x - a2_ * y_;
    z1_ = b1_ * x - a1_ * y_ + z2_;
  }

 private:
  double b0_, b1_, a1_, a2_;
  bool passes_constants_;
  double z1_ = 0, z2_ = 0, y_ = 0;
};

}  // namespace haptrace
