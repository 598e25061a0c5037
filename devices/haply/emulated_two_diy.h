// The board and the arms of a Haply 2DIY, without either.
#pragma once

#include "devices/haply/calibration.h"
#include "devices/serial/emulated_line.h"
#include "devices/sim/live_plant.h"

#include <array>
#include <atomic>

namespace haptrace {

/// Understands bytes as the hAPI firmware is known to: it waits for the rest of a message for ever, takes what is no
/// command for nothing, keeps its last torques whatever happens, and has no watchdog. Where sources say nothing it does
/// what is worst: a reset forgets the motors and leaves them pulling.
///
/// Its owner had the arms in their stops when it was set up first, and led the handle to where the plant is before
/// anybody looked. Whoever sets it up again finds the arms anywhere, and they are counted from there.
///
/// Threads: torque and set-ups may be asked from any.
class EmulatedTwoDiy final : public EmulatedBoard {
 public:
  /// Built and wired as `truth` says. Throws Error(input) when the arms do not reach the plant's workspace.
  /// Its firmware also answers with the velocity of every encoder if `velocities`.
  EmulatedTwoDiy(LivePlant plant, TwoDiyCalibration truth, bool velocities = false);

  void advance(std::int64_t now_ns) override;
  void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) override;
  void power_cycle() override;

  /// The larger of what both motors bring up now [N m].
  [[nodiscard]] double torque() const noexcept { return torque_; }
  [[nodiscard]] int setups() const noexcept { return setups_; }
  /// Moves the arms by hand, wherever the plant is, until it is called with none.
  void hold_arms(const Vec2& angles) noexcept;
  void let_arms_go() noexcept { held_ = false; }

 private:
  struct Wheel {  ///< what the board knows of a port
    bool known = false, ccw = true;
    double offset = 0, counts_per_turn = 1;  ///< [deg], [counts]
    double zero = 0;                         ///< the arm's angle at its offset [rad]
  };

  [[nodiscard]] std::size_t message_length() const noexcept;
  void set_up();
  void exchange(std::vector<std::uint8_t>& answer);
  void forget() noexcept;
  [[nodiscard]] Vec2 arm_angles() const noexcept;

  LivePlant plant_;
  TwoDiyCalibration truth_;
  const bool velocities_;
  Vec2 last_angles_ = Vec2::Zero();  ///< at the last answer [rad]
  PantographKinematics kinematics_;
  PantographPose pose_;
  std::array<Wheel, 4> motors_, encoders_;
  std::vector<std::uint8_t> message_;
  Vec2 torques_ = Vec2::Zero();  ///< of the arms [N m]
  bool in_stops_ = true;         ///< where its owner has put the arms before switching it on
  std::atomic<double> torque_{0};
  std::atomic<int> setups_{0};
  std::atomic<bool> held_{false};
  std::array<std::atomic<double>, 2> held_angles_{};
};

}  // namespace haptrace
