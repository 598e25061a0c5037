// How the mass of a device varies over its workspace.
#pragma once

#include "base/types.h"

#include <cmath>

namespace haptrace {

/// Factors on the mass of each axis of W, which depend on the place x:
///
///     s_i(x) = 1 + sum_j (slope_ij d_j + (bend_ij + curve_ij r^2) d_j^2),
///
///     d = x - centre,   r^2 = sum_j (d_j / reach_j)^2
///
/// Beyond the ellipsoid r = 1, d is the point of it in the same direction. The factors are clamped to the range from
/// `least` to `most`. Nothing was measured beyond either.
///
/// Real-time.
struct InertiaMap {
  Vec3 centre = Vec3::Zero();                       ///< place where the factors are 1 [m]
  Vec3 reach = Vec3::Zero();                        ///< 0 along an axis: the factors do not depend on it [m]
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();  ///< a row for each axis of the mass [1/m]
  Eigen::Matrix3d bend = Eigen::Matrix3d::Zero();   ///< a row for each axis of the mass [1/m^2]
  Eigen::Matrix3d curve = Eigen::Matrix3d::Zero();  ///< a row for each axis of the mass [1/m^2]
  Vec3 least = Vec3::Ones(), most = Vec3::Ones();   ///< bounds

  [[nodiscard]] Vec3 at(const Vec3& position) const noexcept {
    Vec3 d = Vec3::Zero();
    double r2 = 0;
    for (int axis = 0; axis < 3; ++axis) {
      if (!(reach[axis] > 0)) continue;
      d[axis] = position[axis] - centre[axis];
      r2 += d[axis] * d[axis] / (reach[axis] * reach[axis]);
    }
    if (r2 > 1) {
      d /= std::sqrt(r2);
      r2 = 1;
    }
    return (Vec3::Ones() + slope * d + (bend + r2 * curve) * d.cwiseProduct(d)).cwiseMax(least).cwiseMin(most);
  }
};

}  // namespace haptrace
