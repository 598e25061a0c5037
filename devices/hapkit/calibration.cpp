#include "devices/hapkit/calibration.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/hapkit/hapkit_board.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Returns the lever from the handle's force to the motor's torque [m].
double motor_lever(const HapkitCalibration& kit) {
  return kit.handle_radius * kit.pulley_radius / kit.sector_radius;
}

double read_hapkit_sign(JsonReader& reader, const char* key, double fallback) {
  const double sign = reader.number(key, fallback, -1, 1);
  if (std::abs(sign) != 1) throw input_error(fmt::format("{}: {}: a sign is 1 or -1", reader.where(), key));
  return sign;
}

}  // namespace

double HapkitCalibration::position(std::int32_t counts) const noexcept {
  return handle_radius * (encoder_sign * rad_per_count * counts + angle_at_zero);
}

std::int32_t HapkitCalibration::counts(double position) const noexcept {
  const double counts = encoder_sign * (position / handle_radius - angle_at_zero) / rad_per_count;
  return static_cast<std::int32_t>(std::lround(std::clamp(counts, -1e9, 1e9)));
}

std::int16_t HapkitCalibration::duty(double force) const noexcept {
  if (!std::isfinite(force)) return 0;
  const double torque = motor_sign * force * motor_lever(*this);
  const double duty = std::min(std::sqrt(std::abs(torque) / motor_constant), max_duty);
  return static_cast<std::int16_t>(std::lround(std::copysign(duty, torque) * HAPKIT_FULL_DUTY));
}

double HapkitCalibration::force(std::int16_t duty) const noexcept {
  const double part = static_cast<double>(duty) / HAPKIT_FULL_DUTY;
  return motor_sign * part * std::abs(part) * motor_constant / motor_lever(*this);
}

double HapkitCalibration::max_force() const noexcept {
  return max_duty * max_duty * motor_constant / motor_lever(*this);
}

HapkitCalibration read_hapkit_calibration(const nlohmann::json& json, const std::string& where) {
  constexpr double kLeastRadius = 1e-4, kMostRadius = 1;  // [m]
  JsonReader reader(json, where);
  HapkitCalibration kit;
  kit.handle_radius = reader.number("handle_radius", kit.handle_radius, kLeastRadius, kMostRadius);
  kit.pulley_radius = reader.number("pulley_radius", kit.pulley_radius, kLeastRadius, kMostRadius);
  kit.sector_radius = reader.number("sector_radius", kit.sector_radius, kLeastRadius, kMostRadius);
  kit.rad_per_count = reader.number("rad_per_count", kit.rad_per_count, 1e-7, 0.1);
  kit.angle_at_zero = reader.number("angle_at_zero", kit.angle_at_zero, -std::numbers::pi, std::numbers::pi);
  kit.encoder_sign = read_hapkit_sign(reader, "encoder_sign", kit.encoder_sign);
  kit.motor_constant = reader.number("motor_constant", kit.motor_constant, 1e-5, 10);
  kit.motor_sign = read_hapkit_sign(reader, "motor_sign", kit.motor_sign);
  kit.max_duty = reader.number("max_duty", kit.max_duty, 0.01, 1);
  kit.stop_angle = reader.number("stop_angle", kit.stop_angle, 0.01, std::numbers::pi);
  kit.workspace = reader.number("workspace", kit.workspace, 1e-3, 1);
  reader.finish();
  if (kit.workspace > kit.handle_radius * kit.stop_angle)
    throw input_error(fmt::format("{}: workspace: {:g} m is beyond the stops, which are at {:g} m", where,
                                  kit.workspace, kit.handle_radius * kit.stop_angle));
  return kit;
}

}  // namespace haptrace
