// Interval arithmetic: bounds of a function over a range, which samples could miss.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace haptrace {

/// All numbers from `lo` to `hi`. Results of arithmetic contain every result for numbers of the arguments: they are
/// widened by rounding. An argument outside a function's domain gives the whole line.
struct Interval {
  double lo, hi;

  [[nodiscard]] bool has(double x) const noexcept { return lo <= x && x <= hi; }
  [[nodiscard]] double mid() const noexcept { return 0.5 * (lo + hi); }
  [[nodiscard]] double most() const noexcept { return std::max(std::abs(lo), std::abs(hi)); }
  [[nodiscard]] bool finite() const noexcept { return std::isfinite(lo) && std::isfinite(hi); }
};

inline constexpr Interval kWholeLine{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};

/// Returns an interval widened by rounding errors of `ulps` units in the last place; the whole line for NaN.
inline Interval widened(double lo, double hi, double ulps = 1) noexcept {
  if (!(lo <= hi)) return kWholeLine;
  const double e = ulps * std::numeric_limits<double>::epsilon(), tiny = std::numeric_limits<double>::denorm_min();
  return {lo - e * std::abs(lo) - tiny, hi + e * std::abs(hi) + tiny};
}

inline Interval operator+(Interval a, Interval b) noexcept {
  return widened(a.lo + b.lo, a.hi + b.hi);
}
inline Interval operator-(Interval a) noexcept {
  return {-a.hi, -a.lo};
}
inline Interval operator-(Interval a, Interval b) noexcept {
  return a + -b;
}
inline Interval operator*(double c, Interval a) noexcept {
  if (c == 0) return {0, 0};
  return c > 0 ? widened(c * a.lo, c * a.hi) : widened(c * a.hi, c * a.lo);
}
inline Interval operator*(Interval a, Interval b) noexcept {
  // 0 times an unbounded end is 0: the end itself is no number of the interval.
  const auto times = [](double x, double y) { return x == 0 || y == 0 ? 0 : x * y; };
  const double p = times(a.lo, b.lo), q = times(a.lo, b.hi), r = times(a.hi, b.lo), s = times(a.hi, b.hi);
  return widened(std::min({p, q, r, s}), std::max({p, q, r, s}));
}
inline Interval hull(Interval a, Interval b) noexcept {
  return {std::min(a.lo, b.lo), std::max(a.hi, b.hi)};
}
inline Interval least_of(Interval a, Interval b) noexcept {
  return {std::min(a.lo, b.lo), std::min(a.hi, b.hi)};
}
inline Interval most_of(Interval a, Interval b) noexcept {
  return {std::max(a.lo, b.lo), std::max(a.hi, b.hi)};
}
inline Interval square_of(Interval a) noexcept {
  const double p = a.lo * a.lo, q = a.hi * a.hi;
  return widened(a.has(0) ? 0 : std::min(p, q), std::max(p, q));
}
/// 1 / a.
inline Interval inverse_of(Interval a) noexcept {
  return a.has(0) ? kWholeLine : widened(1 / a.hi, 1 / a.lo);
}
/// a^n for n from 0 up.
inline Interval power_of(Interval a, int n) noexcept {
  double p = 1, q = 1, lo = a.lo, hi = a.hi;
  for (unsigned rest = static_cast<unsigned>(n); rest != 0; rest /= 2) {
    if (rest % 2 != 0) {
      p *= lo;
      q *= hi;
    }
    lo *= lo;
    hi *= hi;
  }
  if (n % 2 != 0) return widened(p, q, n + 1);
  return widened(n > 0 && a.has(0) ? 0 : std::min(p, q), std::max(p, q), n + 1);
}
inline Interval sine_of(Interval a) noexcept {
  constexpr double kTurn = 2 * std::numbers::pi, kFar = 1e9;  // beyond kFar the phase has few digits
  if (!(a.hi - a.lo < kTurn) || !(a.most() < kFar)) return {-1, 1};
  const double p = std::sin(a.lo), q = std::sin(a.hi);
  // A crest at pi / 2 + k turns within the interval, or within its rounding.
  const auto holds = [&](double crest) {
    const double at = crest + kTurn * std::ceil((a.lo - crest) / kTurn - 1e-12);
    return at <= a.hi + 1e-12 * (1 + a.most());
  };
  const Interval r = widened(std::min(p, q), std::max(p, q), 4);
  return {holds(-std::numbers::pi / 2) ? -1 : std::max(-1.0, r.lo),
          holds(std::numbers::pi / 2) ? 1 : std::min(1.0, r.hi)};
}

/// Bounds of a value along a straight line, and of its derivative along it.
struct Span {
  Interval value, rate;
};

inline Span sum(Span a, Span b) noexcept {
  return {a.value + b.value, a.rate + b.rate};
}
inline Interval sum(Interval a, Interval b) noexcept {
  return a + b;
}
inline Span scaled(Span a, double c) noexcept {
  return {c * a.value, c * a.rate};
}
inline Interval scaled(Interval a, double c) noexcept {
  return c * a;
}
inline Span shifted(Span a, double c) noexcept {
  return {a.value + Interval{c, c}, a.rate};
}
inline Interval shifted(Interval a, double c) noexcept {
  return a + Interval{c, c};
}

}  // namespace haptrace
