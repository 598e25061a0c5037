#include "devices/hapkit/hapkit.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "devices/hapkit/emulated_hapkit.h"
#include "devices/hapkit/hapkit_board.h"
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

constexpr double kGreetingPeriod = 0.1;  // [s]
constexpr double kStateWithin = 0.005;   // doubles after every silence, so that a late board is not lost [s]
constexpr int kMostPatienceDoublings = 3;
constexpr double kGoodbyeWithin = 0.02;  // [s]

DeviceInfo describe_hapkit(const HapkitCalibration& kit, const HapkitOptions& options) {
  DeviceInfo info;
  info.name = options.name;
  info.backend = "hapkit";
  info.model = "Hapkit";
  info.serial = options.serial;
  info.force_axes = {true, false, false};
  info.workspace_max = {kit.workspace, 0.005, 0.005};  // flat paths move a little in y and z
  info.workspace_min = -info.workspace_max;
  info.position_resolution = kit.handle_radius * kit.rad_per_count;
  info.max_force = kit.max_force();
  info.nominal_rate = 1000;
  info.notes.emplace_back("its handle must be upright while the device is opened: its encoder counts from there");
  return info;
}

}  // namespace

/// Exchange of packets over the port.
struct HapkitDriver::Line {
  explicit Line(SerialPort& serial) : port(serial) {}

  /// Sends a packet and waits for the answer with its sequence number; skips everything else.
  std::optional<hapkit_packet> ask(hapkit_kind kind, std::int16_t duty, double timeout) {
    hapkit_packet packet{};
    packet.kind = static_cast<std::uint8_t>(kind);
    packet.version = HAPKIT_VERSION;
    packet.sequence = ++sequence;
    packet.duty = duty;
    std::array<std::uint8_t, HAPKIT_PACKET_SIZE> bytes{};
    hapkit_encode(&packet, bytes.data());
    if (!port.write(bytes, timeout)) return std::nullopt;

    const std::int64_t end = monotonic_ns() + std::llround(1e9 * timeout);
    for (std::int64_t left = end - monotonic_ns(); left > 0; left = end - monotonic_ns()) {
      std::array<std::uint8_t, 256> heard{};
      const std::size_t count = port.read(heard, 1e-9 * static_cast<double>(left));
      std::optional<hapkit_packet> answer;
      for (std::size_t i = 0; i < count; ++i)
        if (hapkit_decode(&decoder, heard[i], &packet) != 0 && packet.sequence == sequence && packet.kind == kind + 1)
          answer = packet;
      if (answer) return answer;
    }
    return std::nullopt;
  }

  SerialPort& port;
  hapkit_decoder decoder{};
  std::uint16_t sequence = 0;
};

HapkitDriver::HapkitDriver(const HapkitCalibration& calibration, const HapkitOptions& options,
                           std::shared_ptr<void> company)
    : company_(std::move(company)),
      calibration_(calibration),
      info_(describe_hapkit(calibration, options)),
      port_(options.port, HAPKIT_BAUD),
      line_(std::make_unique<Line>(port_)) {
  greet(options.greeting_patience);
}

HapkitDriver::~HapkitDriver() {
  (void)release();
}

void HapkitDriver::greet(double patience) {
  const std::int64_t begin = monotonic_ns();
  while (true) {
    if (const auto welcome = line_->ask(HAPKIT_HELLO, 0, kGreetingPeriod)) {
      if (welcome->version == HAPKIT_VERSION) return;
      throw device_error(
          fmt::format("{}: its sketch uses version {} of the protocol, but this program uses version {}. Flash the "
                      "sketch that belongs to this program (samples/hapkit/hapkit.ino)",
                      port_.path(), welcome->version, HAPKIT_VERSION));
    }
    if (1e-9 * static_cast<double>(monotonic_ns() - begin) > patience)
      throw device_error(
          fmt::format("{}: no board answers there with the protocol of samples/hapkit/hapkit.ino. Flash that sketch, "
                      "or name another port with port=; {}",
                      port_.path(), describe(usb_serial_ports())));
  }
}

