#include "devices/haply/protocol.h"

#include <bit>
#include <cmath>
#include <cstring>

namespace haptrace {
namespace {

static_assert(std::endian::native == std::endian::little, "floats of the protocol are little-endian");

constexpr std::uint8_t kNoCommand = 5;
constexpr std::size_t kLongestSetup = 64;  // longest set-up that a torn message can leave unfinished [bytes]
constexpr double kMostDegrees = 1e4;
constexpr double kMostDegreesPerSecond = 1e6;
constexpr double kDegreeAngle = std::numbers::pi / 180;  // [rad]

/// Returns the arms in the order of their ports.
std::array<std::size_t, 2> by_port(const TwoDiyCalibration& device) {
  if (device.arms[0].port < device.arms[1].port) return {0, 1};
  return {1, 0};
}

void append_float(std::vector<std::uint8_t>& bytes, double value) {
  const auto number = static_cast<float>(value);
  std::array<std::uint8_t, sizeof(float)> raw{};
  std::memcpy(raw.data(), &number, raw.size());
  bytes.insert(bytes.end(), raw.begin(), raw.end());
}

template <class Bytes>
void append(std::vector<std::uint8_t>& bytes, const Bytes& more) {
  bytes.insert(bytes.end(), more.begin(), more.end());
}

}  // namespace

TwoDiyTorques two_diy_exchange(const TwoDiyCalibration& device, const Vec2& torques) noexcept {
  TwoDiyTorques bytes{static_cast<std::uint8_t>(TwoDiyCommand::exchange), static_cast<std::uint8_t>(device.device_id)};
  std::size_t place = 2;
  for (const std::size_t arm : by_port(device)) {
    const double torque = torques[static_cast<int>(arm)];
    const float number = std::isfinite(torque) ? static_cast<float>(torque) : 0.0F;
    std::memcpy(&bytes[place], &number, sizeof number);
    place += sizeof number;
  }
  return bytes;
}

std::optional<Vec2> two_diy_angles(const TwoDiyCalibration& device, std::span<const std::uint8_t> answer) noexcept {
  const bool has_velocities = answer.size() == kTwoDiyVelocities;
  if ((answer.size() != kTwoDiyAngles && !has_velocities) || answer[0] != device.device_id) return std::nullopt;
  Vec2 angles;
  std::size_t place = 1;
  for (const std::size_t arm : by_port(device)) {
    float degrees = 0;
    std::memcpy(&degrees, &answer[place], sizeof degrees);
    if (!(std::abs(degrees) < kMostDegrees)) return std::nullopt;
    angles[static_cast<int>(arm)] = kDegreeAngle * static_cast<double>(degrees);
    place += sizeof degrees;
    if (!has_velocities) continue;
    float velocity = 0;  // [deg/s]
    std::memcpy(&velocity, &answer[place], sizeof velocity);
    if (!(std::abs(velocity) < kMostDegreesPerSecond)) return std::nullopt;
    place += sizeof velocity;
  }
  return angles;
}

std::vector<std::uint8_t> two_diy_setup(const TwoDiyCalibration& device) {
  std::vector<std::uint8_t> bytes{static_cast<std::uint8_t>(TwoDiyCommand::setup),
                                  static_cast<std::uint8_t>(device.device_id)};
  const auto order = by_port(device);
  const auto append_ports = [&](bool TwoDiyArm::*ccw) {
    unsigned ports = 0;
    for (const TwoDiyArm& arm : device.arms) ports |= 1U << static_cast<unsigned>(arm.port - 1);
    bytes.push_back(static_cast<std::uint8_t>(ports));
    for (const std::size_t arm : order) bytes.push_back(device.arms[arm].*ccw ? 1 : 0);
  };
  append_ports(&TwoDiyArm::motor_ccw);
  append_ports(&TwoDiyArm::encoder_ccw);
  append(bytes, std::array<std::uint8_t, 2>{0, 0});  // no analogue sensors, no further outputs
  for (const std::size_t arm : order) {
    append_float(bytes, device.arms[arm].stop_angle / kDegreeAngle);
    append_float(bytes, device.arms[arm].counts_per_turn);
  }
  return bytes;
}

std::vector<std::uint8_t> two_diy_calm(const TwoDiyCalibration& device) {
  std::vector<std::uint8_t> bytes(std::tuple_size_v<TwoDiyTorques>, kNoCommand);
  append(bytes, two_diy_exchange(device, Vec2::Zero()));
  return bytes;
}

std::vector<std::uint8_t> two_diy_restart(const TwoDiyCalibration& device) {
  std::vector<std::uint8_t> bytes = two_diy_calm(device);
  bytes.resize(bytes.size() + kLongestSetup, 0);
  const std::array<std::uint8_t, 2> reset{static_cast<std::uint8_t>(TwoDiyCommand::reset),
                                          static_cast<std::uint8_t>(device.device_id)};
  append(bytes, reset);
  append(bytes, reset);
  append(bytes, two_diy_setup(device));
  append(bytes, two_diy_exchange(device, Vec2::Zero()));
  return bytes;
}

}  // namespace haptrace
