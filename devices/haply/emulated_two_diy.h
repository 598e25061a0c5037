// Emulation of the board and the arms of a Haply 2DIY.
#pragma once

#include "devices/haply/calibration.h"
#include "devices/serial/emulated_line.h"
#include "devices/sim/live_plant.h"

#include <array>
#include <atomic>

namespace haptrace {

/// Interprets bytes as the hAPI firmware is known to: it waits for the rest of a message for ever, ignores bytes that
/// are no command, keeps its last torques whatever happens, and has no watchdog. Where sources say nothing, it does the
/// worst: a reset forgets the motors and leaves them pulling.
///
/// At the first set-up the arms are in their stops; the handle then moves to the plant's position before the first
/// answer. At a later set-up the arms may be anywhere, and their encoders count from there.
///
/// Threads: torque() and setups() may be called from any thread.
class EmulatedTwoDiy final : public EmulatedBoard {
 public:
  /// Emulates a device built and wired like `truth`. If `velocities`, its answers also hold the velocity of every
  /// encoder. Throws Error(input) if the arms do not reach the plant's workspace.
  EmulatedTwoDiy(LivePlant plant, TwoDiyCalibration truth, bool velocities = false);

  void advance(std::int64_t now_ns) override;
  void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) override;
  void power_cycle() override;

  /// Returns the larger of the two motors' torques [N m].
  [[nodiscard]] double torque() const noexcept { return torque_; }
  [[nodiscard]] int setups() const noexcept { return setups_; }
  /// Holds the arms at `angles` [rad] by hand, wherever the plant is, until let_arms_go().
  void hold_arms(const Vec2& angles) noexcept;
  void let_arms_go() noexcept { held_ = false; }

 private:
  struct Wheel {  ///< state of a port on the board
    bool known = false, ccw = true;
    double offset = 0, counts_per_turn = 1;  ///< [deg], [counts]
    double zero = 0;                         ///< angle of the arm at the offset [rad]
  };

  [[nodiscard]] std::size_t message_length() const noexcept;
  void set_up();
  void exchange(std::vector<std::uint8_t>& answer);
  void forget() noexcept;
  [[nodiscard]] Vec2 arm_angles() const noexcept;

  LivePlant plant_;
  TwoDiyCalibration truth_;
  const bool velocities_;
  Vec2 last_angles_ = Vec2::Zero();  ///< angles at the last answer [rad]
  PantographKinematics kinematics_;
  PantographPose pose_;
  std::array<Wheel, 4> motors_, encoders_;
  std::vector<std::uint8_t> message_;
  Vec2 torques_ = Vec2::Zero();  ///< torques of the arms [N m]
  bool in_stops_ = true;         ///< the arms are in their stops, until the first set-up
  std::atomic<double> torque_{0};
  std::atomic<int> setups_{0};
  std::atomic<bool> held_{false};
  std::array<std::atomic<double>, 2> held_angles_{};
};

}  // namespace haptrace
