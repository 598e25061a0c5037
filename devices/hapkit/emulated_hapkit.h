// Emulation of a Hapkit-class board with its sketch.
#pragma once

#include "devices/hapkit/calibration.h"
#include "devices/serial/emulated_line.h"
#include "devices/sim/live_plant.h"

#include <atomic>
#include <memory>

namespace haptrace {

/// Runs the sketch's own code, devices/hapkit/hapkit_board.h, between a plant and a line: sensor, packets, watchdog.
/// The board was switched on with the handle upright, and the handle was then moved to the plant's position.
///
/// Threads: force() may be called from any thread.
class EmulatedHapkit final : public EmulatedBoard {
 public:
  EmulatedHapkit(LivePlant plant, const HapkitCalibration& truth);
  ~EmulatedHapkit() override;

  void advance(std::int64_t now_ns) override;
  void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) override;
  void power_cycle() override;

  /// Returns the motor's force at the handle, along x [N].
  [[nodiscard]] double force() const noexcept { return force_; }
  /// Makes the board report another version of the protocol.
  void speak_version(int version) noexcept { version_ = version; }

 private:
  struct Sketch;

  void read_sensor(double position);

  LivePlant plant_;
  HapkitCalibration truth_;
  std::unique_ptr<Sketch> sketch_;
  std::int64_t now_ns_ = 0;
  std::atomic<double> force_{0};
  std::atomic<int> version_;
};

}  // namespace haptrace
