// What nobody verified of the Haply 2DIY, and a user can measure on his own.
#pragma once

#include "devices/haply/kinematics.h"

#include <array>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

namespace haptrace {

/// One arm of the pantograph, as its board knows it.
struct TwoDiyArm {
  int port = 1;             ///< of the board, for motor and encoder: 1 to 4
  bool motor_ccw = true;    ///< the sense in which the board drives the motor
  bool encoder_ccw = true;  ///< and counts
  double counts_per_turn = 4880;
  double stop_angle = 0;  ///< of the arm in its mechanical stop, which it lies on outward [rad]
};

/// The board, the arms and the frames. The defaults are what public sources state, differ from unit to unit in part,
/// were never tried on a device, and are explained, with how to measure each, in docs/devices/haply-2diy.md.
///
/// W, the frame of positions and forces that haptrace shows: x to the user's right, y away from him, z up; its origin
/// at `origin`, in the middle of the workspace.
///
/// Real-time: all members.
struct TwoDiyCalibration {
  std::string generation = "gen3";
  PantographGeometry geometry;
  std::array<TwoDiyArm, 2> arms;  ///< the first is at the origin of P
  int device_id = 5;
  double max_torque = 0.123;     ///< of a motor; the board sends no more [N m]
  Vec2 axis_sign{-1, -1};        ///< of W's x and y in P
  Vec2 origin{0.019, 0.115};     ///< of W, in P [m]
  Vec2 workspace{0.035, 0.025};  ///< from the origin to either side, in W [m]
  double max_force = 1.6;        ///< what the motors bring up in every direction of the workspace [N]

  [[nodiscard]] Vec3 to_world(const Vec2& position) const noexcept {
    const Vec2 p = axis_sign.cwiseProduct(position - origin);
    return {p.x(), p.y(), 0};
  }
  [[nodiscard]] Vec2 to_mechanism(const Vec3& position) const noexcept {
    return origin + axis_sign.cwiseProduct(position.head<2>());
  }
  /// A force in W, in P. Its z is lost.
  [[nodiscard]] Vec2 force_in_mechanism(const Vec3& force) const noexcept {
    return axis_sign.cwiseProduct(force.head<2>());
  }
  [[nodiscard]] Vec3 force_in_world(const Vec2& force) const noexcept {
    const Vec2 f = axis_sign.cwiseProduct(force);
    return {f.x(), f.y(), 0};
  }
  /// The torques for a force (W) on the hand. Torques larger than the motors' are scaled down together, so that the
  /// force keeps its direction; torques that are not finite are none.
  [[nodiscard]] Vec2 torques(const PantographPose& pose, const Vec3& force) const noexcept;

  [[nodiscard]] Vec2 stops() const noexcept { return {arms[0].stop_angle, arms[1].stop_angle}; }
};

/// Of "gen2" (metal), "gen3" (plastic) or "devkit". Throws Error(input) naming `where`.
TwoDiyCalibration two_diy_calibration(const std::string& generation, const std::string& where);

/// Reads a calibration from JSON, whose keys samples/devices/haply-2diy.json explains; what is left out keeps the
/// default of its generation, which is `generation` where the file names none. Throws Error(input) naming `where` and
/// the key: unknown, outside its range, or at odds with another, as when the arms do not reach the workspace.
TwoDiyCalibration read_two_diy_calibration(const nlohmann::json& json, const std::string& where,
                                           const std::string& generation = "gen3");

}  // namespace haptrace
