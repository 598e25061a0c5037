// One step of linear bodies under a constant force, by the integration methods of simulations.
#pragma once

#include <Eigen/Core>

#include <string>
#include <string_view>

namespace haptrace {

/// Method that advances m x'' + b x' + k x = f by a step h. Order: order of the error over a given time of a smooth
/// movement. Limit: the largest step with which no movement grows by itself; w = sqrt(k / m). (Hairer, Lubich and
/// Wanner, Geometric Numerical Integration, ch. I; Hairer and Wanner, Solving Ordinary Differential Equations II, ch.
/// IV.2.)
enum class Integrator {
  semi_implicit,  ///< v += h a(x, v), then x += h v: symplectic Euler. Order 1, limit (sqrt(b^2 + 4 m k) - b) / k
  euler,          ///< x += h v, v += h a(x, v), both with old values. Order 1, limit b / k; overdamped 2 / fastest rate
  verlet,         ///< half a kick, drift, half a kick. Order 2, limit 2 / w for any b
  rk4,            ///< classical Runge-Kutta method. Order 4, limit 2 sqrt(2) / w undamped, 2.785 m / b without k
  implicit,       ///< v += h a(x + h v, v) with the new v, then x += h v: backward Euler. Order 1, no limit
  exact,          ///< matrix exponential: no error while f is constant, no limit
};

Integrator parse_integrator(std::string_view name);  ///< throws Error(input) naming the known ones
const char* to_string(
    Integrator integrator) noexcept;  ///< "semi-implicit", "euler", "verlet", "rk4", "implicit", "exact"

/// Up to three bodies along one axis, q'' = W (f - B q' - K q). Passive: the masses are positive; B and K are symmetric
/// and have no negative eigenvalues.
struct LinearBodies {
  static constexpr int kMost = 3;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMost, 1>;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, kMost>;

  Vector inverse_mass;  ///< diagonal of W; zero: the body is held [1/kg]
  Matrix damping;       ///< B [N s/m]
  Matrix stiffness;     ///< K [N/m]

  /// Creates `n` bodies that are held and not connected.
  explicit LinearBodies(int n = 1);
  /// Adds a spring k and a damper b between bodies i and j.
  void connect(int i, int j, double k, double b);
  /// Adds a spring k and a damper b between body i and the ground.
  void tie(int i, double k, double b);

  [[nodiscard]] int size() const noexcept { return static_cast<int>(inverse_mass.size()); }
};

/// The map x' = phi x + gamma f for x = (q, v), with f constant over the step.
struct LinearStep {
  static constexpr int kMost = 2 * LinearBodies::kMost;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, kMost> phi;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, LinearBodies::kMost> gamma;
};

/// Computes one step. In verlet, the first kick uses the damper at the old velocity and the second one at the new
/// velocity, which is solved for (Brunger, Brooks and Karplus, Chemical Physics Letters 105, 1984). Its positions are
/// those of central differences, so that damping does not reduce the limit.
///
/// Accepts any step h > 0 [s]; beyond the limit of a method, a movement grows. Rounding: the exact method has an error
/// of 1e-16 for every radian of the fastest mode in a step; an overdamped mode loses no accuracy, however light the
/// body is. Allocates nothing.
LinearStep linear_step(Integrator integrator, const LinearBodies& bodies, double h);

/// Returns the largest step with which no movement grows [s]; infinity: every step is stable, 0: no step is.
///
/// With several bodies, euler and rk4 take the least of the limits of the eigenvalues of q'' = -W (B q' + K q), and
/// verlet takes 2 / w with the largest eigenvalue w^2 of W K. For semi_implicit, every z with det((z - 1)^2 + h (z - 1)
/// W B + z h^2 W K) = 0 has an eigenvector for which z is that of one body. It becomes unstable only through z = -1,
/// where 4 - 2 h W B - h^2 W K is singular: h = 2 / s, with s the largest eigenvalue of [0 1; W K, W B].
double stability_limit(Integrator integrator, const LinearBodies& bodies);

}  // namespace haptrace
