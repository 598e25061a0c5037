#include "control/design/riccati.h"

#include "base/eigenvalues.h"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Random numbers that do not depend on the standard library's distributions.
class Numbers {
 public:
  double next() { return static_cast<double>(engine_()) / 2147483648.0 - 1; }
  MatrixXd matrix(Eigen::Index rows, Eigen::Index columns) {
    return MatrixXd::NullaryExpr(rows, columns, [&] { return next(); });
  }

 private:
  std::mt19937 engine_{7};
};

TEST(Riccati, SolvesItsEquationAndStabilisesRandomSystems) {
  Numbers numbers;
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Index n = 1 + trial % 12;
    const MatrixXd a = numbers.matrix(n, n), root = numbers.matrix(n + 1, n + 1);
    const VectorXd b = numbers.matrix(n, 1);
    const MatrixXd weights = root * root.transpose() + 1e-3 * MatrixXd::Identity(n + 1, n + 1);
    const MatrixXd q = weights.topLeftCorner(n, n);
    const VectorXd s = weights.topRightCorner(n, 1);
    const double r = weights(n, n);
    const auto x = solve_riccati(a, b, q, r, s);
    ASSERT_TRUE(x) << trial;
    const VectorXd mixed = a.transpose() * *x * b + s;
    const double denominator = r + b.dot(*x * b);
    const MatrixXd again = a.transpose() * *x * a - mixed * mixed.transpose() / denominator + q;
    EXPECT_LT((again - *x).norm(), 1e-7 * x->norm()) << trial;
    EXPECT_LT(spectral_radius(a - b * mixed.transpose() / denominator), 1) << trial;
  }
}

TEST(Riccati, AgreesWithTheClosedFormOfAScalar) {
  // x = a^2 x - (a x b)^2 / (r + b^2 x) + q
  const double a = 1.3, b = 0.7, q = 2, r = 0.5;
  const double p = r - a * a * r - b * b * q;
  const double expected = (-p + std::sqrt(p * p + 4 * b * b * q * r)) / (2 * b * b);
  const auto x = solve_riccati(MatrixXd::Constant(1, 1, a), VectorXd::Constant(1, b), MatrixXd::Constant(1, 1, q), r,
                               VectorXd::Zero(1));
  ASSERT_TRUE(x);
  EXPECT_NEAR((*x)(0, 0), expected, 1e-12 * expected);
}

TEST(Riccati, HasNoSolutionForASystemThatItsInputCannotStabilise) {
  EXPECT_FALSE(
      solve_riccati(MatrixXd::Constant(1, 1, 1.1), VectorXd::Zero(1), MatrixXd::Ones(1, 1), 1, VectorXd::Zero(1)));
}

TEST(Lyapunov, SolvesItsEquation) {
  Numbers numbers;
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Index n = 1 + trial % 10;
    MatrixXd a = numbers.matrix(n, n);
    a *= (trial % 2 == 0 ? 0.7 : 0.9999) / spectral_radius(a);
    const MatrixXd root = numbers.matrix(n, n), q = root * root.transpose();
    const auto p = solve_lyapunov(a, q);
    ASSERT_TRUE(p) << trial;
    EXPECT_LT((a * *p * a.transpose() + q - *p).norm(), 1e-8 * p->norm()) << trial;
  }
}

TEST(Lyapunov, HasNoSolutionForASystemThatIsNotStable) {
  EXPECT_FALSE(solve_lyapunov(MatrixXd::Constant(1, 1, 1.0), MatrixXd::Ones(1, 1)));
  EXPECT_FALSE(solve_lyapunov(MatrixXd::Constant(1, 1, 1.001), MatrixXd::Ones(1, 1)));
}

}  // namespace
}  // namespace haptrace
