// Eigenvalues of a real matrix.
#pragma once

#include <Eigen/Core>

#include <complex>
#include <vector>

namespace haptrace {

/// Returns the eigenvalues of a square matrix of finite numbers, each as often as its multiplicity, in no order (QR
/// algorithm on the Hessenberg form, as Eigen has it). Compiled once: a source that instantiates Eigen's solver for a
/// type of its own takes some fifteen seconds longer to compile.
std::vector<std::complex<double>> eigenvalues_of(const Eigen::MatrixXd& matrix);

/// Returns the largest modulus of the eigenvalues. From 1 on, a state that the matrix advances does not fade.
double spectral_radius(const Eigen::MatrixXd& matrix);

}  // namespace haptrace
