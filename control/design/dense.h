// Linear algebra of dense matrices of any size. Each function has a single type: Eigen compiles every other type anew,
// and inline these take most of a minute in every source.
#pragma once

#include <Eigen/Core>

namespace haptrace {

Eigen::MatrixXd product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Computes A^T B.
Eigen::MatrixXd transposed_product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Solves A X = B for a symmetric A without negative eigenvalues.
Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Computes the X for which A X is nearest to B.
Eigen::MatrixXd least_squares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Computes the residual B - A X with that X.
Eigen::MatrixXd least_squares_rest(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

}  // namespace haptrace
