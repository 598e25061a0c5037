#include "control/design/riccati.h"

#include <Eigen/LU>

#include <cmath>

namespace haptrace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

std::optional<MatrixXd> solve_riccati(const MatrixXd& a, const VectorXd& b, const MatrixXd& q, double r,
                                      const VectorXd& s) {
  constexpr int kMostDoublings = 40;
  constexpr double kConverged = 1e-13;  // relative change
  MatrixXd transition = a - b * s.transpose() / r;
  MatrixXd g = b * b.transpose() / r;
  MatrixXd h = q - s * s.transpose() / r;
  for (int doubling = 0; doubling < kMostDoublings; ++doubling) {
    MatrixXd w = g * h;
    w.diagonal().array() += 1;
    const Eigen::PartialPivLU<MatrixXd> lu(w);
    const MatrixXd to_transition = lu.solve(transition), to_g = lu.solve(g);  // W^-1 A, W^-1 G
    const MatrixXd more_h = transition.transpose() * (h * to_transition);
    g += transition * to_g * transition.transpose();
    g = 0.5 * (g + g.transpose()).eval();
    h += 0.5 * (more_h + more_h.transpose());
    transition = (transition * to_transition).eval();
    const double size = h.norm(), change = more_h.norm();
    if (!std::isfinite(size)) return std::nullopt;
    if (change <= kConverged * size) return h;
  }
  return std::nullopt;
}

std::optional<MatrixXd> solve_lyapunov(const MatrixXd& a, const MatrixXd& q) {
  constexpr int kMostDoublings = 40;
  constexpr double kConverged = 1e-13;  // relative change
  MatrixXd power = a, p = q;
  for (int doubling = 0; doubling < kMostDoublings; ++doubling) {
    const MatrixXd half = power * p;
    const MatrixXd more = half * power.transpose();
    p += more;
    const double size = p.norm();
    if (!std::isfinite(size)) return std::nullopt;
    if (more.norm() <= kConverged * size) return p;
    power = (power * power).eval();
  }
  return std::nullopt;
}

}  // namespace haptrace
