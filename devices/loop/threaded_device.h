// A device whose driver waits for its hardware, in a thread of its own.
#pragma once

#include "devices/device.h"
#include "devices/loop/loose_thread.h"
#include "devices/loop/realtime.h"

#include <cstdint>
#include <memory>
#include <string>

namespace haptrace {

/// How one kind of hardware is talked to, a round at a time: a wrench goes out, the state that answers it comes back.
/// Open from its making to release().
///
/// Threads: one at a time. Not real-time: it may wait, allocate and throw.
class DeviceDriver {
 public:
  virtual ~DeviceDriver() = default;
  DeviceDriver() = default;
  DeviceDriver(const DeviceDriver&) = delete;
  DeviceDriver& operator=(const DeviceDriver&) = delete;

  [[nodiscard]] virtual const DeviceInfo& info() const noexcept = 0;

  /// Sends `wrench`, which is finite, and fetches the newest state. Returns false when no answer came in time that can
  /// be believed: the caller asks again. May last some 10 ms at most. Throws Error(device), saying what happened and
  /// what to do, when the device is lost. A state that is not ready promises nothing but its buttons: its position
  /// stands still.
  [[nodiscard]] virtual bool round(const Wrench& wrench, DeviceState& state) = 0;

  /// As Device::not_ready_reason, but in any thread, also during a round.
  [[nodiscard]] virtual std::string not_ready_reason() const { return ""; }

  /// Sends zero force as well as it still can, lets go of the hardware, and says what it knows of the motors since.
  /// Once more does nothing and returns the same; its destructor calls it.
  virtual ZeroForce release() noexcept = 0;

  /// As Device::emergency_stop, while a round does not return.
  [[nodiscard]] virtual ZeroForce emergency_stop() noexcept { return ZeroForce::failed; }
};

/// Every exchange hands its wrench to the driver's thread, wakes it, and takes the newest state that the driver has
/// fetched: that of the exchange before, as long as a round is shorter than a tick. DeviceState::age says since when,
/// and DeviceState::sequence counts the answers, unless the driver numbers its samples itself.
///
/// The thread watches over both sides. Without an exchange for kWatchdog, or for kWatchedTicks where ticks are as long
/// as that, it sends zero force, and goes on with rounds, so that the hardware is neither forgotten under force nor
/// lets the connection drop. A device that gave no answer for kPatience is lost, and zero force is sent before it is
/// let go of. A driver that does not return from a round or from its release is given up by the close: its thread and
/// all that this uses stay behind (LooseThread).
///
/// Threads: as every device. Real-time: exchange posts and takes by atomics alone, and wakes a thread.
class ThreadedDevice final : public Device {
 public:
  static constexpr double kWatchdog = 0.02;  ///< [s]
  static constexpr double kWatchedTicks = 3;
  static constexpr double kPatience = 0.1;  ///< [s]

  /// Plays the first rounds, until the device has answered; throws Error(device) when it does not within a second.
  explicit ThreadedDevice(std::unique_ptr<DeviceDriver> driver);
  ~ThreadedDevice() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override;
  /// Confirmed once a round that began after this call was answered, and took zero force along; and where no other
  /// force was sent since such an answer.
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override;

  /// How long a wrench holds without another exchange, after one that came `dt` [s] after the one before [ns].
  [[nodiscard]] static std::int64_t watched_ns(double dt) noexcept;

  /// Of the driver's thread.
  [[nodiscard]] const RealtimeStatus& realtime() const noexcept;

 private:
  class Rounds;

  const std::shared_ptr<Rounds> rounds_;  ///< shared with the thread
  const DeviceInfo info_;
  bool closed_ = false;
  LooseThread thread_;
};

}  // namespace haptrace
