#include "devices/haply/two_diy.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/haply/emulated_two_diy.h"
#include "devices/loop/clock.h"
#include "devices/serial/serial_ports.h"
#include "devices/sim/live_plant.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr int kTwoDiyBaud = 115200;      // no effect on USB
constexpr double kAnswerWithin = 0.005;  // [s]
constexpr double kCalmWithin = 0.01;     // doubles after every silence, because a late board is not lost [s]
constexpr int kMostDoublings = 2;
constexpr double kCalmQuiet = 0.002;  // silence after which no more bytes are expected [s]
constexpr double kFastestArm = 60;    // a hand at 4 m/s [rad/s]
constexpr double kArmSlack = 0.02;    // [rad]
constexpr int kMostNonsense = 3;
constexpr int kMostReads = 16;      // limit for reading unsolicited bytes
constexpr double kFarewell = 0.02;  // [s]

DeviceInfo describe_two_diy(const TwoDiyCalibration& calibration, const PantographKinematics& kinematics,
                            const TwoDiyOptions& options) {
  DeviceInfo info;
  info.name = options.name;
  info.backend = "haply2diy";
  info.model = "Haply 2DIY " + calibration.generation;
  info.serial = options.serial;
  info.force_axes = {true, true, false};
  info.workspace_max = {calibration.workspace.x(), calibration.workspace.y(), 0.005};  // flat paths move a little in z
  info.workspace_min = -info.workspace_max;
  if (const auto middle = kinematics.at_position(calibration.to_mechanism(Vec3::Zero())))
    for (int arm = 0; arm < 2; ++arm)
      info.position_resolution =
          std::max(info.position_resolution, middle->jacobian.col(arm).norm() * 2 * std::numbers::pi /
                                                 calibration.arms[static_cast<std::size_t>(arm)].counts_per_turn);
  info.max_force = calibration.max_force;
  info.nominal_rate = 1000;
  if (!options.homed)
    info.notes.emplace_back(
        "to make it ready, swing both arms inward, press them outward into their stops, and hold them there for half a "
        "second");
  return info;
}

}  // namespace

TwoDiyDriver::TwoDiyDriver(const TwoDiyCalibration& calibration, const TwoDiyOptions& options,
                           std::shared_ptr<void> company)
    : company_(std::move(company)),
      calibration_(calibration),
      kinematics_(calibration.geometry),
      info_(describe_two_diy(calibration, kinematics_, options)),
      port_(options.port, kTwoDiyBaud),
      homing_(calibration.stops()) {
  guardian_.emplace(GuardedPort{.descriptor = port_.descriptor()},
                    LastWords{two_diy_calm(calibration_), two_diy_restart(calibration_)});
  restart();
  if (options.homed) homing_.trust();
}

/// Sets the board up again, after which its encoders count from the position of the arms.
void TwoDiyDriver::restart() {
  homing_.restart();
  counted_.reset();
  pose_.reset();
  nonsense_ = 0;
  answer_bytes_ = 0;
  in_doubt_ = true;
  if (!port_.write(two_diy_restart(calibration_), kCalmWithin)) return;  // the next round calms the board and checks it
  std::array<std::uint8_t, 256> ignored{};
  for (int reads = 0; reads < kMostReads && port_.read(ignored, kCalmWithin) > 0; ++reads) {
  }
}

/// Exchanges torques for angles. Returns nothing if the answer is late or invalid.
std::optional<Vec2> TwoDiyDriver::ask(const Vec2& torques) {
  std::array<std::uint8_t, 256> late{};
  if (answer_bytes_ == 0) return std::nullopt;
  // Late answers, and answers to the guardian's bytes, are complete: any other length is an error.
  if (port_.read(late, 0) % answer_bytes_ != 0) return std::nullopt;
  if (!port_.write(two_diy_exchange(calibration_, torques), kAnswerWithin)) return std::nullopt;
  std::array<std::uint8_t, kTwoDiyVelocities> bytes{};
  const std::span answer = std::span(bytes).first(answer_bytes_);
  std::size_t count = 0;
  while (count < answer.size()) {
    const std::size_t more = port_.read(answer.subspan(count), kAnswerWithin);
    if (more == 0) return std::nullopt;
    count += more;
  }
  return two_diy_angles(calibration_, answer);
}

/// Sends zero torques in bytes that resynchronise the board. Returns the newest answer if all answers are complete.
std::optional<Vec2> TwoDiyDriver::calm() {
  port_.discard_input();
  if (!port_.write(two_diy_calm(calibration_), kCalmWithin)) return std::nullopt;
  std::array<std::uint8_t, 8 * kTwoDiyVelocities> answers{};
  std::size_t count = 0;
  while (count < answers.size()) {
    const double patience = count == 0 ? kCalmWithin * (1 << std::min(silences_, kMostDoublings)) : kCalmQuiet;
    const std::size_t more = port_.read(std::span(answers).subspan(count), patience);
    if (more == 0) break;
    count += more;
  }
  silences_ = count == 0 ? silences_ + 1 : 0;
  if (count == 0) return std::nullopt;  // a silent board may be late and keeps its encoders: not implausible
  std::optional<Vec2> newest = newest_of(std::span(answers).first(count));
  if (!newest) ++nonsense_;
  return newest;
}

