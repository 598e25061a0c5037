// How the mass of a device varies over its workspace.
#pragma once

#include "base/types.h"

#include <cmath>
#include <utility>

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

  /// Returns the rms of the factors over the centre and places half and all the way to the reach along each axis.
  [[nodiscard]] Vec3 typical() const noexcept {
    Vec3 squares = Vec3::Zero();
    int places = 0;
    visit([&](const Vec3& factors) {
      squares += factors.cwiseAbs2();
      ++places;
    });
    return (squares / places).cwiseSqrt();
  }

  /// Returns the smallest and the largest factors at these places.
  [[nodiscard]] std::pair<Vec3, Vec3> range() const noexcept {
    std::pair<Vec3, Vec3> range{Vec3::Ones(), Vec3::Ones()};
    visit([&](const Vec3& factors) { range = {range.first.cwiseMin(factors), range.second.cwiseMax(factors)}; });
    return range;
  }

 private:
  template <class See>
  void visit(const See& see) const noexcept {
    see(at(centre));
    for (int axis = 0; axis < 3; ++axis)
      for (const double share : {-1.0, -0.5, 0.5, 1.0})
        if (reach[axis] > 0) see(at(centre + share * reach[axis] * Vec3::Unit(axis)));
  }
};

}  // namespace haptrace
