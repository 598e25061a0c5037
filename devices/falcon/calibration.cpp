#include "devices/falcon/calibration.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <bit>
#include <fmt/format.h>

namespace haptrace {
namespace {

FalconGeometry read_geometry(JsonReader reader, const FalconGeometry& fallback) {
  FalconGeometry g;
  g.thigh = reader.number("thigh", fallback.thigh);
  g.shin = reader.number("shin", fallback.shin);
  g.shin_offset = reader.number("shin_offset", fallback.shin_offset);
  g.handle_radius = reader.number("handle_radius", fallback.handle_radius);
  g.handle_offset = reader.number("handle_offset", fallback.handle_offset);
  g.base_radius = reader.number("base_radius", fallback.base_radius);
  g.base_offset = reader.number("base_offset", fallback.base_offset);
  g.azimuths = reader.vector("azimuths", fallback.azimuths);
  reader.finish();
  return g;
}

FalconKinematics mechanism(const FalconGeometry& geometry, const std::string& where) {
  try {
    return FalconKinematics(geometry);
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: geometry: {}", where, error.what()));
  }
}

Vec3 read_signs(JsonReader& reader, const char* key, const Vec3& fallback) {
  Vec3 signs = reader.vector(key, fallback, -1, 1);
  if (signs.cwiseAbs() != Vec3::Ones())
    throw input_error(fmt::format("{}: {}: a sign is 1 or -1", reader.where(), key));
  return signs;
}

/// Reads a flag of a single bit that is not in `taken`, and adds the bit to `taken`.
std::uint8_t read_flag(JsonReader& reader, const char* key, std::uint8_t fallback, unsigned& taken) {
  const auto flag = static_cast<unsigned>(reader.integer(key, fallback, 1, FalconPacket::kAllFlags));
  if (!std::has_single_bit(flag))
    throw input_error(fmt::format("{}: {}: {} is not one bit: 1, 2, 4, 8, 16, 32 or 64", reader.where(), key, flag));
  if ((taken & flag) != 0)
    throw input_error(fmt::format("{}: {}: {} is already the bit of another flag", reader.where(), key, flag));
  taken |= flag;
  return static_cast<std::uint8_t>(flag);
}

void check_reach(const FalconCalibration& falcon, const std::string& where) {
  const FalconKinematics kinematics = mechanism(falcon.geometry, where);
  if (!kinematics.at_angles(falcon.home_angle))
    throw input_error(fmt::format("{}: home_angle: the legs of this geometry cannot reach these angles", where));
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 side((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1, (corner & 4) != 0 ? 1 : -1);
    const Vec3 place = falcon.workspace.cwiseProduct(side);
    if (!kinematics.at_position(falcon.origin + place))
      throw input_error(
          fmt::format("{}: workspace: its corner ({:g}, {:g}, {:g}) is out of the legs' reach; make the workspace "
                      "smaller or move the origin",
                      where, place.x(), place.y(), place.z()));
  }
}

}  // namespace

Vec3 FalconCalibration::angles(const std::array<std::int16_t, 3>& encoders) const noexcept {
  const Vec3 counts(encoders[0], encoders[1], encoders[2]);
  return home_angle + encoder_sign.cwiseProduct(counts).cwiseQuotient(counts_per_rad);
}

std::array<std::int16_t, 3> FalconCalibration::motors(const Vec3& torques) const noexcept {
  if (!is_finite(torques)) return {};
  Vec3 counts = motor_sign.cwiseProduct(counts_per_n_m).cwiseProduct(torques);
  const double largest = counts.cwiseAbs().maxCoeff();
  if (largest > max_motor_counts) counts *= max_motor_counts / largest;
  return {falcon_word(counts[0]), falcon_word(counts[1]), falcon_word(counts[2])};
}

std::uint8_t FalconCalibration::flags(const FalconLights& lights, bool homing) const noexcept {
  const int flags = (lights.red ? red_flag : 0) | (lights.green ? green_flag : 0) | (lights.blue ? blue_flag : 0) |
                    (homing ? homing_flag : 0);
  return static_cast<std::uint8_t>(flags);
}

FalconCalibration read_falcon_calibration(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  FalconCalibration falcon;
  if (auto geometry = reader.object("geometry")) falcon.geometry = read_geometry(*geometry, falcon.geometry);

  falcon.counts_per_rad = reader.vector("counts_per_rad", falcon.counts_per_rad, 10, 1e5);
  falcon.encoder_sign = read_signs(reader, "encoder_sign", falcon.encoder_sign);
  falcon.home_angle = reader.vector("home_angle", falcon.home_angle, -std::numbers::pi, std::numbers::pi);

  falcon.counts_per_n_m = reader.vector("counts_per_n_m", falcon.counts_per_n_m, 1, 1e6);
  falcon.motor_sign = read_signs(reader, "motor_sign", falcon.motor_sign);
  falcon.max_motor_counts = reader.integer("max_motor_counts", falcon.max_motor_counts, 1, 32767);

  if (auto flags = reader.object("flags")) {
    unsigned taken = 0;
    falcon.homing_flag = read_flag(*flags, "homing", falcon.homing_flag, taken);
    falcon.red_flag = read_flag(*flags, "red", falcon.red_flag, taken);
    falcon.green_flag = read_flag(*flags, "green", falcon.green_flag, taken);
    falcon.blue_flag = read_flag(*flags, "blue", falcon.blue_flag, taken);
    flags->finish();
  }

  falcon.origin = reader.vector("origin", falcon.origin, -1, 1);
  falcon.workspace = reader.vector("workspace", falcon.workspace, 1e-3, 1);
  falcon.max_force = reader.number("max_force", falcon.max_force, 0.01, 100);
  reader.finish();
  check_reach(falcon, where);
  return falcon;
}

}  // namespace haptrace
