// The mechanism of the Novint Falcon: where its handle is, and what its motors do to it.
#pragma once

#include "base/types.h"

#include <numbers>
#include <optional>

namespace haptrace {

/// The lengths of a parallel manipulator that only translates, with three equal legs round z (R. E. Stamper, "A Three
/// Degree of Freedom Parallel Manipulator with Only Translational Degrees of Freedom", University of Maryland, 1997),
/// in the mechanism's frame B: origin in the middle between the motors, z out of the device towards the user, x to his
/// right, y up. A leg is a thigh, turned by a motor, and at its elbow a shin, which is a parallelogram and holds the
/// handle. Its angle is 0 where the thigh points outward, and grows as the elbow moves along z.
///
/// The defaults are those of FalconGeometry.h in libnifalcon, whose letters these are; no device was measured for them.
struct FalconGeometry {
  double thigh = 0.060;            ///< a: from the motor's axis to the elbow's [m]
  double shin = 0.1025;            ///< b: the long sides of the parallelogram [m]
  double shin_offset = 0.0225;     ///< d + e: between the long sides and the axes of elbow and handle [m]
  double handle_radius = 0.01443;  ///< c: from the middle of the handle to the axis of a leg's end, outward [m]
  double handle_offset = -0.025;   ///< f: the same, along that axis [m]
  double base_radius = 0.040;      ///< r: from the origin to the axis of a leg's motor, outward [m]
  double base_offset = -0.02309;   ///< s: the same, along that axis [m]
  /// phi: where the legs stand, from x towards y. To the user the first is above, the second right, the third left
  /// [rad]
  Vec3 azimuths = Vec3(105, -15, -135) * (std::numbers::pi / 180);
};

/// The handle in one place, and the legs that hold it there.
struct FalconPose {
  Vec3 angles;               ///< theta, of the legs [rad]
  Vec3 position;             ///< of the handle, in B [m]
  Eigen::Matrix3d jacobian;  ///< J = d position / d angles [m/rad]

  /// What the motors have to bring up for `force` on the hand (B) [N]: tau = J^T F, by virtual work [N m].
  [[nodiscard]] Vec3 torques(const Vec3& force) const noexcept { return jacobian.transpose() * force; }
};

/// From the angles of the legs to the position of the handle and back.
///
/// In a leg's own frame, u outward and v along the motor's axis, the elbow is at E = a (cos theta, 0, sin theta) and
/// the handle holds the leg's end at (U, V, z) = (u + c - r, v + f - s, z). The shin keeps that end on a torus round E,
/// of radii d + e and b. The end's distance from the torus is
///
///     g = sqrt((q - d - e)^2 + V^2) - b,   q = sqrt((U - E_u)^2 + (z - E_z)^2),   grad g = n,
///
/// where n, of length 1, is the direction of the shin. The handle is where all three g are 0. There, from g' = 0,
///
///     n_i . p' = k_i theta_i',   k_i = n_i . dE_i / d theta_i,   J = N^-1 diag(k)   with the n_i as rows of N.
///
/// A pose is reached when it is one of the device's: handle in front of motors and elbows, knees outward. Where a leg
/// is stretched or folded (k = 0), a shin lies along its motor's axis or all shins lie in a plane (det N = 0), some
/// force or motion is lost; poses very near to that are not reached either.
///
/// Threads: any. Real-time: all but the constructor.
class FalconKinematics {
 public:
  /// Throws Error(input) when a length is outside of what a hand-held device can have, or two legs stand in one place.
  explicit FalconKinematics(const FalconGeometry& geometry = {});

  /// The pose with the handle at `position` (B) [m]; none when the legs do not reach it. In closed form: seen along the
  /// motor's axis, thigh and shin make a triangle over the line from the motor to the leg's end.
  [[nodiscard]] std::optional<FalconPose> at_position(const Vec3& position) const noexcept;

  /// The pose with the legs at `angles` [rad], its position exact to 1e-12 m, by Newton's method; none when such legs
  /// hold the handle nowhere. `near` (B) is where the handle was last: the nearer, the sooner it is found, but it is
  /// found from anywhere.
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
  Vec3 cos_, sin_;      ///< of the azimuths
  double orientation_;  ///< the sign of det N with the handle in front of the elbows
  Vec3 front_;          ///< a place in front of the elbows, wherever they are
};

}  // namespace haptrace
