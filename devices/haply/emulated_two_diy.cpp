#include "devices/haply/emulated_two_diy.h"

#include "base/error.h"
#include "devices/haply/protocol.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kDegreeOfArm = std::numbers::pi / 180;  // [rad]
constexpr double kBoardTorque = 0.123;                   // MAX_TORQUE of the firmware [N m]
constexpr double kTorqueSteps = 4095;                    // steps of the M3 board's outputs
constexpr double kNominalPeriod = 1e-3;                  // time between two answers [s]
constexpr std::size_t kBoardHead = 2;                    // a command and an id

std::size_t ports_in(unsigned mask) {
  return static_cast<std::size_t>(std::popcount(mask & 0xfU));
}

float float_at(const std::vector<std::uint8_t>& bytes, std::size_t place) {
  float value = 0;
  std::memcpy(&value, &bytes[place], sizeof value);
  return value;
}

void append_float_to(std::vector<std::uint8_t>& bytes, float value) {
  std::array<std::uint8_t, sizeof value> raw{};
  std::memcpy(raw.data(), &value, raw.size());
  bytes.insert(bytes.end(), raw.begin(), raw.end());
}

}  // namespace

EmulatedTwoDiy::EmulatedTwoDiy(LivePlant plant, TwoDiyCalibration truth, bool velocities)
    : plant_(std::move(plant)), truth_(std::move(truth)), velocities_(velocities), kinematics_(truth_.geometry) {
  const DeviceInfo& info = plant_.info();
  for (int corner = 0; corner < 4; ++corner) {
    const Vec3 place((corner & 1) != 0 ? info.workspace_max.x() : info.workspace_min.x(),
                     (corner & 2) != 0 ? info.workspace_max.y() : info.workspace_min.y(), 0);
    if (!kinematics_.at_position(truth_.to_mechanism(place)))
      throw input_error(
          fmt::format("{}: its workspace contains ({:g}, {:g}) m, which the arms of the emulated 2DIY do not reach; "
                      "make the workspace smaller",
                      info.model, place.x(), place.y()));
  }
  pose_ = *kinematics_.at_position(truth_.to_mechanism(Vec3::Zero()));
}

void EmulatedTwoDiy::hold_arms(const Vec2& angles) noexcept {
  held_angles_[0] = angles[0];
  held_angles_[1] = angles[1];
  held_ = true;
}

Vec2 EmulatedTwoDiy::arm_angles() const noexcept {
  return held_ ? Vec2(held_angles_[0], held_angles_[1]) : pose_.angles;
}

void EmulatedTwoDiy::advance(std::int64_t now_ns) {
  plant_.apply(truth_.force_in_world(pose_.force(torques_)));
  plant_.advance_to(now_ns);
  // A wall of the plant yields a little when it is pressed. Beyond their reach the arms keep their position.
  if (const auto pose = kinematics_.at_position(truth_.to_mechanism(plant_.position()))) pose_ = *pose;
}

void EmulatedTwoDiy::power_cycle() {
  forget();
  message_.clear();
  torques_.setZero();
  torque_ = 0;
}

void EmulatedTwoDiy::forget() noexcept {
  motors_ = {};
  encoders_ = {};
}

/// Returns the length of the message, as far as its bytes determine it.
std::size_t EmulatedTwoDiy::message_length() const noexcept {
  const auto size = message_.size();
  if (message_[0] == static_cast<int>(TwoDiyCommand::reset)) return kBoardHead;
  if (message_[0] == static_cast<int>(TwoDiyCommand::exchange)) {
    const auto known = std::count_if(motors_.begin(), motors_.end(), [](const Wheel& motor) { return motor.known; });
    return kBoardHead + sizeof(float) * static_cast<std::size_t>(known);
  }
  // Set-up: every count precedes the items that it counts.
  std::size_t length = kBoardHead + 1;
  if (size < length) return length;
  length += ports_in(message_[length - 1]) + 1;
  if (size < length) return length;
  const std::size_t encoders = ports_in(message_[length - 1]);
  length += encoders + 1;
  if (size < length) return length;
  length += message_[length - 1] + std::size_t{1};  // analogue sensors
  if (size < length) return length;
  length += message_[length - 1];  // further outputs
  return length + 2 * sizeof(float) * encoders;
}

