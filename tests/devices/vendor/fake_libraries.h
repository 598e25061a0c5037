// Interface between tests and the fakes of vendors' libraries. Each fake exports one of these structs.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace haptrace::test {

using AtomicVector = std::array<std::atomic<double>, 3>;

/// Controls the fake in front of a simulated omega.3. Its frame is the vendor's F: x towards the user, y to the user's
/// right, z up. With `type` 104 it has the wrist and the gripper of a sigma.7.
struct FakeDrd {
  // Properties of the device, and its answers.
  std::atomic<int> devices{1}, type{33}, serial{4711};
  std::atomic<bool> opens{true}, opens_robotic{true}, has_watchdog{true};
  std::atomic<bool> calibrated{true}, auto_init_works{true};
  std::atomic<int> force_off_cause{0};
  std::atomic<int> answer{0}, position_answer{0};  ///< return values of calls to the device
  std::atomic<double> software_max_force{-1};
  std::atomic<unsigned> buttons{0};
  std::atomic<double> yaw{0};          ///< angle of the wrist about F's z axis [rad]
  std::atomic<bool> is_placed{false};  ///< the handle is at `place`, whatever the motors do
  AtomicVector place{};                ///< position in F [m]

  // Calls recorded by the fake.
  std::atomic<int> opened{0}, opened_robotic{0}, closed{0}, auto_inits{0}, robotic_stops{0}, watchdog{0};
  std::atomic<int> gravity_compensation{-1}, emulated_button{0};
  std::atomic<int> blind_pushes{0};  ///< failed reads of the position while the motors pushed
  std::atomic<bool> enabled{false}, braked{true};
  AtomicVector force{}, torque{};  ///< last force and torque sent, in F [N], [N m]

  /// Returns the force of the motors along an axis of F [N].
  [[nodiscard]] double motor(std::size_t axis) const {
    return enabled && !braked && force_off_cause == 0 ? force[axis].load() : 0;
  }
  [[nodiscard]] bool pushes() const { return motor(0) != 0 || motor(1) != 0 || motor(2) != 0; }
};

/// Controls the fake in front of a simulated Touch.
struct FakeHd {
  static constexpr unsigned kCalibrated = 0x5000, kNeedsUpdate = 0x5001, kNeedsManualInput = 0x5002;

  std::atomic<bool> is_there{true}, takes_rate{true};
  std::atomic<const char*> default_name{nullptr};  ///< only name of the default device; null: it has none
  std::atomic<unsigned> calibration{kCalibrated};
  std::atomic<int> styles{4};
  std::atomic<int> output_dof{3};
  std::atomic<bool> frozen{false};  ///< the servo loop stops, and the motors keep their force
  std::atomic<unsigned> fault{0};   ///< error of every frame
  enum class Call : std::uint8_t { none, unschedule, stop_scheduler, disable_device, update_calibration };
  std::atomic<Call> hangs_in{Call::none};  ///< this call does not return until the value changes
  std::atomic<Call> hung{Call::none};      ///< last call that did not return at once
  std::atomic<int> buttons{0};
  std::atomic<double> yaw{0};  ///< angle of the stylus about y [rad]
  std::atomic<bool> is_placed{false};
  AtomicVector place{};  ///< [mm]

  std::atomic<int> opened{0}, closed{0}, frames{0}, updates{0}, updated_style{0};
  std::atomic<int> misused{0};  ///< calls made outside a frame that belong inside one, or the reverse
  std::atomic<bool> running{false}, output{false}, scheduled{false};
  AtomicVector force{}, torque{};  ///< force and torque of the motors [N], [mN m]

  [[nodiscard]] bool pushes() const { return force[0] != 0 || force[1] != 0 || force[2] != 0; }
};

}  // namespace haptrace::test
