#include "base/eigenvalues.h"

#include <Eigen/Eigenvalues>

#include <algorithm>

namespace haptrace {

std::vector<std::complex<double>> eigenvalues_of(const Eigen::MatrixXd& matrix) {
  if (matrix.size() == 0) return {};
  const Eigen::VectorXcd found = Eigen::EigenSolver<Eigen::MatrixXd>(matrix, false).eigenvalues();
  return {found.begin(), found.end()};
}

double spectral_radius(const Eigen::MatrixXd& matrix) {
  double largest = 0;
  for (const std::complex<double>& value : eigenvalues_of(matrix)) largest = std::max(largest, std::abs(value));
  return largest;
}

}  // namespace haptrace
