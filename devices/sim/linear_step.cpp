#include "devices/sim/linear_step.h"

#include "base/eigenvalues.h"
#include "base/enum_names.h"
#include "base/error.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <limits>
#include <vector>

namespace haptrace {
namespace {

constexpr EnumNames<Integrator, 6> kIntegrators{"integrator",
                                                {"semi-implicit", "euler", "verlet", "rk4", "implicit", "exact"}};

using Square = decltype(LinearStep::phi);
constexpr int kMostRows = 3 * LinearBodies::kMost;
/// Matrix over q, v and the held f.
using Augmented = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostRows, kMostRows>;

LinearBodies::Matrix over_mass(const LinearBodies& bodies, const LinearBodies::Matrix& m) {
  return bodies.inverse_mass.asDiagonal() * m;
}

/// Estimates the fastest natural frequency [rad/s]; 0 without a spring.
double frequency_scale(const LinearBodies& bodies) {
  return std::sqrt(over_mass(bodies, bodies.stiffness).cwiseAbs().rowwise().sum().maxCoeff());
}

/// Returns the sum over k = 1 ... terms of X^k / k!
Augmented exponential_series(const Augmented& x, int terms) {
  const Augmented one = Augmented::Identity(x.rows(), x.cols());
  Augmented sum = one;
  for (int k = terms; k > 1; --k) sum = Augmented(one + x * sum / k);
  return x * sum;
}

/// Returns exp(X) - 1. Squares this difference from 1, (1 + E)^2 = 1 + (2 E + E^2): the slow mode of a stiff body lies
/// entirely in E and would be lost to rounding in 1 + E, as it is in Eigen's exp().
Augmented exponential_less_one(Augmented x) {
  constexpr double kSmall = 0.25;
  constexpr int kTerms = 12;  // 0.25^13 / 13! is below a double's last digit
  const double norm = x.cwiseAbs().rowwise().sum().maxCoeff();
  const int squarings = norm > kSmall ? static_cast<int>(std::ceil(std::log2(norm / kSmall))) : 0;
  x *= std::ldexp(1.0, -squarings);
  Augmented e = exponential_series(x, kTerms);
  for (int i = 0; i < squarings; ++i) e = Augmented(2 * e + e * e);
  return e;
}

/// Computes the step of a method from the exponential's series: Euler, Runge-Kutta, exact.
template <class Series>
LinearStep by_series(const LinearBodies& bodies, double h, const Series& series) {
  // Use units of velocity in which the matrix is balanced.
  const int n = bodies.size();
  const double frequency = frequency_scale(bodies), unit = frequency > 0 ? frequency : 1 / h;
  Augmented x = Augmented::Zero(3 * n, 3 * n);
  x.block(0, n, n, n).diagonal().setConstant(h * unit);
  x.block(n, 0, n, n) = -h / unit * over_mass(bodies, bodies.stiffness);
  x.block(n, n, n, n) = -h * over_mass(bodies, bodies.damping);
  x.block(n, 2 * n, n, n).diagonal() = h / unit * bodies.inverse_mass;
  Augmented e = series(x);
  e.middleRows(n, n) *= unit;
  e.middleCols(n, n) /= unit;
  LinearStep step;
  step.phi = Square::Identity(2 * n, 2 * n) + e.topLeftCorner(2 * n, 2 * n);
  step.gamma = e.topRightCorner(2 * n, n);
  return step;
}

/// Computes the step of a method that moves the positions with the new velocity or with the half-step velocity. The
/// rows of the matrices are over [q v f].
LinearStep by_kicks(Integrator integrator, const LinearBodies& bodies, double h) {
  using Row = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, LinearBodies::kMost, kMostRows>;
  const int n = bodies.size();
  const LinearBodies::Matrix one = LinearBodies::Matrix::Identity(n, n), k = over_mass(bodies, bodies.stiffness),
                             b = over_mass(bodies, bodies.damping), w = bodies.inverse_mass.asDiagonal();
  Row q = Row::Zero(n, 3 * n), v = Row::Zero(n, 3 * n), f = Row::Zero(n, 3 * n);  // the old state
  q.leftCols(n) = one;
  v.middleCols(n, n) = one;
  f.rightCols(n) = w;
  Row q_new, v_new;
  if (integrator == Integrator::verlet) {
    const Row half_way = v + 0.5 * h * (f - b * v - k * q);
    q_new = q + h * half_way;
    const LinearBodies::Matrix damped = one + 0.5 * h * b;
    v_new = damped.partialPivLu().solve(Row(half_way + 0.5 * h * (f - k * q_new)));
  } else if (integrator == Integrator::implicit) {
    const LinearBodies::Matrix held = one + h * b + h * h * k;
    v_new = held.partialPivLu().solve(Row(v + h * (f - k * q)));
    q_new = q + h * v_new;
  } else {
    v_new = v + h * (f - b * v - k * q);
    q_new = q + h * v_new;
  }
  LinearStep step;
  step.phi.resize(2 * n, 2 * n);
  step.phi << q_new.leftCols(2 * n), v_new.leftCols(2 * n);
  step.gamma.resize(2 * n, n);
  step.gamma << q_new.rightCols(n), v_new.rightCols(n);
  return step;
}

/// Returns [0 1; sign W K, sign W B], in units of velocity in which it is balanced.
Square companion(const LinearBodies& bodies, double sign) {
  const int n = bodies.size();
  const double frequency = frequency_scale(bodies), unit = frequency > 0 ? frequency : 1;
  Square matrix = Square::Zero(2 * n, 2 * n);
  matrix.topRightCorner(n, n).diagonal().setConstant(unit);
  matrix.bottomLeftCorner(n, n) = sign / unit * over_mass(bodies, bodies.stiffness);
  matrix.bottomRightCorner(n, n) = sign * over_mass(bodies, bodies.damping);
  return matrix;
}

/// Returns the eigenvalues of q'' = -W (B q' + K q) [1/s].
std::vector<std::complex<double>> decay_rates(const LinearBodies& bodies) {
  const int n = bodies.size();
  if (n == 1) {
    const double a = 0.5 * bodies.inverse_mass[0] * bodies.damping(0, 0),
                 w2 = bodies.inverse_mass[0] * bodies.stiffness(0, 0);
    if (a * a < w2) return {{-a, std::sqrt(w2 - a * a)}};
    const double fast = a + std::sqrt(a * a - w2);
    return {-fast, fast > 0 ? -w2 / fast : 0};
  }
  return eigenvalues_of(companion(bodies, -1));
}

/// Returns the largest real part of the eigenvalues.
double largest_eigenvalue(const Eigen::MatrixXd& matrix) {
  double largest = -std::numeric_limits<double>::infinity();
  for (const std::complex<double>& value : eigenvalues_of(matrix)) largest = std::max(largest, value.real());
  return largest;
}

/// Returns the largest h at which |1 + z + ... + z^4 / 24| <= 1 for z = h `rate`.
double runge_kutta_limit(const std::complex<double>& rate) {
  const std::complex<double> direction = rate / std::abs(rate);
  const auto grows = [&](double r) {
    const std::complex<double> z = r * direction;
    return std::abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))) > 1;
  };
  // Every ray of the left half-plane leaves the stability region once, between these radii.
  double stable = 2.5, unstable = 4;
  while (unstable - stable > 1e-14 * unstable) {
    const double middle = 0.5 * (stable + unstable);
    if (middle <= stable || middle >= unstable) break;
    (grows(middle) ? unstable : stable) = middle;
  }
  return stable / std::abs(rate);
}

