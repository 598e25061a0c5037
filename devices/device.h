// Interface of a haptic device, which has a position and takes a force.
#pragma once

#include "base/types.h"

#include <array>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// Properties and capabilities of a device. Fixed while it is open; unknown figures are 0.
struct DeviceInfo {
  std::string name;     ///< the text given with --device
  std::string backend;  ///< "sim", "replay", "plugin", ...
  std::string model;
  std::string serial;

  bool virtual_time = false;  ///< time advances only by the dt of exchange()
  std::array<bool, 3> force_axes{true, true, true};
  std::array<bool, 3> torque_axes{false, false, false};
  bool measures_velocity = false;
  bool measures_orientation = false;
  bool measures_force = false;

  Vec3 workspace_min = Vec3::Constant(-1);  ///< [m]
  Vec3 workspace_max = Vec3::Constant(1);   ///< [m]
  double position_resolution = 0;           ///< [m]
  double max_force = 0;                     ///< magnitude [N]
  double max_continuous_force = 0;          ///< magnitude [N]
  double max_torque = 0;                    ///< magnitude [N m]
  double nominal_rate = 1000;               ///< [Hz]
  double natural_duration = 0;              ///< duration of the intent or recording that it plays [s]; 0: endless
  std::vector<std::string> notes;           ///< hints for the user before using the device

  [[nodiscard]] bool takes_torque() const noexcept { return torque_axes[0] || torque_axes[1] || torque_axes[2]; }
};

/// State of a device, as an exchange returns it. Quantities that the device does not measure are NaN.
struct DeviceState {
  Vec3 position = Vec3::Zero();  ///< p_WT [m]
  Vec3 velocity = nan3();        ///< [m/s]
  Quat orientation = nan_quat();
  Vec3 force = nan3();  ///< measured contact force on the hand [N]
  std::uint32_t buttons = 0;
  bool ready = true;  ///< the device is homed and allows forces
  double age = 0;     ///< age of this state when it is returned, for drivers with an I/O thread of their own [s]
  /// Sample number, which changes with every sample that the device takes. An exchange that returns the same number as
  /// the previous one repeats a state. 0: the device does not number its samples, and every exchange counts as a new
  /// sample.
  std::uint64_t sequence = 0;
};

/// State of a device's motors after a request for zero force, as far as it is known.
enum class ZeroForce : std::uint8_t {
  confirmed,  ///< the device answered the request
  sent,       ///< the request was handed over; nothing confirms that it arrived
  failed,     ///< the request could not be sent or was not answered: the motors may hold their last force
};

/// Returns "confirmed", "sent" or "failed", for programs.
constexpr const char* to_string(ZeroForce zero) noexcept {
  constexpr std::array kNames{"confirmed", "sent", "failed"};
  return kNames[static_cast<std::size_t>(zero)];
}

/// Returns a clause for messages to the user.
constexpr const char* describe(ZeroForce zero) noexcept {
  constexpr std::array kWords{"the force is zero",
                              "zero force was sent, but the device does not confirm that it arrived",
                              "the force could not be set to zero: switch the device off"};
  return kWords[static_cast<std::size_t>(zero)];
}

/// Returns the wrench that may be sent to the motors: a force or torque that is not finite becomes zero.
inline Wrench sendable(const Wrench& wrench) noexcept {
  return {is_finite(wrench.force) ? wrench.force : Vec3::Zero(),
          is_finite(wrench.torque) ? wrench.torque : Vec3::Zero()};
}

/// An open device: its constructor opens it, and close() or its destructor closes it.
///
/// Threads: one thread at a time, except for emergency_stop(). Real-time: the tick calls only exchange(), which does
/// not allocate, lock or throw, and returns within the tick. A driver with slower I/O owns a thread and exchanges the
/// newest state and force with it without locks. A vendor's callback that owns the servo thread is such a thread.
class Device {
 public:
  static constexpr double kLongestClose = 3;  ///< [s]

  enum class [[nodiscard]] Status : std::uint8_t{
      ok,
      away,  ///< the device does not answer but may recover: keep calling exchange() with zero force
      lost,  ///< the device is lost for good
  };

  virtual ~Device() = default;
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  [[nodiscard]] virtual const DeviceInfo& info() const noexcept = 0;

  /// Applies `wrench` from now on, advances a virtual-time device by `dt` [s] under it, and fetches the newest state.
  /// The first exchange of a session has dt = 0. Ignore the state after `away` and `lost`. After `lost` every further
  /// exchange returns `lost`.
  virtual Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept = 0;

  /// Called after every tick, outside of it, like SampleSink::between_ticks. It may wait only if `may_wait`: on
  /// the virtual clock, where time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }

  /// Sends zero force and releases the hardware. Returns within kLongestClose, whatever the hardware does. Idempotent;
  /// the destructor of every device calls it.
  virtual void close() noexcept = 0;

  /// Returns whether the device received the zero force that an exchange or close() sent last. May wait for the
  /// device's answer. Call it while no exchange is under way, and not in the tick.
  [[nodiscard]] virtual ZeroForce zero_force() noexcept {
    return info().virtual_time ? ZeroForce::confirmed : ZeroForce::sent;
  }

  /// Removes the force while an exchange does not return. Called once, from another thread than exchange(), when the
  /// process is about to end. It may hang as well, so its caller does not wait for it.
  [[nodiscard]] virtual ZeroForce emergency_stop() noexcept {
    return info().virtual_time ? ZeroForce::confirmed : ZeroForce::failed;
  }

  /// Returns why exchange() returned `lost` or `away`, as text for the user. Not for the tick.
  [[nodiscard]] virtual std::string lost_reason() const { return "the device stopped answering"; }

  /// Returns why the device is not ready and what to do about it, as text for the user; empty if unknown. Not for the
  /// tick.
  [[nodiscard]] virtual std::string not_ready_reason() const { return ""; }
};

}  // namespace haptrace
