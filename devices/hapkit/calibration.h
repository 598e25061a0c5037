// What differs from one Hapkit to the next, and its owner measures.
#pragma once

#include "base/types.h"

#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

namespace haptrace {

/// From counts to the handle and from force to the motor's duty, for a handle on a sector that a capstan drive turns.
/// The defaults come from public descriptions of the kit, were never tried on a device, and are explained, with how to
/// measure each, in docs/devices/hapkit.md.
///
///     theta = sign counts rad_per_count + angle_at_zero,   x = r_h theta
///     T_p = F r_h r_p / r_s,   duty = sign(T_p) sqrt(|T_p| / motor_constant)     (after the kit's own sketch)
///
/// W: x along the arc that the handle moves on, to the right of who faces it; its origin where theta is 0, with the
/// handle upright. y and z are 0.
///
/// Real-time: all members.
struct HapkitCalibration {
  double handle_radius = 0.090;  ///< r_h: from the sector's axis to the handle [m]
  double pulley_radius = 0.005;  ///< r_p: of the motor's capstan [m]
  double sector_radius = 0.074;  ///< r_s: of the sector, where the cable or the friction wheel runs [m]
  double rad_per_count = 0.0148 * std::numbers::pi / 180;  ///< of the handle
  double angle_at_zero = 0;                                ///< of the handle where counts are 0 [rad]
  double encoder_sign = 1;                                 ///< -1 where counts fall as the handle goes to the right
  double motor_constant = 0.03;                            ///< torque of the motor at full duty [N m]
  double motor_sign = 1;                                   ///< -1 where a positive duty drives the handle to the left
  double max_duty = 1;                                     ///< more is not sent
  double stop_angle = 0.8;   ///< where the handle cannot be any more, to either side [rad]
  double workspace = 0.045;  ///< from the origin to either side [m]

  /// Where the handle is along x [m].
  [[nodiscard]] double position(std::int32_t counts) const noexcept;
  /// The nearest counts there.
  [[nodiscard]] std::int32_t counts(double position) const noexcept;
  /// For the board, of 32767, for a force along x [N]; a force that is not finite is none.
  [[nodiscard]] std::int16_t duty(double force) const noexcept;
  /// The force that a duty makes [N].
  [[nodiscard]] double force(std::int16_t duty) const noexcept;
  [[nodiscard]] double max_force() const noexcept;  ///< [N]
};

/// Reads a calibration from JSON, whose keys samples/devices/hapkit.json explains; what is left out keeps its default.
/// Throws Error(input) naming `where` and the key: unknown, outside its range, or at odds with another.
HapkitCalibration read_hapkit_calibration(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
