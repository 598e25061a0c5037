#include "control/design/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>

namespace haptrace {

using Eigen::MatrixXd;

MatrixXd product(const MatrixXd& a, const MatrixXd& b) {
  return a * b;
}

MatrixXd transposed_product(const MatrixXd& a, const MatrixXd& b) {
  return a.transpose() * b;
}

MatrixXd solve_symmetric(const MatrixXd& a, const MatrixXd& b) {
  return a.ldlt().solve(b);
}

MatrixXd least_squares(const MatrixXd& a, const MatrixXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

MatrixXd least_squares_rest(const MatrixXd& a, const MatrixXd& b) {
  return b - product(a, least_squares(a, b));
}

}  // namespace haptrace