double euler_limit(const std::complex<double>& rate) {
  return std::max(0.0, -2 * rate.real() / std::norm(rate));
}

/// Returns `reach` / `rate` [s], or infinity if the rate is not positive.
double time_of(double reach, double rate) {
  return rate > 0 ? reach / rate : std::numeric_limits<double>::infinity();
}

/// Returns the least limit over all eigenvalues, for methods whose limit is a function of an eigenvalue.
template <class Limit>
double least_limit(const LinearBodies& bodies, const Limit& limit) {
  // Relative to the largest rate. A body that is held or rolls freely has two rates of zero, which the solver finds
  // only to the square root of a double's precision.
  constexpr double kRounding = 1e-6;
  const auto rates = decay_rates(bodies);
  double largest = 0, least = std::numeric_limits<double>::infinity();
  for (const auto& rate : rates) largest = std::max(largest, std::abs(rate));
  const double none = rates.size() > 2 ? kRounding * largest : 0;
  for (const auto& rate : rates)
    if (std::abs(rate) > none) least = std::min(least, limit(rate));
  return least;
}

}  // namespace

Integrator parse_integrator(std::string_view name) {
  return kIntegrators.parse(name);
}

const char* to_string(Integrator integrator) noexcept {
  return kIntegrators.name(integrator);
}

LinearBodies::LinearBodies(int n)
    : inverse_mass(Vector::Zero(n)), damping(Matrix::Zero(n, n)), stiffness(Matrix::Zero(n, n)) {}

void LinearBodies::connect(int i, int j, double k, double b) {
  tie(i, k, b);
  tie(j, k, b);
  stiffness(i, j) -= k, stiffness(j, i) -= k;
  damping(i, j) -= b, damping(j, i) -= b;
}

void LinearBodies::tie(int i, double k, double b) {
  stiffness(i, i) += k;
  damping(i, i) += b;
}

LinearStep linear_step(Integrator integrator, const LinearBodies& bodies, double h) {
  constexpr int kRungeKuttaOrder = 4;
  switch (integrator) {
    case Integrator::euler:
      return by_series(bodies, h, [](const Augmented& x) { return x; });
    case Integrator::rk4:
      return by_series(bodies, h, [](const Augmented& x) { return exponential_series(x, kRungeKuttaOrder); });
    case Integrator::exact:
      return by_series(bodies, h, exponential_less_one);
    default:
      return by_kicks(integrator, bodies, h);
  }
}

double stability_limit(Integrator integrator, const LinearBodies& bodies) {
  switch (integrator) {
    case Integrator::semi_implicit:
      return time_of(2, largest_eigenvalue(companion(bodies, 1)));
    case Integrator::verlet:
      return time_of(2, std::sqrt(std::max(0.0, largest_eigenvalue(over_mass(bodies, bodies.stiffness)))));
    case Integrator::euler:
      return least_limit(bodies, euler_limit);
    case Integrator::rk4:
      return least_limit(bodies, runge_kutta_limit);
    case Integrator::implicit:
    case Integrator::exact:
      break;
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace haptrace
