// Numbers that carry their derivatives with them: forward-mode automatic differentiation in space.
#pragma once

#include "base/types.h"

#include <array>
#include <cstddef>

namespace haptrace {

/// A value and its gradient.
struct Slope {
  double value;
  std::array<double, 3> gradient;

  [[nodiscard]] Vec3 vector() const noexcept { return {gradient[0], gradient[1], gradient[2]}; }
};

/// A value, its gradient and its Hessian, whose entries are xx, yy, zz, xy, xz, yz.
struct Jet {
  double value;
  std::array<double, 3> gradient;
  std::array<double, 6> hessian;

  [[nodiscard]] Vec3 vector() const noexcept { return {gradient[0], gradient[1], gradient[2]}; }
  [[nodiscard]] Eigen::Matrix3d matrix() const noexcept {
    Eigen::Matrix3d m;
    m << hessian[0], hessian[3], hessian[4], hessian[3], hessian[1], hessian[5], hessian[4], hessian[5], hessian[2];
    return m;
  }
};

/// A function of one number, and its derivatives.
struct Unary {
  double f, f1, f2;
};
/// A function of two numbers, and its derivatives.
struct Binary {
  double f, fa, fb, faa, fab, fbb;
};

inline double chained(double, const Unary& u) noexcept {
  return u.f;
}
inline Slope chained(const Slope& a, const Unary& u) noexcept {
  return {u.f, {u.f1 * a.gradient[0], u.f1 * a.gradient[1], u.f1 * a.gradient[2]}};
}
inline Jet chained(const Jet& a, const Unary& u) noexcept {
  const auto& g = a.gradient;
  const auto& h = a.hessian;
  return {u.f,
          {u.f1 * g[0], u.f1 * g[1], u.f1 * g[2]},
          {u.f1 * h[0] + u.f2 * g[0] * g[0], u.f1 * h[1] + u.f2 * g[1] * g[1], u.f1 * h[2] + u.f2 * g[2] * g[2],
           u.f1 * h[3] + u.f2 * g[0] * g[1], u.f1 * h[4] + u.f2 * g[0] * g[2], u.f1 * h[5] + u.f2 * g[1] * g[2]}};
}

inline double chained(double, double, const Binary& u) noexcept {
  return u.f;
}
inline Slope chained(const Slope& a, const Slope& b, const Binary& u) noexcept {
  Slope c{u.f, {}};
  for (std::size_t i = 0; i < 3; ++i) c.gradient[i] = u.fa * a.gradient[i] + u.fb * b.gradient[i];
  return c;
}
inline Jet chained(const Jet& a, const Jet& b, const Binary& u) noexcept {
  constexpr std::array<std::array<std::size_t, 2>, 6> kPairs{{{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}}};
  Jet c{u.f, {}, {}};
  const auto &p = a.gradient, &q = b.gradient;
  for (std::size_t i = 0; i < 3; ++i) c.gradient[i] = u.fa * p[i] + u.fb * q[i];
  for (std::size_t k = 0; k < 6; ++k) {
    const auto [i, j] = kPairs[k];
    c.hessian[k] = u.fa * a.hessian[k] + u.fb * b.hessian[k] + u.faa * p[i] * p[j] +
                   u.fab * (p[i] * q[j] + p[j] * q[i]) + u.fbb * q[i] * q[j];
  }
  return c;
}

inline double sum(double a, double b) noexcept {
  return a + b;
}
inline Slope sum(Slope a, const Slope& b) noexcept {
  a.value += b.value;
  for (std::size_t i = 0; i < 3; ++i) a.gradient[i] += b.gradient[i];
  return a;
}
inline Jet sum(Jet a, const Jet& b) noexcept {
  a.value += b.value;
  for (std::size_t i = 0; i < 3; ++i) a.gradient[i] += b.gradient[i];
  for (std::size_t i = 0; i < 6; ++i) a.hessian[i] += b.hessian[i];
  return a;
}

inline double scaled(double a, double c) noexcept {
  return c * a;
}
inline Slope scaled(Slope a, double c) noexcept {
  a.value *= c;
  for (double& g : a.gradient) g *= c;
  return a;
}
inline Jet scaled(Jet a, double c) noexcept {
  a.value *= c;
  for (double& g : a.gradient) g *= c;
  for (double& h : a.hessian) h *= c;
  return a;
}

inline double shifted(double a, double c) noexcept {
  return a + c;
}
inline Slope shifted(Slope a, double c) noexcept {
  a.value += c;
  return a;
}
inline Jet shifted(Jet a, double c) noexcept {
  a.value += c;
  return a;
}

inline double value_of(double a) noexcept {
  return a;
}
inline double value_of(const Slope& a) noexcept {
  return a.value;
}
inline double value_of(const Jet& a) noexcept {
  return a.value;
}

/// The coordinate of this axis, as a number of the type N.
template <class N>
N coordinate(double value, std::size_t axis) noexcept {
  if constexpr (std::is_same_v<N, double>) {
    (void)axis;
    return value;
  } else {
    N n{};
    n.value = value;
    n.gradient[axis] = 1;
    return n;
  }
}

}  // namespace haptrace
