// Tests of the integration methods: stability limits, orders, and bodies of very small mass.
#include "base/eigenvalues.h"
#include "devices/sim/linear_step.h"
#include "tests/support/errors.h"

#include <Eigen/LU>

#include <array>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <numbers>

namespace haptrace::test {
namespace {

constexpr std::array kMethods{Integrator::semi_implicit, Integrator::euler,    Integrator::verlet,
                              Integrator::rk4,           Integrator::implicit, Integrator::exact};
constexpr std::array kLimited{Integrator::semi_implicit, Integrator::euler, Integrator::verlet, Integrator::rk4};
constexpr std::array kMasses{1e-6, 1e-3, 1.0, 1e3};
constexpr std::array kStiffnesses{1.0, 1e3, 1e6, 1e9};

/// Returns the largest modulus of the eigenvalues of phi. Above 1, a movement grows by itself.
double growth_of(const LinearStep& step) {
  // Balance the matrix: choose the unit of velocity that makes both off-diagonal blocks equally large.
  const Eigen::Index n = step.phi.rows() / 2;
  const double of_v = step.phi.bottomLeftCorner(n, n).cwiseAbs().maxCoeff(),
               of_q = step.phi.topRightCorner(n, n).cwiseAbs().maxCoeff();
  const double unit = of_v > 0 && of_q > 0 ? std::sqrt(of_v / of_q) : 1;
  auto phi = step.phi;
  phi.topRightCorner(n, n) *= unit;
  phi.bottomLeftCorner(n, n) /= unit;
  return spectral_radius(phi);
}

LinearBodies body(double m, double b, double k) {
  LinearBodies bodies;
  bodies.inverse_mass[0] = 1 / m;
  bodies.tie(0, k, b);
  return bodies;
}

/// Ends of a chain: tied to the ground, with the motor held, or free.
enum class End { tied, held, free };

/// Returns a chain of motor, handle and hand with non-proportional damping; `w` sets its frequencies [rad/s].
LinearBodies chain(double w, End end = End::tied) {
  LinearBodies bodies(3);
  bodies.inverse_mass << (end == End::held ? 0 : 1 / 0.3), 1 / 0.1, 1 / 0.15;
  bodies.connect(0, 1, 0.075 * w * w, 0.02 * w);
  bodies.connect(1, 2, 0.02 * w * w, 0.03 * w);
  if (end != End::free) {
    bodies.tie(2, 0.004 * w * w, 0.006 * w);
    bodies.tie(0, 0, 0.02 * w);
  }
  return bodies;
}

/// Returns whether thousands of steps let a movement grow, with velocities in units of `w`. Assumes nothing about the
/// method. A chain starts at rest, since without a tie it would drift away.
bool grows(Integrator method, const LinearBodies& bodies, double w, double h) {
  constexpr int kSteps = 4000;
  constexpr double kMore = 1.05;  // the two halves of a beating movement differ a little
  const int n = bodies.size();
  const LinearStep step = linear_step(method, bodies, h);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6> phi = step.phi;
  phi.topRightCorner(n, n) *= w;
  phi.bottomLeftCorner(n, n) /= w;
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6, 1> x(2 * n), next(2 * n);
  x.setZero();
  for (int i = 0; i < n; ++i) x[i] = bodies.inverse_mass[i] > 0 ? 1 - 0.3 * i : 0;
  if (n == 1) x[1] = 0.4;
  double first = 0, last = 0;
  for (int k = 0; k < kSteps; ++k) {
    next.noalias() = phi.lazyProduct(x);
    x.swap(next);
    double& most = k < kSteps / 2 ? first : last;
    most = std::max(most, x.squaredNorm());
    if (!(most < 1e100)) return true;
  }
  return last > kMore * first;
}

/// Returns the largest stable step between `low` and `high` [s], by bisection to a thousandth.
double measured_limit(Integrator method, const LinearBodies& bodies, double w, double low, double high) {
  while (high > 1.001 * low) {
    const double middle = std::sqrt(low * high);
    (grows(method, bodies, w, middle) ? high : low) = middle;
  }
  return std::sqrt(low * high);
}

/// Returns the stability limit in closed form [s]; NaN if there is none.
double theory(Integrator method, double m, double b, double k) {
  const double w = std::sqrt(k / m), root = std::sqrt(std::abs(b * b - 4 * m * k));
  const bool overdamped = b * b > 4 * m * k;
  switch (method) {
    case Integrator::semi_implicit:
      return 4 * m / (b + std::sqrt(b * b + 4 * m * k));  // (-b + sqrt(b^2 + 4 m k)) / k without cancellation
    case Integrator::euler:
      return overdamped ? 4 * m / (b + root) : b / k;
    case Integrator::verlet:
      return 2 / w;
    case Integrator::rk4:
      if (b == 0) return 2 * std::numbers::sqrt2 / w;
      return overdamped ? 2.785293563405282 * 2 * m / (b + root) : std::numeric_limits<double>::quiet_NaN();
    default:
      return std::numeric_limits<double>::infinity();
  }
}

TEST(Integrators, TheMeasuredLimitIsThatOfTheoryWithinAPerCent) {
  for (const double m : kMasses)
    for (const double k : kStiffnesses)
      for (const double ratio : {0.0, 0.05, 0.5, 1.1, 5.0})
        for (const Integrator method : kLimited) {
          const double w = std::sqrt(k / m), b = 2 * ratio * std::sqrt(m * k);
          const LinearBodies bodies = body(m, b, k);
          const std::string what = fmt::format("{}: {} kg, {} N/m, damping {}", to_string(method), m, k, ratio);
          const double limit = stability_limit(method, bodies), closed = theory(method, m, b, k);
          if (!std::isnan(closed)) {
            EXPECT_NEAR(limit, closed, 1e-7 * closed) << what;
          }
          if (limit == 0) {
            EXPECT_TRUE(grows(method, bodies, w, 0.02 / w)) << what;
          } else {
            EXPECT_NEAR(measured_limit(method, bodies, w, 0.01 / w, 10 / w), limit, 0.01 * limit) << what;
          }
        }
}

TEST(Integrators, TheMeasuredLimitIsThatOfTheoryForADamperAloneAndForNoForces) {
  for (const double m : kMasses) {
    for (const Integrator method : {Integrator::semi_implicit, Integrator::euler, Integrator::rk4}) {
      const double limit = stability_limit(method, body(m, 3, 0));
      EXPECT_NEAR(limit, (method == Integrator::rk4 ? 2.785293563405282 : 2) * m / 3, 1e-9 * m) << to_string(method);
      EXPECT_NEAR(measured_limit(method, body(m, 3, 0), 3 / m, 0.1 * m / 3, 10 * m / 3), limit, 0.01 * limit)
          << to_string(method);
    }
    EXPECT_EQ(stability_limit(Integrator::verlet, body(m, 3, 0)), INFINITY);
    EXPECT_FALSE(grows(Integrator::verlet, body(m, 3, 0), 3 / m, 1e3 * m));
    for (const Integrator method : kMethods) EXPECT_EQ(stability_limit(method, body(m, 0, 0)), INFINITY);
  }
}

TEST(Integrators, TheLimitOfCoupledBodiesIsMeasuredToo) {
  for (const double w : {1.0, 1e3, 3e7})
    for (const End end : {End::tied, End::held, End::free})
      for (const Integrator method : kLimited) {
        const LinearBodies bodies = chain(w, end);
        const double limit = stability_limit(method, bodies);
        const std::string what = fmt::format("{}, {} rad/s, end {}", to_string(method), w, static_cast<int>(end));
        ASSERT_GT(limit, 0) << what;
        EXPECT_NEAR(measured_limit(method, bodies, w, 0.01 / w, 100 / w), limit, 0.01 * limit) << what;
        EXPECT_LE(growth_of(linear_step(method, bodies, 0.999 * limit)), 1 + 1e-7) << what;
        EXPECT_GT(growth_of(linear_step(method, bodies, 1.001 * limit)), 1 + 1e-7) << what;
      }
}

TEST(Integrators, ImplicitAndExactStepsGrowAtNoStep) {
  for (const Integrator method : {Integrator::implicit, Integrator::exact}) {
    for (const double m : kMasses)
      for (const double k : kStiffnesses)
        for (const double ratio : {0.0, 0.5, 50.0})
          for (double hw = 1e-3; hw < 1e6; hw *= 30) {
            const LinearBodies bodies = body(m, 2 * ratio * std::sqrt(m * k), k);
            EXPECT_LE(growth_of(linear_step(method, bodies, hw / std::sqrt(k / m))), 1 + 1e-9)
                << to_string(method) << ": " << m << " kg, " << k << " N/m, " << ratio << ", " << hw;
          }
    EXPECT_EQ(stability_limit(method, chain(1e3)), INFINITY);
    EXPECT_FALSE(grows(method, chain(1e3), 1e3, 10));
  }
}

/// Returns x, v of m x'' + b x' + k x = f at time `t` from x0, v0, in complex long double. Not for critical damping.
Eigen::Vector2d closed_form(double m, double b, double k, double f, double x0, double v0, double t) {
  using Number = std::complex<long double>;
  const Number a = -b / (2.0L * m), d = std::sqrt(a * a - Number(static_cast<long double>(k) / m));
  // Compute the slow root without cancellation: the product of both roots is k / m.
  const Number fast = a - d, slow = d.imag() == 0 ? Number(static_cast<long double>(k) / m) / fast : a + d;
  const Number x = x0 - static_cast<long double>(f) / k, v = v0;
  const Number of_slow = (v - fast * x) / (slow - fast), of_fast = (slow * x - v) / (slow - fast);
  const auto time = static_cast<long double>(t);
  const Number grown_slow = of_slow * std::exp(slow * time), grown_fast = of_fast * std::exp(fast * time);
  return {static_cast<double>((grown_slow + grown_fast).real() + static_cast<long double>(f) / k),
          static_cast<double>((slow * grown_slow + fast * grown_fast).real())};
}

TEST(Integrators, OrdersOfAccuracyAreThoseOfTheory) {
  const double m = 0.25, b = 3, k = 3000, f = 5, t = 0.1;
  const Eigen::Vector2d truth = closed_form(m, b, k, f, 1e-3, 0.2, t);
  const auto error = [&](Integrator method, int steps) {
    const LinearStep step = linear_step(method, body(m, b, k), t / steps);
    Eigen::Vector2d x(1e-3, 0.2);
    for (int i = 0; i < steps; ++i) x = step.phi * x + step.gamma * f;
    return std::hypot(x[0] - truth[0], (x[1] - truth[1]) / std::sqrt(k / m));
  };
  const auto order = [&](Integrator method, int steps) {
    return std::log2(error(method, steps) / error(method, 2 * steps));
  };
  EXPECT_NEAR(order(Integrator::semi_implicit, 8000), 1, 0.02);
  EXPECT_NEAR(order(Integrator::euler, 8000), 1, 0.02);
  EXPECT_NEAR(order(Integrator::implicit, 8000), 1, 0.02);
  EXPECT_NEAR(order(Integrator::verlet, 1000), 2, 0.02);
  EXPECT_NEAR(order(Integrator::rk4, 200), 4, 0.05);
  for (const int steps : {1, 3, 1000}) EXPECT_LT(error(Integrator::exact, steps), 1e-15 * std::sqrt(steps) * 10);
}

TEST(Integrators, TheExactStepHasNoErrorAtAnyStep) {
  for (const double m : kMasses)
    for (const double k : kStiffnesses)
      for (const double ratio : {0.0, 0.01, 0.7, 3.0, 1e3})
        for (const double h : {1e-7, 1e-3, 1.0}) {
          const double b = 2 * ratio * std::sqrt(m * k), w = std::sqrt(k / m), f = 2 * k;
          const LinearStep step = linear_step(Integrator::exact, body(m, b, k), h);
          const Eigen::Vector2d x = step.phi * Eigen::Vector2d(1, 0.5 * w) + step.gamma * f,
                                truth = closed_form(m, b, k, f, 1, 0.5 * w, h);
          // The phase w h [rad] is known only to the relative precision of a double.
          const double rounding = 1e-13 + 1e-15 * w * h;
          EXPECT_NEAR(x[0], truth[0], rounding) << m << " kg, " << k << " N/m, damping " << ratio << ", " << h;
          EXPECT_NEAR(x[1] / w, truth[1] / w, rounding) << m << " kg, " << k << " N/m, damping " << ratio << ", " << h;
        }
}

TEST(Integrators, OneExactStepOfAChainIsAnyNumberOfThem) {
  const LinearBodies bodies = chain(1e3);
  const LinearStep once = linear_step(Integrator::exact, bodies, 8e-3),
                   often = linear_step(Integrator::exact, bodies, 8e-3 / 64),
                   other = linear_step(Integrator::rk4, bodies, 8e-3 / 4096);
  Eigen::VectorXd a(6), b(6);
  a << 1, -1, 0.5, 300, 0, -900;
  b = a;
  Eigen::VectorXd c = a;
  const Eigen::Vector3d f(1e3, -2e3, 500);
  const Eigen::VectorXd end = once.phi * a + once.gamma * f;
  for (int i = 0; i < 64; ++i) b = often.phi * b + often.gamma * f;
  for (int i = 0; i < 4096; ++i) c = other.phi * c + other.gamma * f;
  EXPECT_LT((end - b).norm(), 1e-12 * end.norm());
  EXPECT_LT((end - c).norm(), 1e-9 * end.norm());  // an independent method
}

TEST(Integrators, ABodyInEquilibriumStaysThere) {
  for (const Integrator method : kMethods)
    for (const double h : {1e-6, 1e-3}) {
      const LinearBodies bodies = chain(300);
      const Eigen::Vector3d f(1, -2, 3), q = Eigen::Matrix3d(bodies.stiffness).inverse() * f;
      Eigen::VectorXd x(6);
      x << q, 0, 0, 0;
      const LinearStep step = linear_step(method, bodies, h);
      EXPECT_LT((step.phi * x + step.gamma * f - x).norm(), 1e-13 * x.norm()) << to_string(method) << ", " << h;
    }
}

TEST(Integrators, AFreeBodyKeepsItsMomentum) {
  const LinearBodies bodies = chain(300, End::free);
  const Eigen::Vector3d mass = bodies.inverse_mass.cwiseInverse(), f(4, -1, 2);
  Eigen::VectorXd x(6);
  x << 1e-3, -2e-3, 0, 0.3, 0.1, -0.5;
  for (const Integrator method : kMethods) {
    const LinearStep step = linear_step(method, bodies, 1e-3);
    const double after = mass.dot((step.phi * x + step.gamma * f).tail<3>());
    EXPECT_NEAR(after, mass.dot(x.tail<3>()) + 1e-3 * f.sum(), 1e-14) << to_string(method);
  }
}

TEST(Integrators, ABodyOfHardlyAnyMassFollowsItsSpringAndDamper) {
  // In the limit, x' = (f - k x) / b. The implicit method applies backward Euler to it. Every method stays finite.
  const double k = 1000, b = 5, h = 2e-3, f = 3, x0 = 0.01, rest = f / k;
  for (const double m : {1e-6, 1e-9, 1e-12}) {
    const auto end = [&](Integrator method) {
      const LinearStep step = linear_step(method, body(m, b, k), h);
      return Eigen::Vector2d(step.phi * Eigen::Vector2d(x0, (f - k * x0) / b) + step.gamma * f);
    };
    const double nearly = 1e3 * m + 1e-12;  // the time constant is off by a fraction m k / b^2
    EXPECT_NEAR(end(Integrator::exact)[0], rest + (x0 - rest) * std::exp(-k * h / b), nearly);
    EXPECT_NEAR(end(Integrator::exact)[1], (f - k * x0) / b * std::exp(-k * h / b), 1e3 * nearly);
    EXPECT_NEAR(end(Integrator::implicit)[0], rest + (x0 - rest) / (1 + k * h / b), nearly);
    for (const Integrator method : kMethods) EXPECT_TRUE(end(method).allFinite()) << to_string(method) << ", " << m;
  }
}

TEST(Integrators, WithoutADamperSymplecticStepsKeepTheirEnergyForEver) {
  const double m = 0.01, k = 1e6, w = std::sqrt(k / m), h = 0.2 / w;
  const auto amplitude = [&](Integrator method) {
    const LinearStep step = linear_step(method, body(m, 0, k), h);
    Eigen::Vector2d x(1, 0);
    double most = 0;
    for (int i = 0; i < 100000; ++i) {
      x = step.phi * x;
      if (i >= 99900) most = std::max(most, std::abs(x[0]));
    }
    return most;
  };
  EXPECT_NEAR(amplitude(Integrator::semi_implicit), 1, 0.02);
  EXPECT_NEAR(amplitude(Integrator::verlet), 1, 0.01);
  EXPECT_NEAR(amplitude(Integrator::exact), 1, 0.01);
  EXPECT_NEAR(amplitude(Integrator::rk4), std::exp(-1e5 * std::pow(0.2, 6) / 144), 0.01);
  EXPECT_LT(amplitude(Integrator::implicit), 1e-100);
}

TEST(Integrators, AreKnownByName) {
  for (const Integrator method : kMethods) EXPECT_EQ(parse_integrator(to_string(method)), method);
  EXPECT_THAT(error_of([] { (void)parse_integrator("leapfrog"); }),
              testing::AllOf(testing::HasSubstr("'leapfrog'"), testing::HasSubstr("semi-implicit, euler, verlet")));
}

}  // namespace
}  // namespace haptrace::test
