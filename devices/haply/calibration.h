// Calibration of a Haply 2DIY: parameters that nobody has verified and that users can measure on their own device.
#pragma once

#include "devices/haply/kinematics.h"

#include <array>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

namespace haptrace {

/// One arm of the pantograph, as the board is set up for it.
struct TwoDiyArm {
  int port = 1;             ///< port of the board for motor and encoder: 1 to 4
  bool motor_ccw = true;    ///< sense in which the board drives the motor
  bool encoder_ccw = true;  ///< sense in which the encoder counts
  double counts_per_turn = 4880;
  double stop_angle = 0;  ///< angle of the arm in its outer mechanical stop [rad]
};

/// Parameters of the board, the arms and the frames. The defaults come from public sources and were never tried on a
/// device; some differ from unit to unit. docs/devices/haply-2diy.md explains them and how to measure each.
///
/// W is the frame of the positions and forces that haptrace shows: x to the user's right, y away from the user, z up;
/// its origin is at `origin`, in the middle of the workspace.
///
/// Real-time: all members.
struct TwoDiyCalibration {
  std::string generation = "gen3";
  PantographGeometry geometry;
  std::array<TwoDiyArm, 2> arms;  ///< the first is at the origin of P
  int device_id = 5;
  double max_torque = 0.123;     ///< limit of each motor, which the board enforces [N m]
  Vec2 axis_sign{-1, -1};        ///< signs of W's x and y in P
  Vec2 origin{0.019, 0.115};     ///< origin of W in P [m]
  Vec2 workspace{0.035, 0.025};  ///< half extents around the origin, in W [m]
  double max_force = 1.6;        ///< force available in every direction of the workspace [N]

  [[nodiscard]] Vec3 to_world(const Vec2& position) const noexcept {
    const Vec2 p = axis_sign.cwiseProduct(position - origin);
    return {p.x(), p.y(), 0};
  }
  [[nodiscard]] Vec2 to_mechanism(const Vec3& position) const noexcept {
    return origin + axis_sign.cwiseProduct(position.head<2>());
  }
  /// Transforms a force from W to P, without its z.
  [[nodiscard]] Vec2 force_in_mechanism(const Vec3& force) const noexcept {
    return axis_sign.cwiseProduct(force.head<2>());
  }
  [[nodiscard]] Vec3 force_in_world(const Vec2& force) const noexcept {
    const Vec2 f = axis_sign.cwiseProduct(force);
    return {f.x(), f.y(), 0};
  }
  /// Returns the torques for `force` on the hand (W) [N m]. If torques exceed max_torque, all are scaled down together,
  /// so that the force keeps its direction. Torques that are not finite become zero.
  [[nodiscard]] Vec2 torques(const PantographPose& pose, const Vec3& force) const noexcept;

  [[nodiscard]] Vec2 stops() const noexcept { return {arms[0].stop_angle, arms[1].stop_angle}; }
};

/// Returns the defaults of the generation "gen2" (metal), "gen3" (plastic) or "devkit". Throws Error(input) naming
/// `where` for any other.
TwoDiyCalibration two_diy_calibration(const std::string& generation, const std::string& where);

/// Reads a calibration from JSON. samples/devices/haply-2diy.json explains the keys; missing keys keep the defaults of
/// the generation, which is `generation` if the file names none. Throws Error(input) naming `where` and the key if a
/// key is unknown, out of range or inconsistent with another, for example if the arms do not reach the workspace.
TwoDiyCalibration read_two_diy_calibration(const nlohmann::json& json, const std::string& where,
                                           const std::string& generation = "gen3");

}  // namespace haptrace