bool HapkitDriver::round(const Wrench& wrench, DeviceState& state) {
  const double patience = kStateWithin * (1 << std::min(silences_, kMostPatienceDoublings));
  const auto answer = line_->ask(HAPKIT_COMMAND, calibration_.duty(wrench.force.x()), patience);
  silences_ = answer ? 0 : silences_ + 1;
  if (!answer) return false;
  if ((answer->flags & HAPKIT_GREETED) == 0)
    throw device_error(
        "its board restarted (a reset, or the motor's current was too large for the supply) and does not know the "
        "position of its handle. Put the handle upright and open the device again");
  const double position = calibration_.position(answer->position);
  if (std::abs(position) > calibration_.handle_radius * calibration_.stop_angle)
    throw device_error(fmt::format(
        "its handle is {:.0f} mm from the middle, beyond its stop: it was not upright when the device was opened, or "
        "the calibration belongs to another device. Put the handle upright and open the device again",
        1e3 * std::abs(position)));
  state = DeviceState{};
  state.position = Vec3(position, 0, 0);
  return true;
}

ZeroForce HapkitDriver::release() noexcept {
  if (released_) return *released_;
  released_ = ZeroForce::failed;
  try {
    for (int attempts = 0; attempts < 3 && released_ != ZeroForce::confirmed; ++attempts)
      if (line_->ask(HAPKIT_COMMAND, 0, kGoodbyeWithin)) released_ = ZeroForce::confirmed;
  } catch (const std::exception&) {
    // The sketch's watchdog stops the motor, but nothing confirms it.
  }
  port_.close();
  return *released_;
}

namespace {

/// Returns whether the port may belong to a board like the Arduino Uno, by the USB chips of such boards and their
/// clones.
bool may_be_hapkit(const UsbSerialPort& port) {
  constexpr std::array<std::array<const char*, 2>, 6> kKinds{{{"2341", "0043"},    // Arduino Uno R3
                                                              {"2341", "0001"},    // Arduino Uno
                                                              {"2a03", "0043"},    // Arduino Uno of arduino.org
                                                              {"0403", "6001"},    // FTDI FT232
                                                              {"1a86", "7523"},    // CH340
                                                              {"10c4", "ea60"}}};  // CP2102
  for (const auto& [vendor, product] : kKinds)
    if (port.vendor == vendor && port.product == product) return true;
  return false;
}

std::vector<FoundDevice> find_hapkits() {
  return found_on_serial_ports("hapkit", "perhaps a Hapkit", may_be_hapkit);
}

std::unique_ptr<Device> open_hapkit(const DeviceSpec& device) {
  const std::string file = device.option("calibration");
  const HapkitCalibration calibration =
      file.empty() ? HapkitCalibration{} : read_hapkit_calibration(load_json(file), file);
  HapkitOptions options{.name = device.text, .port = "", .serial = ""};
  if (!is_emulated(device)) {
    const ChosenPort port = chosen_port(device, find_hapkits());
    options.port = port.path;
    options.serial = port.serial;
    return std::make_unique<ThreadedDevice>(std::make_unique<HapkitDriver>(calibration, options));
  }
  refuse_port_of_emulated(device);
  LivePlant plant = open_live_plant(device, "hapkit");
  options.serial = "emulated-" + plant.info().serial;
  auto line = std::make_shared<EmulatedLine>(std::make_unique<EmulatedHapkit>(std::move(plant), calibration));
  options.port = line->path();
  return std::make_unique<ThreadedDevice>(std::make_unique<HapkitDriver>(calibration, options, line));
}

}  // namespace

DeviceBackend hapkit_backend() {
  DeviceBackend backend{.name = "hapkit",
                        .summary = "a Hapkit-class device of one axis with our open sketch, on a serial port",
                        .options = {{"port", "serial port of the device (default: the only suitable one)"},
                                    {"calibration", "JSON file with the calibration of this device"}},
                        .presets = {},
                        .open = open_hapkit,
                        .find = find_hapkits,
                        .opens_still = true};
  for (auto& option : emulated_options()) backend.options.push_back(std::move(option));
  return backend;
}

}  // namespace haptrace
