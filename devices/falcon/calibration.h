// What nobody verified of the Novint Falcon, and a user can measure on his own.
#pragma once

#include "devices/falcon/kinematics.h"
#include "devices/falcon/protocol.h"

#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// What the logo shows.
struct FalconLights {
  bool red = false, green = false, blue = false;
};

/// What turns counts into radians, newton metres into counts, and wishes into bits. Vectors are per leg unless they
/// name a frame. The defaults come from what public sources state, were never tried on a device, and are explained,
/// with how to measure each, in docs/devices/falcon.md.
///
/// Real-time: all members.
struct FalconCalibration {
  static constexpr double kMotorTurn = 1280, kArmDiameter = 0.110, kCapstanDiameter = 0.01425;  // [counts], [m], [m]

  FalconGeometry geometry;

  Vec3 counts_per_rad =
      Vec3::Constant(kMotorTurn / (2 * std::numbers::pi) * kArmDiameter / kCapstanDiameter);  ///< of a leg's angle
  Vec3 encoder_sign = Vec3::Ones();                               ///< -1 where counts fall as a leg rises
  Vec3 home_angle = Vec3::Constant(35 * std::numbers::pi / 180);  ///< where a homed leg's encoder is at 0 [rad]

  Vec3 counts_per_n_m = Vec3::Constant(10'000);  ///< of torque that raises a leg [1/(N m)]
  Vec3 motor_sign = -Vec3::Ones();               ///< -1 where positive counts lower the leg
  int max_motor_counts = 4095;                   ///< more are not sent

  std::uint8_t homing_flag = 0x01;  ///< of FalconPacket::flags, as are the next three
  std::uint8_t red_flag = 0x08;
  std::uint8_t green_flag = 0x02;
  std::uint8_t blue_flag = 0x04;

  Vec3 origin = Vec3(0, 0, 0.12);         ///< of W in B, to which it is parallel [m]
  Vec3 workspace = Vec3::Constant(0.04);  ///< from the origin to either side, in W [m]
  double max_force = 8;                   ///< magnitude [N]

  /// Of the legs, once they are homed [rad].
  [[nodiscard]] Vec3 angles(const std::array<std::int16_t, 3>& encoders) const noexcept;

  /// Motor counts for torques that raise the legs [N m]. Torques too large for max_motor_counts are scaled down
  /// together, so that the force keeps its direction; torques that are not finite are none.
  [[nodiscard]] std::array<std::int16_t, 3> motors(const Vec3& torques) const noexcept;

  [[nodiscard]] std::uint8_t flags(const FalconLights& lights, bool homing) const noexcept;
};

/// Reads a calibration from JSON, whose keys samples/devices/falcon.json explains; what is left out keeps its default.
/// Throws Error(input) naming `where` and the key: unknown, outside its range, or at odds with another, as when the
/// legs do not reach the workspace.
FalconCalibration read_falcon_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
