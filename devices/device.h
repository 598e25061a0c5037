// Everything that has a position and takes a force.
#pragma once

#include "base/types.h"

#include <array>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// What a device is and can do. Fixed while it is open. Unknown figures are 0.
struct DeviceInfo {
  std::string name;     ///< as asked for with --device
  std::string backend;  ///< "sim", "replay", "plugin", ...
  std::string model;
  std::string serial;

  bool virtual_time = false;  ///< advances only by exchange's dt
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
  double natural_duration = 0;              ///< of what it has to show, an intent or a recording [s]; 0: endless
  std::vector<std::string> notes;           ///< what a person should know before using it

  [[nodiscard]] bool takes_torque() const noexcept { return torque_axes[0] || torque_axes[1] || torque_axes[2]; }
};

/// What a device says when asked. Quantities it does not measure are NaN.
struct DeviceState {
  Vec3 position = Vec3::Zero();  ///< p_WT [m]
  Vec3 velocity = nan3();        ///< [m/s]
  Quat orientation = nan_quat();
  Vec3 force = nan3();  ///< measured contact force on the hand [N]
  std::uint32_t buttons = 0;
  bool ready = true;  ///< homed, and forces are allowed
  double age = 0;     ///< of this state when it is returned, for drivers whose I/O has a thread of its own [s]
  /// Changes with every sample that the device takes: an exchange that returns the same number as the one before
  /// repeats a state. 0: the device does not say, and every exchange counts as a new sample.
  std::uint64_t sequence = 0;
};

/// What is known of a device's motors after zero force was asked for.
enum class ZeroForce : std::uint8_t {
  confirmed,  ///< the device answered to it
  sent,       ///< it was handed over; whether it arrived nobody says
  failed,     ///< it could not be sent, or was not answered: the motors may hold their last force
};

/// For programs: "confirmed" | "sent" | "failed".
constexpr const char* to_string(ZeroForce zero) noexcept {
  constexpr std::array kNames{"confirmed", "sent", "failed"};
  return kNames[static_cast<std::size_t>(zero)];
}

/// For people: a sentence's part.
constexpr const char* describe(ZeroForce zero) noexcept {
  constexpr std::array kWords{"the force is zero", "zero force was sent, but the device does not say whether it came",
                              "the force could not be set to zero: switch the device off"};
  return kWords[static_cast<std::size_t>(zero)];
}

/// What may leave for a motor: a force or torque that is not finite is none.
inline Wrench sendable(const Wrench& wrench) noexcept {
  return {is_finite(wrench.force) ? wrench.force : Vec3::Zero(),
          is_finite(wrench.torque) ? wrench.torque : Vec3::Zero()};
}

/// A device that is open: it exists from its opening to its close.
///
/// Threads: one thread at a time. Real-time: exchange, and only exchange, is called from the tick; it allocates
/// nothing, locks nothing, throws nothing, and returns within the tick. A driver whose I/O is slower owns a thread and
/// exchanges the newest state and force with it without locks; a vendor's callback that owns the servo thread is such
/// a thread.
class Device {
 public:
  static constexpr double kLongestClose = 3;  ///< [s]

  enum class [[nodiscard]] Status : std::uint8_t{
      ok,
      away,  ///< it does not answer now and may again: ask on, with zero force
      lost,  ///< for good
  };

  virtual ~Device() = default;
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  [[nodiscard]] virtual const DeviceInfo& info() const noexcept = 0;

  /// Applies `wrench` from now on, lets a virtual-time device advance by `dt` [s] under it, and returns the newest
  /// state. The first exchange of a session has dt = 0. After `away` and `lost` the state is not to be used. After
  /// `lost` every further exchange is lost too.
  virtual Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept = 0;

  /// As for SampleSink: after every tick, outside of it; may wait only where time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }

  /// Sends zero force and lets go of the hardware; lasts kLongestClose at most, whatever the hardware does. Idempotent;
  /// the destructor of every device calls it.
  virtual void close() noexcept = 0;

  /// What became of the zero force that was sent last, by an exchange, or by its close. May wait for the device to
  /// answer. Called when no exchange is under way; not for the tick.
  [[nodiscard]] virtual ZeroForce zero_force() noexcept {
    return info().virtual_time ? ZeroForce::confirmed : ZeroForce::sent;
  }

  /// Takes the force away while an exchange does not return. From another thread than exchange's, and once: the process
  /// is about to end. It may hang as well, so its caller does not wait for it.
  [[nodiscard]] virtual ZeroForce emergency_stop() noexcept {
    return info().virtual_time ? ZeroForce::confirmed : ZeroForce::failed;
  }

  /// Why exchange returned `lost` or `away`, for people. Not for the tick.
  [[nodiscard]] virtual std::string lost_reason() const { return "the device stopped answering"; }

  /// Why its states are not ready and what to do about it, for people; empty when it does not know. Not for the tick.
  [[nodiscard]] virtual std::string not_ready_reason() const { return ""; }
};

}  // namespace haptrace
