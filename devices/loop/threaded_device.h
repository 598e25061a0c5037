// A device whose driver waits for its hardware in its own thread.
#pragma once

#include "devices/device.h"
#include "devices/loop/loose_thread.h"
#include "devices/loop/servo_session.h"

#include <cstdint>
#include <memory>
#include <string>

namespace haptrace {

/// Communication with one kind of hardware, in rounds: send a wrench, receive the state that answers it. Open from its
/// construction to release().
///
/// Threads: one at a time. Not real-time: it may wait, allocate and throw.
class DeviceDriver {
 public:
  virtual ~DeviceDriver() = default;
  DeviceDriver() = default;
  DeviceDriver(const DeviceDriver&) = delete;
  DeviceDriver& operator=(const DeviceDriver&) = delete;

  [[nodiscard]] virtual const DeviceInfo& info() const noexcept = 0;

  /// Sends `wrench`, which is finite, and fetches the newest state. Returns false if no valid answer came in time; the
  /// caller then asks again. Takes at most some 10 ms. Throws Error(device) with the cause and the remedy if the device
  /// is lost. A state that is not ready guarantees only its buttons; its position stands still.
  [[nodiscard]] virtual bool round(const Wrench& wrench, DeviceState& state) = 0;

  /// As Device::not_ready_reason, but in any thread, also during a round.
  [[nodiscard]] virtual std::string not_ready_reason() const { return ""; }

  /// Sends zero force if it still can, lets go of the hardware, and returns what it knows about the motors. Further
  /// calls do nothing and return the same. The destructor calls it.
  virtual ZeroForce release() noexcept = 0;

  /// As Device::emergency_stop, while a round does not return.
  [[nodiscard]] virtual ZeroForce emergency_stop() noexcept { return ZeroForce::failed; }
};

/// Runs a driver in its own thread. Every exchange passes its wrench to this thread, wakes it, and takes the newest
/// state that the driver has fetched. If a round is shorter than a tick, this is the state of the previous exchange.
/// DeviceState::age is the time since then. DeviceState::sequence counts the answers, unless the driver numbers its
/// samples itself.
///
/// The thread watches both sides. Without an exchange for kWatchdog, or for kWatchedTicks if these are longer, it sends
/// zero force and continues its rounds: the hardware does not keep a force, and the connection does not drop. A device
/// without an answer for kPatience is lost; the thread sends zero force before it lets go of the device. close gives up
/// a driver that does not return from a round or from its release: its thread and everything that this thread uses stay
/// behind (LooseThread).
///
/// Threads: as for every device. Real-time: exchange uses only atomics, and wakes a thread.
class ThreadedDevice final : public Device {
 public:
  static constexpr double kWatchdog = 0.02;  ///< [s]
  static constexpr double kWatchedTicks = 3;
  static constexpr double kPatience = 0.1;  ///< [s]

  /// Runs the first rounds until the device answers. Throws Error(device) if it does not answer within a second.
  explicit ThreadedDevice(std::unique_ptr<DeviceDriver> driver);
  ~ThreadedDevice() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override;
  /// Returns `confirmed` if the device answered a round with zero force that started after this call, or if the driver
  /// sent no other force since such an answer.
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override;

  /// Returns how long a wrench stays valid without another exchange [ns], if its exchange came `dt` [s] after the one
  /// before.
  [[nodiscard]] static std::int64_t watched_ns(double dt) noexcept;

  /// Returns the real-time status of the driver's thread.
  [[nodiscard]] const RealtimeStatus& realtime() const noexcept;

 private:
  class Rounds;

  const std::shared_ptr<Rounds> rounds_;  ///< shared with the thread
  const DeviceInfo info_;
  bool closed_ = false;
  LooseThread thread_;
};

}  // namespace haptrace
