// Kinematics of the Haply 2DIY: a pantograph, two arms that hold one handle in the plane.
#pragma once

#include "base/types.h"

#include <optional>

namespace haptrace {

using Vec2 = Eigen::Vector2d;

/// Lengths of a five-bar linkage. Its frame P has its origin on the first motor's axis, x from there to the second
/// motor's axis, y towards the handle. The angle of an arm is that of its inner link, from x towards y.
struct PantographGeometry {
  double proximal = 0.07;     ///< l: from a motor to its elbow [m]
  double distal = 0.09;       ///< L: from an elbow to the handle [m]
  double separation = 0.038;  ///< d: between the motors; 0 if they share an axis [m]
};

/// A pose: the position of the handle, and the arms that hold it there.
struct PantographPose {
  Vec2 angles;               ///< theta: angles of the arms [rad]
  Vec2 position;             ///< handle position in P [m]
  Eigen::Matrix2d jacobian;  ///< J = d position / d angles [m/rad]

  /// Returns the motor torques for `force` on the hand (P) [N]: tau = J^T F, by virtual work [N m].
  [[nodiscard]] Vec2 torques(const Vec2& force) const noexcept { return jacobian.transpose() * force; }
  /// Returns the force on the hand (P) that `torques` produce [N].
  [[nodiscard]] Vec2 force(const Vec2& torques) const noexcept { return jacobian.transpose().inverse() * torques; }
};

/// Conversion of the arms' angles to the handle position and back.
///
/// The elbows are at A = (l cos theta_1, l sin theta_1) and B = (d + l cos theta_2, l sin theta_2). The handle is where
/// circles of radius L around both meet, on the far side of the elbows (to the left of the line from A to B). With the
/// directions n_i of the outer links, from |p - A| = |p - B| = L,
///
///     n_i . p' = k_i theta_i',   k_i = l n_i . (-sin theta_i, cos theta_i),   J = N^-1 diag(k)   with the n_i as rows.
///
/// A pose is reached if the device can take it: handle beyond the elbows, knees outward (k_1 < 0 < k_2). Near a
/// singularity no pose is reached. There a motion or a force is lost: an arm is stretched (k = 0), or both outer links
/// lie in a line (det N = 0).
///
/// Threads: any. Real-time: all but the constructor.
class PantographKinematics {
 public:
  /// Throws Error(input) if a length is implausible for a hand-held device.
  explicit PantographKinematics(const PantographGeometry& geometry = {});

  [[nodiscard]] std::optional<PantographPose> at_angles(const Vec2& angles) const noexcept;
  /// Returns the pose in closed form: inner and outer link form a triangle over the line from the motor to the handle.
  [[nodiscard]] std::optional<PantographPose> at_position(const Vec2& position) const noexcept;

 private:
  PantographGeometry geometry_;
};

}  // namespace haptrace