std::optional<Vec2> TwoDiyDriver::newest_of(std::span<const std::uint8_t> answers) {
  // The board was asked once after the input was discarded, so a single answer shows its firmware's format.
  if (answer_bytes_ == 0 && two_diy_angles(calibration_, answers)) answer_bytes_ = answers.size();
  if (answer_bytes_ == 0) return std::nullopt;
  std::optional<Vec2> newest;
  for (std::size_t place = 0; place < answers.size(); place += answer_bytes_) {
    newest = two_diy_angles(calibration_, answers.subspan(place, std::min(answer_bytes_, answers.size() - place)));
    if (!newest) break;
  }
  return newest;
}

bool TwoDiyDriver::is_plausible(const Vec2& counted, std::int64_t now_ns) const noexcept {
  if (!counted_) return true;
  const double farthest = kArmSlack + kFastestArm * 1e-9 * static_cast<double>(now_ns - counted_ns_);
  return (counted - *counted_).cwiseAbs().maxCoeff() < farthest;
}

bool TwoDiyDriver::round(const Wrench& wrench, DeviceState& state) {
  guardian_->beat();
  const bool doubted = in_doubt_;
  const Vec2 torques = pose_ ? calibration_.torques(*pose_, wrench.force) : Vec2::Zero();
  const auto counted = doubted ? calm() : ask(torques);
  const std::int64_t now_ns = monotonic_ns();
  const bool plausible = counted && is_plausible(*counted, now_ns);
  if (counted && !plausible && doubted) ++nonsense_;
  in_doubt_ = !plausible;
  if (nonsense_ >= kMostNonsense) restart();
  if (!plausible) return false;
  nonsense_ = 0;
  believe(*counted, now_ns);
  state = DeviceState{};
  state.position = position_;
  state.ready = pose_.has_value();
  return true;
}

void TwoDiyDriver::believe(const Vec2& counted, std::int64_t now_ns) {
  counted_ = counted;
  counted_ns_ = now_ns;
  homing_.update(counted, now_ns);
  if (!homing_.is_homed()) return;
  if (const double beyond = homing_.beyond(counted); beyond > 0)
    throw device_error(
        fmt::format("an arm is {:.0f} degrees beyond its stop, so it was not at its stop during homing: open the "
                    "device again, swing both arms inward and press them into their stops",
                    beyond * 180 / std::numbers::pi));
  pose_ = kinematics_.at_angles(homing_.angles(counted));
  if (pose_) position_ = calibration_.to_world(pose_->position);
}

ZeroForce TwoDiyDriver::release() noexcept {
  if (released_) return *released_;
  released_ = ZeroForce::failed;
  try {
    for (int attempts = 0; attempts < 3 && released_ != ZeroForce::confirmed; ++attempts)
      if (calm()) released_ = ZeroForce::confirmed;
    if (released_ != ZeroForce::confirmed) (void)port_.write(two_diy_restart(calibration_), kFarewell);
  } catch (const std::exception&) {
    // The port is gone.
  }
  if (released_ == ZeroForce::confirmed)
    guardian_->dismiss();
  else
    (void)guardian_->speak_and_go();
  port_.close();
  return *released_;
}

ZeroForce TwoDiyDriver::emergency_stop() noexcept {
  return guardian_->speak() ? ZeroForce::sent : ZeroForce::failed;
}

namespace {

bool is_two_diy(const UsbSerialPort& port) {
  return port.vendor == "2341" && port.product == "003e";  // the native port of an Arduino Due
}

std::vector<FoundDevice> find_two_diys() {
  return found_on_serial_ports("haply2diy", "Haply 2DIY", is_two_diy);
}

TwoDiyCalibration calibration_of(const DeviceSpec& device) {
  const std::string where = device.where(), generation = device.option("generation", "gen3");
  const std::string file = device.option("calibration");
  if (file.empty()) return two_diy_calibration(generation, where);
  return read_two_diy_calibration(load_json(file), file, generation);
}

std::unique_ptr<Device> open_two_diy(const DeviceSpec& device) {
  const TwoDiyCalibration calibration = calibration_of(device);
  TwoDiyOptions options{.name = device.text, .port = "", .serial = "", .homed = device.flag("homed")};
  if (!is_emulated(device)) {
    const ChosenPort port = chosen_port(device, find_two_diys());
    options.port = port.path;
    options.serial = port.serial;
    return std::make_unique<ThreadedDevice>(std::make_unique<TwoDiyDriver>(calibration, options));
  }
  refuse_port_of_emulated(device);
  LivePlant plant = open_live_plant(device, "haply2diy");
  options.serial = "emulated-" + plant.info().serial;
  options.homed = true;
  auto line = std::make_shared<EmulatedLine>(std::make_unique<EmulatedTwoDiy>(std::move(plant), calibration));
  options.port = line->path();
  return std::make_unique<ThreadedDevice>(std::make_unique<TwoDiyDriver>(calibration, options, line));
}

}  // namespace

DeviceBackend two_diy_backend() {
  DeviceBackend backend{
      .name = "haply2diy",
      .summary = "a Haply 2DIY or development kit, on a serial port",
      .options = {{"port", "serial port of the device (default: the only suitable one)"},
                  {"generation", "generation of the device: gen3 (default), gen2 or devkit"},
                  {"calibration", "JSON file with the calibration of this device"},
                  {"homed", "true: both arms are in their stops now, so the device is ready at once"}},
      .presets = {},
      .open = open_two_diy,
      .find = find_two_diys,
      .opens_still = true};
  for (auto& option : emulated_options()) backend.options.push_back(std::move(option));
  return backend;
}

}  // namespace haptrace
