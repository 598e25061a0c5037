#include "devices/hapkit/emulated_hapkit.h"

#include "devices/hapkit/hapkit_board.h"

#include <array>
#include <cmath>

namespace haptrace {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;

}  // namespace

/// The sketch's global variables.
struct EmulatedHapkit::Sketch {
  hapkit_board board{};
  hapkit_sensor sensor{};
  std::int32_t position = 0;  ///< [counts]
};

EmulatedHapkit::EmulatedHapkit(LivePlant plant, const HapkitCalibration& truth)
    : plant_(std::move(plant)), truth_(truth), sketch_(std::make_unique<Sketch>()), version_(HAPKIT_VERSION) {
  constexpr int kSteps = 100;
  for (int step = 0; step <= kSteps; ++step) read_sensor(plant_.position().x() * step / kSteps);
}

EmulatedHapkit::~EmulatedHapkit() = default;

void EmulatedHapkit::read_sensor(double position) {
  const std::int32_t turned = truth_.counts(position) + HAPKIT_SENSOR_MIDDLE;
  const std::int32_t reading = ((turned % HAPKIT_SENSOR_PERIOD) + HAPKIT_SENSOR_PERIOD) % HAPKIT_SENSOR_PERIOD;
  sketch_->position = hapkit_position(&sketch_->sensor, static_cast<std::int16_t>(reading));
}

void EmulatedHapkit::advance(std::int64_t now_ns) {
  now_ns_ = now_ns;
  const std::int16_t duty = hapkit_duty(&sketch_->board, static_cast<std::uint32_t>(now_ns / kNsPerMs));
  force_ = truth_.force(duty);
  plant_.apply(Vec3(force_, 0, 0));
  plant_.advance_to(now_ns);
  read_sensor(plant_.position().x());
}

void EmulatedHapkit::receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) {
  std::array<std::uint8_t, HAPKIT_PACKET_SIZE> bytes{};
  if (hapkit_receive(&sketch_->board, byte, static_cast<std::uint32_t>(now_ns_ / kNsPerMs), sketch_->position,
                     bytes.data()) == 0)
    return;
  force_ = truth_.force(sketch_->board.duty);
  if (version_ != HAPKIT_VERSION) {  // another sketch would report its version itself
    hapkit_decoder decoder{};
    hapkit_packet packet{};
    for (const std::uint8_t sent : bytes) (void)hapkit_decode(&decoder, sent, &packet);
    packet.version = static_cast<std::uint8_t>(version_);
    hapkit_encode(&packet, bytes.data());
  }
  answer.insert(answer.end(), bytes.begin(), bytes.end());
}

void EmulatedHapkit::power_cycle() {
  *sketch_ = Sketch{};
  force_ = 0;
}

}  // namespace haptrace
