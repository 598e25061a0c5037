// The mechanism of the Haply 2DIY: a pantograph, two arms that hold one handle in the plane.
#pragma once

#include "base/types.h"

#include <optional>

namespace haptrace {

using Vec2 = Eigen::Vector2d;

/// Lengths of a five-bar linkage in its own frame P: origin on the first motor's axis, x from it to the second motor's,
/// y towards the handle. An arm's angle is that of its inner link, from x towards y.
struct PantographGeometry {
  double proximal = 0.07;     ///< l: from a motor to its elbow [m]
  double distal = 0.09;       ///< L: from an elbow to the handle [m]
  double separation = 0.038;  ///< d: between the motors; 0 where they share an axis [m]
};

/// The handle in one place, and the arms that hold it there.
struct PantographPose {
  Vec2 angles;               ///< theta, of the arms [rad]
  Vec2 position;             ///< of the handle, in P [m]
  Eigen::Matrix2d jacobian;  ///< J = d position / d angles [m/rad]

  /// What the motors have to bring up for `force` on the hand (P) [N]: tau = J^T F, by virtual work [N m].
  [[nodiscard]] Vec2 torques(const Vec2& force) const noexcept { return jacobian.transpose() * force; }
  /// The force on the hand that these torques make.
  [[nodiscard]] Vec2 force(const Vec2& torques) const noexcept { return jacobian.transpose().inverse() * torques; }
};

/// From the angles of the arms to the position of the handle and back.
///
/// The elbows are at A = (l cos theta_1, l sin theta_1) and B = (d + l cos theta_2, l sin theta_2). The handle is where
/// circles of radius L round both meet, on the far side of the elbows (the left of the way from A to B). With the
/// directions n_i of the outer links, from |p - A| = |p - B| = L,
///
///     n_i . p' = k_i theta_i',   k_i = l n_i . (-sin theta_i, cos theta_i),   J = N^-1 diag(k)   with the n_i as rows.
///
/// A pose is reached when it is the device's: handle beyond the elbows, knees outward (k_1 < 0 < k_2). Where an arm is
/// stretched (k = 0) or both outer links lie in a line (det N = 0), a motion or a force is lost; poses very near to
/// that are not reached either.
///
/// Threads: any. Real-time: all but the constructor.
class PantographKinematics {
 public:
  /// Throws Error(input) when a length is outside of what a device for a hand can have.
  explicit PantographKinematics(const PantographGeometry& geometry = {});

  [[nodiscard]] std::optional<PantographPose> at_angles(const Vec2& angles) const noexcept;
  /// In closed form: inner and outer link make a triangle over the line from the motor to the handle.
  [[nodiscard]] std::optional<PantographPose> at_position(const Vec2& position) const noexcept;

 private:
  PantographGeometry geometry_;
};

}  // namespace haptrace
