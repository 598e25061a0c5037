// The actuators' axes, found from the friction along and across the sweeps of an identification.
#pragma once

#include "control/design/plant_model.h"

#include <Eigen/Core>

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Samples of one stretch in which the device slides, n rows, in the order of time.
struct SlidingRows {
  Eigen::MatrixXd velocity;                       ///< n x 3 [m/s]
  Eigen::MatrixXd force;                          ///< on the hand, n x 3 [N]
  Eigen::MatrixXd others;                         ///< regressors of everything but friction, one a column
  std::array<std::vector<Eigen::Index>, 3> used;  ///< the columns of `others` that each component of the force has
  std::vector<Eigen::Index> blocks;               ///< first row of every block of the jackknife, from 0
};

/// Finds the actuators' axes from the force that Coulomb friction in them takes,
///
///     R^T diag(F_c) tanh(R v / v_0) + others
///
/// with R from W to the actuators' axes. While the device moves along one axis of W, friction in turned actuators also
/// pushes across it. For a given R the force is linear in F_c and in the coefficients of the others, so that only the
/// three angles of R are searched: on a grid, then with the simplex method from its best points. Axes that differ in
/// order or sign only are the same; the result has the smallest angle.
///
/// Returns nothing unless the rotation explains clearly more of the force than the axes of W do, and unless the
/// jackknife finds the axes of W outside the confidence interval of the rotation. Slow: some 10^4 products of the rows
/// with the regressors. Not real-time: it allocates.
std::optional<ActuatorFriction> find_friction_axes(std::span<const SlidingRows> stretches);

}  // namespace haptrace
