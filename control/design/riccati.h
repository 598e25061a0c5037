// Riccati and Lyapunov equations in discrete time.
#pragma once

#include <Eigen/Core>

#include <optional>

namespace haptrace {

/// Returns the stabilising solution X of the discrete algebraic Riccati equation with one input,
///
///     X = A' X A - (A' X b + s) (r + b' X b)^-1 (A' X b + s)' + Q
///
/// by the structure-preserving doubling algorithm (Chu, Fan, Lin and Wang 2004, "Structure-preserving algorithms for
/// periodic discrete-time algebraic Riccati equations", Int. J. Control 77(8), SDA):
///
///     A_0 = A - b s' / r,   G_0 = b b' / r,   H_0 = Q - s s' / r
///     W = I + G H,   A <- A W^-1 A,   G <- G + A W^-1 G A',   H <- H + A' H W^-1 A
///
/// H converges to X quadratically. `q` is symmetric and positive semidefinite together with s and r, and r > 0. Returns
/// nothing if the iteration does not converge, which means that no input stabilises the system or that Q does not see a
/// motion that persists. Allocates.
std::optional<Eigen::MatrixXd> solve_riccati(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                                             const Eigen::MatrixXd& q, double r, const Eigen::VectorXd& s);

/// Returns the solution P of the discrete Lyapunov equation P = A P A' + Q by squaring (Smith 1968, "Matrix equation
/// XA + BX = C", SIAM J. Appl. Math. 16(1)):
///
///     P <- P + A P A',   A <- A^2
///
/// Q is symmetric and positive semidefinite. Returns nothing if A has an eigenvalue on or outside the unit circle that
/// Q excites, or one so close to it that its memory exceeds 2^40 steps. Allocates.
std::optional<Eigen::MatrixXd> solve_lyapunov(const Eigen::MatrixXd& a, const Eigen::MatrixXd& q);

}  // namespace haptrace
