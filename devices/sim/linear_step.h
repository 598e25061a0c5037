// One step of linear bodies under a force that is held, by the methods that simulations use.
#pragma once

#include <Eigen/Core>

#include <string>
#include <string_view>

namespace haptrace {

/// How m x'' + b x' + k x = f is carried on by a step h. Order: of the error over a given time of a smooth movement.
/// Limit: the largest step with which no movement grows by itself; w = sqrt(k / m). (Hairer, Lubich and Wanner,
/// Geometric Numerical Integration, ch. I; Hairer and Wanner, Solving Ordinary Differential Equations II, ch. IV.2.)
enum class Integrator {
  semi_implicit,  ///< v += h a(x, v), then x += h v: symplectic Euler. Order 1, limit (sqrt(b^2 + 4 m k) - b) / k
  euler,          ///< x += h v and v += h a(x, v), both of before. Order 1, limit b / k; overdamped 2 / fastest rate
  verlet,         ///< half a kick, drift, half a kick. Order 2, limit 2 / w whatever b
  rk4,            ///< the classical Runge-Kutta method. Order 4, limit 2 sqrt(2) / w undamped, 2.785 m / b without k
  implicit,       ///< v += h a(x + h v, v) of the new v, then x += h v: backward Euler. Order 1, no limit
  exact,          ///< the matrix exponential: no error while f is held, no limit
};

Integrator parse_integrator(std::string_view name);  ///< throws Error(input) naming the known ones
const char* to_string(
    Integrator integrator) noexcept;  ///< "semi-implicit", "euler", "verlet", "rk4", "implicit", "exact"

/// Up to three bodies along one axis, q'' = W (f - B q' - K q). Passive: masses positive, B and K symmetric and without
/// negative eigenvalues.
struct LinearBodies {
  static constexpr int kMost = 3;
  using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMost, 1>;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, kMost>;

  Vector inverse_mass;  ///< the diagonal of W; zero: the body is held [1/kg]
  Matrix damping;       ///< B [N s/m]
  Matrix stiffness;     ///< K [N/m]

  /// `n` bodies that nothing connects, each held.
  explicit LinearBodies(int n = 1);
  /// A spring k and a damper b between bodies i and j.
  void connect(int i, int j, double k, double b);
  /// And between body i and the ground.
  void tie(int i, double k, double b);

  [[nodiscard]] int size() const noexcept { return static_cast<int>(inverse_mass.size()); }
};

/// x' = phi x + gamma f for x = (q, v), f held over the step.
struct LinearStep {
  static constexpr int kMost = 2 * LinearBodies::kMost;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, kMost> phi;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMost, LinearBodies::kMost> gamma;
};

/// Verlet's first kick takes the damper at the old velocity and its second at the new one, which is solved for
/// (Brunger, Brooks and Karplus, Chemical Physics Letters 105, 1984): its positions are those of central differences,
/// so that damping takes nothing from the limit.
///
/// Any step h > 0 [s]; one beyond the limit of a method makes a movement grow. Rounding: what is exact is so but for
/// 1e-16 for every radian of the fastest mode in a step; an overdamped mode loses nothing, however light the body is.
/// Allocates nothing.
LinearStep linear_step(Integrator integrator, const LinearBodies& bodies, double h);

/// The largest modulus of the eigenvalues of phi: above 1, a movement grows by itself.
double spectral_radius(const LinearStep& step);

/// The largest step that does not let any movement grow [s]; infinity: every step is stable, 0: none is.
///
/// Of several bodies: for euler and rk4 the least of the limits of the eigenvalues of q'' = -W (B q' + K q); verlet's
/// 2 / w with the largest eigenvalue w^2 of W K; for semi_implicit every z with det((z - 1)^2 + h (z - 1) W B +
/// z h^2 W K) = 0 has an eigenvector for which it is that of one body, unstable through z = -1 only, where
/// 4 - 2 h W B - h^2 W K is singular: h = 2 / s, s the largest eigenvalue of [0 1; W K, W B].
double stability_limit(Integrator integrator, const LinearBodies& bodies);

}  // namespace haptrace
