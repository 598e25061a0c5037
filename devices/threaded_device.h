// A device whose driver waits for its hardware, in a thread of its own.
#pragma once

#include "control/mailbox.h"
#include "devices/device.h"
#include "devices/realtime.h"

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <semaphore>
#include <string>
#include <thread>

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

  /// Sends zero force as well as it still can and lets go of the hardware. Idempotent; its destructor calls it.
  virtual void release() noexcept = 0;
};

/// Every exchange hands its wrench to the driver's thread, wakes it, and takes the newest state that the driver has
/// fetched: that of the exchange before, as long as a round is shorter than a tick. DeviceState::age says since when,
/// and DeviceState::sequence counts the answers, unless the driver numbers its samples itself.
///
/// The thread watches over both sides. Without an exchange for kWatchdog, or for kWatchedTicks where ticks are as long
/// as that, it sends zero force, and goes on with rounds, so that the hardware is neither forgotten under force nor
/// lets the connection drop. A device that gave no answer for kPatience is lost, and zero force is sent before it is
/// let go of.
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
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override { return driver_->not_ready_reason(); }

  /// How long a wrench holds without another exchange, after one that came `dt` [s] after the one before [ns].
  [[nodiscard]] static std::int64_t watched_ns(double dt) noexcept;

  /// Of the driver's thread.
  [[nodiscard]] const RealtimeStatus& realtime() const noexcept { return realtime_; }

 private:
  struct Order {
    Wrench wrench;
    std::int64_t until_ns = 0;  ///< afterwards it is none
  };
  struct Answer {
    DeviceState state;
    std::int64_t taken_ns = 0;  ///< when it came, on the monotonic clock
  };

  void post(Answer& answer);
  void first_answer();
  void run() noexcept;
  void lose(const std::string& why) noexcept;

  std::unique_ptr<DeviceDriver> driver_;  ///< the thread's, while it runs
  const DeviceInfo info_;
  bool closed_ = false;
  RealtimeStatus realtime_;

  Mailbox<Order> order_;
  Mailbox<Answer> answer_;
  std::counting_semaphore<> wake_{0};  ///< released by every exchange
  std::atomic<bool> ending_{false}, lost_{false};
  mutable std::mutex reason_;  ///< guards why_; never taken in exchange
  std::string why_ = "the device stopped answering";
  std::uint64_t answers_ = 0;
  std::thread thread_;
};

}  // namespace haptrace
