// What a test sees of the fakes of vendors' libraries, and what it has them do. Each fake exports one of these.
#pragma once

#include <array>
#include <atomic>

namespace haptrace::test {

using AtomicVector = std::array<std::atomic<double>, 3>;

/// In front of a simulated omega.3, whose frame is the vendor's F: x towards the user, y to his right, z up. With
/// `type` 104 it has the wrist and the gripper of a sigma.7.
struct FakeDrd {
  // What it is like, and how it answers.
  std::atomic<int> devices{1}, type{33}, serial{4711};
  std::atomic<bool> opens{true}, opens_robotic{true}, has_watchdog{true};
  std::atomic<bool> calibrated{true}, auto_init_works{true};
  std::atomic<int> force_off_cause{0};
  std::atomic<int> answer{0}, position_answer{0};  ///< of what talks to the device
  std::atomic<double> software_max_force{-1};
  std::atomic<unsigned> buttons{0};
  std::atomic<double> yaw{0};          ///< of the wrist, about F's z [rad]
  std::atomic<bool> is_placed{false};  ///< at `place`, wherever its motors would move it
  AtomicVector place{};                ///< in F [m]

  // What was done to it.
  std::atomic<int> opened{0}, opened_robotic{0}, closed{0}, auto_inits{0}, robotic_stops{0}, watchdog{0};
  std::atomic<int> gravity_compensation{-1}, emulated_button{0};
  std::atomic<int> blind_pushes{0};  ///< positions that could not be read while its motors pushed
  std::atomic<bool> enabled{false}, braked{true};
  AtomicVector force{}, torque{};  ///< the last that was sent, in F [N], [N m]

  /// Of its motors, along an axis of F [N].
  [[nodiscard]] double motor(std::size_t axis) const {
    return enabled && !braked && force_off_cause == 0 ? force[axis].load() : 0;
  }
  [[nodiscard]] bool pushes() const { return motor(0) != 0 || motor(1) != 0 || motor(2) != 0; }
};

/// In front of a simulated Touch.
struct FakeHd {
  static constexpr unsigned kCalibrated = 0x5000, kNeedsUpdate = 0x5001, kNeedsManualInput = 0x5002;

  std::atomic<bool> is_there{true}, takes_rate{true};
  std::atomic<const char*> default_name{nullptr};  ///< by which alone the default device is known; null: by no name
  std::atomic<unsigned> calibration{kCalibrated};
  std::atomic<int> styles{4};
  std::atomic<int> output_dof{3};
  std::atomic<bool> frozen{false};  ///< the servo loop stands still, and the motors keep their force
  std::atomic<unsigned> fault{0};   ///< the error of every frame
  std::atomic<int> buttons{0};
  std::atomic<double> yaw{0};  ///< of the stylus, about y [rad]
  std::atomic<bool> is_placed{false};
  AtomicVector place{};  ///< [mm]

  std::atomic<int> opened{0}, closed{0}, frames{0}, updates{0}, updated_style{0};
  std::atomic<int> misused{0};  ///< calls outside of a frame that belong inside, and the other way round
  std::atomic<bool> running{false}, output{false}, scheduled{false};
  AtomicVector force{}, torque{};  ///< of its motors [N], [mN m]

  [[nodiscard]] bool pushes() const { return force[0] != 0 || force[1] != 0 || force[2] != 0; }
};

}  // namespace haptrace::test