void EmulatedTwoDiy::receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) {
  if (message_.empty() && byte > static_cast<int>(TwoDiyCommand::exchange)) return;
  message_.push_back(byte);
  if (message_.size() < message_length()) return;
  switch (TwoDiyCommand{message_[0]}) {
    case TwoDiyCommand::reset:
      forget();
      break;
    case TwoDiyCommand::setup:
      set_up();
      break;
    case TwoDiyCommand::exchange:
      exchange(answer);
      break;
  }
  message_.clear();
}

void EmulatedTwoDiy::set_up() {
  forget();
  std::size_t place = kBoardHead;
  const auto read_wheels = [&](std::array<Wheel, 4>& wheels) {
    const unsigned mask = message_[place++];
    for (std::size_t port = 0; port < wheels.size(); ++port)
      if ((mask >> port & 1U) != 0) {
        wheels[port].known = true;
        wheels[port].ccw = message_[place++] != 0;
      }
  };
  read_wheels(motors_);
  read_wheels(encoders_);
  place = message_.size() - 2 * sizeof(float) *
                                static_cast<std::size_t>(std::count_if(encoders_.begin(), encoders_.end(),
                                                                       [](const Wheel& wheel) { return wheel.known; }));
  for (Wheel& encoder : encoders_)
    if (encoder.known) {
      encoder.offset = static_cast<double>(float_at(message_, place));
      encoder.counts_per_turn = static_cast<double>(float_at(message_, place + sizeof(float)));
      place += 2 * sizeof(float);
    }
  const Vec2 now = in_stops_ ? truth_.stops() : arm_angles();
  for (int arm = 0; arm < 2; ++arm)
    encoders_[static_cast<std::size_t>(truth_.arms[static_cast<std::size_t>(arm)].port - 1)].zero = now[arm];
  in_stops_ = false;
  ++setups_;
}

void EmulatedTwoDiy::exchange(std::vector<std::uint8_t>& answer) {
  std::size_t place = kBoardHead;
  for (std::size_t port = 0; port < motors_.size(); ++port) {
    if (!motors_[port].known) continue;
    const double asked = static_cast<double>(float_at(message_, place));
    place += sizeof(float);
    const double bounded = asked > -kBoardTorque ? std::min(asked, kBoardTorque) : -kBoardTorque;  // also NaN
    const double sent = std::round(bounded / kBoardTorque * kTorqueSteps) / kTorqueSteps * kBoardTorque;
    for (std::size_t arm = 0; arm < 2; ++arm)
      if (truth_.arms[arm].port == static_cast<int>(port) + 1)
        torques_[static_cast<int>(arm)] = motors_[port].ccw == truth_.arms[arm].motor_ccw ? sent : -sent;
  }
  torque_ = torques_.cwiseAbs().maxCoeff();

  answer.push_back(message_[1]);
  const Vec2 angles = arm_angles();
  for (std::size_t port = 0; port < encoders_.size(); ++port) {
    const Wheel& encoder = encoders_[port];
    if (!encoder.known) continue;
    double turned = 0;    // [counts]
    double velocity = 0;  // over a nominal millisecond [deg/s]
    for (std::size_t arm = 0; arm < 2; ++arm) {
      if (truth_.arms[arm].port != static_cast<int>(port) + 1) continue;
      const int i = static_cast<int>(arm);
      velocity = (angles[i] - last_angles_[i]) / kDegreeOfArm / kNominalPeriod;
      turned = (encoder.ccw == truth_.arms[arm].encoder_ccw ? 1 : -1) *
               std::round((angles[static_cast<int>(arm)] - encoder.zero) / (2 * std::numbers::pi) *
                          truth_.arms[arm].counts_per_turn);
    }
    const auto degrees = static_cast<float>(encoder.offset + 360 * turned / encoder.counts_per_turn);
    append_float_to(answer, degrees);
    if (velocities_) append_float_to(answer, static_cast<float>(velocity));
  }
  last_angles_ = angles;
}

}  // namespace haptrace
