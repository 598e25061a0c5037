#include "devices/haply/calibration.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <array>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kDegree = std::numbers::pi / 180;  // [rad]
constexpr int kMostPorts = 4;
const std::array<std::string, 3> kGenerations{"gen3", "gen2", "devkit"};
const std::array<std::string, 2> kSenses{"ccw", "cw"};

void read_arm(JsonReader& reader, const char* key, TwoDiyArm& arm) {
  auto own = reader.object(key);
  if (!own) return;
  arm.port = own->integer("port", arm.port, 1, kMostPorts);
  arm.motor_ccw = own->choice("motor", kSenses[arm.motor_ccw ? 0 : 1], kSenses) == "ccw";
  arm.encoder_ccw = own->choice("encoder", kSenses[arm.encoder_ccw ? 0 : 1], kSenses) == "ccw";
  arm.counts_per_turn = own->number("counts_per_turn", arm.counts_per_turn, 16, 1e6);
  arm.stop_angle = own->number("stop_angle", arm.stop_angle, -2 * std::numbers::pi, 2 * std::numbers::pi);
  own->finish();
}

Vec2 read_plane(JsonReader& reader, const char* key, const Vec2& fallback, double min, double max) {
  auto own = reader.object(key);
  if (!own) return fallback;
  Vec2 plane(own->number("x", fallback.x(), min, max), own->number("y", fallback.y(), min, max));
  own->finish();
  return plane;
}

PantographKinematics linkage(const PantographGeometry& geometry, const std::string& where) {
  try {
    return PantographKinematics(geometry);
  } catch (const Error& error) {
    throw input_error(fmt::format("{}: geometry: {}", where, error.what()));
  }
}

void check_plane(const TwoDiyCalibration& device, const std::string& where) {
  const PantographKinematics kinematics = linkage(device.geometry, where);
  // Checks a grid and not only the corners: the reach is round, and the stops cut into it anywhere.
  constexpr int kSteps = 10;
  for (int i = -kSteps; i <= kSteps; ++i)
    for (int j = -kSteps; j <= kSteps; ++j) {
      const Vec3 place(device.workspace.x() * i / kSteps, device.workspace.y() * j / kSteps, 0);
      const auto pose = kinematics.at_position(device.to_mechanism(place));
      if (!pose || pose->angles[0] > device.arms[0].stop_angle || pose->angles[1] < device.arms[1].stop_angle)
        throw input_error(
            fmt::format("{}: workspace: ({:g}, {:g}) m is out of the arms' reach or beyond their stops; make the "
                        "workspace smaller or move the origin",
                        where, place.x(), place.y()));
    }
}

}  // namespace

Vec2 TwoDiyCalibration::torques(const PantographPose& pose, const Vec3& force) const noexcept {
  Vec2 torques = pose.torques(force_in_mechanism(force));
  if (!torques.allFinite()) return Vec2::Zero();
  const double largest = torques.cwiseAbs().maxCoeff();
  if (largest > max_torque) torques *= max_torque / largest;
  return torques;
}

// Sources: the lengths are IMAGE-HAPI's; ports, senses, counts and stop angles are from the README of HaplyHAPI 1.0.1.
// Workspaces and their forces are computed from these.
TwoDiyCalibration two_diy_calibration(const std::string& generation, const std::string& where) {
  TwoDiyCalibration device;
  device.generation = generation;
  if (generation == "gen3") {
    device.arms = {TwoDiyArm{2, true, true, 4880, 168 * kDegree}, TwoDiyArm{1, true, true, 4880, 12 * kDegree}};
  } else if (generation == "gen2") {
    device.geometry = {0.07, 0.09, 0};
    device.arms = {TwoDiyArm{2, true, true, 10752, 241 * kDegree}, TwoDiyArm{1, false, false, 10752, -61 * kDegree}};
    device.origin = Vec2(0, 0.1);
    device.workspace = Vec2(0.05, 0.035);
    device.max_force = 1.5;
  } else if (generation == "devkit") {
    device.geometry = {0.05, 0.07, 0.02};
    device.arms = {TwoDiyArm{2, true, true, 13824, 180 * kDegree}, TwoDiyArm{1, true, true, 13824, 0}};
    device.origin = Vec2(0.01, 0.0825);
    device.workspace = Vec2(0.026, 0.018);
    device.max_force = 2.3;
  } else {
    throw input_error(
        fmt::format("{}: generation: '{}' is not one of {}", where, generation, fmt::join(kGenerations, ", ")));
  }
  return device;
}

TwoDiyCalibration read_two_diy_calibration(const nlohmann::json& json, const std::string& where,
                                           const std::string& generation) {
  JsonReader reader(json, where);
  TwoDiyCalibration device = two_diy_calibration(reader.text("generation", generation), where);
  if (auto geometry = reader.object("geometry")) {
    PantographGeometry& g = device.geometry;
    g.proximal = geometry->number("proximal", g.proximal);
    g.distal = geometry->number("distal", g.distal);
    g.separation = geometry->number("separation", g.separation);
    geometry->finish();
  }
  read_arm(reader, "arm1", device.arms[0]);
  read_arm(reader, "arm2", device.arms[1]);
  if (device.arms[0].port == device.arms[1].port)
    throw input_error(
        fmt::format("{}: arm2.port: {} is already the port of the first arm", where, device.arms[1].port));
  device.device_id = reader.integer("device_id", device.device_id, 0, 255);
  device.max_torque = reader.number("max_torque", device.max_torque, 1e-4, 10);
  device.axis_sign = read_plane(reader, "axis_sign", device.axis_sign, -1, 1);
  if (device.axis_sign.cwiseAbs() != Vec2::Ones())
    throw input_error(fmt::format("{}: axis_sign: a sign is 1 or -1", where));
  device.origin = read_plane(reader, "origin", device.origin, -1, 1);
  device.workspace = read_plane(reader, "workspace", device.workspace, 1e-3, 1);
  device.max_force = reader.number("max_force", device.max_force, 0.01, 100);
  reader.finish();
  check_plane(device, where);
  return device;
}

}  // namespace haptrace
