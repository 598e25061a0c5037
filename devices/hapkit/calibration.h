// Calibration of a Hapkit: parameters that differ between devices and that the owner measures.
#pragma once

#include "base/types.h"

#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

namespace haptrace {

/// Conversion of counts to the handle position and of force to the motor's duty, for a handle on a sector with a
/// capstan drive. The defaults come from public descriptions of the kit and were never tried on a device;
/// docs/devices/hapkit.md explains them and how to measure each.
///
///     theta = sign counts rad_per_count + angle_at_zero,   x = r_h theta
///     T_p = F r_h r_p / r_s,   duty = sign(T_p) sqrt(|T_p| / motor_constant)     (after the kit's own sketch)
///
/// Frame W: x along the handle's arc, to the right of the user who faces it; its origin is where theta is 0, with the
/// handle upright. y and z are 0.
///
/// Real-time: all members.
struct HapkitCalibration {
  double handle_radius = 0.090;  ///< r_h: from the sector's axis to the handle [m]
  double pulley_radius = 0.005;  ///< r_p: radius of the motor's capstan [m]
  double sector_radius = 0.074;  ///< r_s: radius of the sector at the cable or the friction wheel [m]
  double rad_per_count = 0.0148 * std::numbers::pi / 180;  ///< angle of the handle per count [rad]
  double angle_at_zero = 0;                                ///< angle of the handle at count 0 [rad]
  double encoder_sign = 1;                                 ///< -1 if the counts fall as the handle moves right
  double motor_constant = 0.03;                            ///< torque of the motor at full duty [N m]
  double motor_sign = 1;                                   ///< -1 if a positive duty drives the handle left
  double max_duty = 1;                                     ///< largest duty that is sent, relative to full duty
  double stop_angle = 0.8;   ///< largest possible angle of the handle, to either side [rad]
  double workspace = 0.045;  ///< half extent around the origin [m]

  /// Returns the handle position along x [m].
  [[nodiscard]] double position(std::int32_t counts) const noexcept;
  /// Returns the counts nearest to a position along x [m].
  [[nodiscard]] std::int32_t counts(double position) const noexcept;
  /// Returns the duty for the board, relative to 32767, for a force along x [N]; 0 for a force that is not finite.
  [[nodiscard]] std::int16_t duty(double force) const noexcept;
  /// Returns the force that a duty produces [N].
  [[nodiscard]] double force(std::int16_t duty) const noexcept;
  [[nodiscard]] double max_force() const noexcept;  ///< [N]
};

/// Reads a calibration from JSON. samples/devices/hapkit.json explains the keys; missing keys keep their defaults.
/// Throws Error(input) naming `where` and the key if a key is unknown, out of range or inconsistent with another.
HapkitCalibration read_hapkit_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
