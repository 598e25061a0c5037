// The place on a way at which a field changes its sign.
#pragma once

#include <algorithm>

namespace haptrace {

/// Two places on a way, as shares of it: the field is negative at `in`, and not at `out`.
struct SignChange {
  double in = 0, out = 1;
};

/// Narrows a change of sign of `f` from `between` until its two sides are `width` apart, or after `most` steps: regula
/// falsi (Illinois: Dowell and Jarratt, "A modified regula falsi method", BIT 11, 1971) with a bisection at every
/// fourth step, and where the field is not finite. `f_in` and `f_out` are the values at both sides. Real-time if `f`
/// is.
template <class Field>
SignChange narrow(const Field& f, SignChange between, double f_in, double f_out, double width, int most) {
  auto [in, out] = between;
  for (int step = 0; step < most; ++step) {
    const auto [low, high] = std::minmax({in, out});
    if (!(high - low > width)) break;
    double t = out + (in - out) * f_out / (f_out - f_in);
    if (!(t > low && t < high) || step % 4 == 3) t = 0.5 * (low + high);
    if (const double value = f(t); value < 0) {
      in = t;
      f_in = value;
      f_out *= 0.5;
    } else {
      out = t;
      f_out = value;
      f_in *= 0.5;
    }
  }
  return {in, out};
}

}  // namespace haptrace
