// Calibration of a Novint Falcon: parameters that nobody has verified and that users can measure on their own device.
#pragma once

#include "devices/falcon/kinematics.h"
#include "devices/falcon/protocol.h"

#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Lights of the logo.
struct FalconLights {
  bool red = false, green = false, blue = false;
};

/// Conversion of encoder counts to radians, of torques to motor counts, and of lights and homing to flag bits. Vectors
/// hold one value per leg unless they name a frame. The defaults come from public sources and were never tried on a
/// device; docs/devices/falcon.md explains them and how to measure each.
///
/// Real-time: all members.
struct FalconCalibration {
  static constexpr double kMotorTurn = 1280, kArmDiameter = 0.110, kCapstanDiameter = 0.01425;  // [counts], [m], [m]

  FalconGeometry geometry;

  /// Encoder counts per radian of a leg's angle [1/rad].
  Vec3 counts_per_rad = Vec3::Constant(kMotorTurn / (2 * std::numbers::pi) * kArmDiameter / kCapstanDiameter);
  Vec3 encoder_sign = Vec3::Ones();                               ///< -1 if the counts fall as the leg rises
  Vec3 home_angle = Vec3::Constant(35 * std::numbers::pi / 180);  ///< leg angle at count 0, once homed [rad]

  Vec3 counts_per_n_m = Vec3::Constant(10'000);  ///< motor counts per torque that raises a leg [1/(N m)]
  Vec3 motor_sign = -Vec3::Ones();               ///< -1 if positive counts lower the leg
  int max_motor_counts = 4095;                   ///< largest motor counts that are sent

  std::uint8_t homing_flag = 0x01;  ///< bit of FalconPacket::flags, like the next three
  std::uint8_t red_flag = 0x08;
  std::uint8_t green_flag = 0x02;
  std::uint8_t blue_flag = 0x04;

  Vec3 origin = Vec3(0, 0, 0.12);         ///< origin of W in B; the axes are parallel [m]
  Vec3 workspace = Vec3::Constant(0.04);  ///< half extents around the origin, in W [m]
  double max_force = 8;                   ///< magnitude [N]

  /// Returns the angles of the legs, once they are homed [rad].
  [[nodiscard]] Vec3 angles(const std::array<std::int16_t, 3>& encoders) const noexcept;

  /// Returns motor counts for torques that raise the legs [N m]. If the counts exceed max_motor_counts, all are scaled
  /// down together, so that the force keeps its direction. Torques that are not finite give zero counts.
  [[nodiscard]] std::array<std::int16_t, 3> motors(const Vec3& torques) const noexcept;

  [[nodiscard]] std::uint8_t flags(const FalconLights& lights, bool homing) const noexcept;
};

/// Reads a calibration from JSON. samples/devices/falcon.json explains the keys; missing keys keep their defaults.
/// Throws Error(input) naming `where` and the key if a key is unknown, out of range or inconsistent with another, for
/// example if the legs do not reach the workspace.
FalconCalibration read_falcon_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
