// How the mass of a device varies over its workspace.
#pragma once

#include "base/types.h"

namespace haptrace {

/// Factors on the mass of each axis of W, which depend on the place x:
///
///     s_i(x) = 1 + sum_j (slope_ij d_j + bend_ij d_j^2),   d = x - centre
///
/// d is clamped to `reach`, and the factors to the range from `least` to `most`, beyond which nothing was measured.
///
/// Real-time.
struct InertiaMap {
  Vec3 centre = Vec3::Zero();                       ///< place where the factors are 1 [m]
  Vec3 reach = Vec3::Zero();                        ///< [m]
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();  ///< a row for each axis of the mass [1/m]
  Eigen::Matrix3d bend = Eigen::Matrix3d::Zero();   ///< a row for each axis of the mass [1/m^2]
  Vec3 least = Vec3::Ones(), most = Vec3::Ones();   ///< bounds

  [[nodiscard]] Vec3 at(const Vec3& position) const noexcept {
    const Vec3 d = (position - centre).cwiseMax(-reach).cwiseMin(reach);
    return (Vec3::Ones() + slope * d + bend * d.cwiseProduct(d)).cwiseMax(least).cwiseMin(most);
  }
};

}  // namespace haptrace
