// Kinematics of the Novint Falcon: the position of its handle and the torques of its motors.
#pragma once

#include "base/types.h"

#include <numbers>
#include <optional>

namespace haptrace {

/// Dimensions of a parallel manipulator that only translates, with three equal legs around z (R. E. Stamper, "A Three
/// Degree of Freedom Parallel Manipulator with Only Translational Degrees of Freedom", University of Maryland, 1997).
/// The mechanism's frame B has its origin in the middle between the motors, z out of the device towards the user, x to
/// the user's right, y up. A leg consists of a thigh, which a motor turns, and a shin at its elbow, which is a
/// parallelogram and holds the handle. The angle of a leg is 0 where the thigh points outward, and increases as the
/// elbow moves along z.
///
/// The defaults and the letters are those of FalconGeometry.h in libnifalcon; no device was measured for them.
struct FalconGeometry {
  double thigh = 0.060;            ///< a: from the motor's axis to the elbow's axis [m]
  double shin = 0.1025;            ///< b: the long sides of the parallelogram [m]
  double shin_offset = 0.0225;     ///< d + e: between the long sides and the axes of elbow and handle [m]
  double handle_radius = 0.01443;  ///< c: from the middle of the handle to the axis of a leg's end, outward [m]
  double handle_offset = -0.025;   ///< f: the same, along that axis [m]
  double base_radius = 0.040;      ///< r: from the origin to the axis of a leg's motor, outward [m]
  double base_offset = -0.02309;   ///< s: the same, along that axis [m]
  /// phi: directions of the legs, from x towards y [rad]. To the user the first leg is at the top, the second on the
  /// right, the third on the left.
  Vec3 azimuths = Vec3(105, -15, -135) * (std::numbers::pi / 180);
};

/// A pose: the position of the handle, and the legs that hold it there.
struct FalconPose {
  Vec3 angles;               ///< theta: angles of the legs [rad]
  Vec3 position;             ///< handle position in B [m]
  Eigen::Matrix3d jacobian;  ///< J = d position / d angles [m/rad]

  /// Returns the motor torques for `force` on the hand (B) [N]: tau = J^T F, by virtual work [N m].
  [[nodiscard]] Vec3 torques(const Vec3& force) const noexcept { return jacobian.transpose() * force; }
};

/// Conversion of the legs' angles to the handle position and back.
///
/// In a leg's own frame, u outward and v along the motor's axis, the elbow is at E = a (cos theta, 0, sin theta) and
/// the handle holds the leg's end at (U, V, z) = (u + c - r, v + f - s, z). The shin keeps that end on a torus around
/// E, with radii d + e and b. The end's distance from the torus is
///
///     g = sqrt((q - d - e)^2 + V^2) - b,   q = sqrt((U - E_u)^2 + (z - E_z)^2),   grad g = n,
///
/// where n, of length 1, is the direction of the shin. The handle is where all three g are 0. There, from g' = 0,
///
///     n_i . p' = k_i theta_i',   k_i = n_i . dE_i / d theta_i,   J = N^-1 diag(k)   with the n_i as rows of N.
///
/// A pose is reached if the device can take it: handle in front of motors and elbows, knees outward. Near a singularity
/// no pose is reached. There some force or motion is lost: a leg is stretched or folded (k = 0), a shin lies along its
/// motor's axis, or all shins lie in a plane (det N = 0).
///
/// Threads: any. Real-time: all but the constructor.
class FalconKinematics {
 public:
  /// Throws Error(input) if a length is implausible for a hand-held device, or two legs have nearly the same azimuth.
  explicit FalconKinematics(const FalconGeometry& geometry = {});

  /// Returns the pose with the handle at `position` (B) [m]; none if the legs do not reach it. Closed form: seen along
  /// the motor's axis, thigh and shin form a triangle over the line from the motor to the leg's end.
  [[nodiscard]] std::optional<FalconPose> at_position(const Vec3& position) const noexcept;

  /// Returns the pose with the legs at `angles` [rad] by Newton's method, with the position exact to 1e-12 m; none if
  /// legs at these angles cannot hold the handle. `near` (B) is the last position of the handle [m]. A closer one
  /// speeds up the search, but any finds the pose.
  [[nodiscard]] std::optional<FalconPose> at_angles(const Vec3& angles, const Vec3& near) const noexcept;
  [[nodiscard]] std::optional<FalconPose> at_angles(const Vec3& angles) const noexcept;

  [[nodiscard]] const FalconGeometry& geometry() const noexcept { return geometry_; }

 private:
  struct Legs;
  struct Shins;

  [[nodiscard]] Vec3 leg_end(int leg, const Vec3& position) const noexcept;
  [[nodiscard]] Shins shins(const Legs& legs, const Vec3& position) const noexcept;
  [[nodiscard]] std::optional<FalconPose> reached(const Legs& legs, const Vec3& position,
                                                  const Shins& shins) const noexcept;
  [[nodiscard]] std::optional<FalconPose> newton(const Legs& legs, Vec3 position) const noexcept;

  FalconGeometry geometry_;
  Vec3 cos_, sin_;      ///< cosines and sines of the azimuths
  double orientation_;  ///< sign of det N with the handle in front of the elbows
  Vec3 front_;          ///< point in front of the elbows at any angles
};

}  // namespace haptrace
