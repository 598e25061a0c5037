// A device that is opened again when it is lost: a cable that slipped, an amplifier that was switched off.
#pragma once

#include "devices/device.h"

#include <atomic>
#include <functional>
#include <mutex>
#include <semaphore>
#include <string>
#include <thread>

namespace haptrace {

/// Passes everything on to the device that `open` makes. When that is lost, it is away instead: a thread of its own
/// closes it and calls `open` again, until the same device is back, that is one of the same backend, model and serial
/// number. The first exchange with it sends zero force, whatever was asked for, and lets no time pass; that it may not
/// be ready yet is for the caller to see. How long to go on asking is the caller's to decide.
///
/// It is lost for good when another device answers in its place: which is closed, and not opened again, since opening
/// may move it. So is one that has something of its own to show (a natural duration) and would begin anew.
///
/// `open` is called at most every kRetry, counted in exchange's time, and in virtual time waited for between ticks, so
/// that a session is the same every time. On the monotonic clock it may last as long as it likes; close waits for it.
///
/// Threads: as every device. `open` is called in another thread than exchange, never at the same time as anything of
/// its device. Real-time: exchange as far as the device's own is; it takes the device over by an atomic alone.
class RecoveringDevice final : public Device {
 public:
  using Open = std::function<std::unique_ptr<Device>()>;  ///< opens it, or throws

  static constexpr double kRetry = 0.1;  ///< [s]

  /// Opens it for the first time; throws what `open` throws.
  explicit RecoveringDevice(Open open);
  ~RecoveringDevice() override;

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;
  void close() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override;

 private:
  /// Where the device is, and with it who may touch it: while it is sought the thread, else the caller.
  enum class Place : std::uint8_t {
    here,
    gone,     ///< to be sought
    sought,   ///< by the thread
    found,    ///< nothing was exchanged with it yet
    replaced  ///< by another one
  };

  void seek_when_asked() noexcept;
  [[nodiscard]] Place seek() noexcept;

  Open open_;
  std::unique_ptr<Device> device_;  ///< may be null while gone or sought
  const DeviceInfo info_;
  double until_retry_ = 0;  ///< [s]
  bool closed_ = false;

  std::atomic<Place> place_{Place::here};
  static_assert(std::atomic<Place>::is_always_lock_free);
  std::counting_semaphore<> wake_{0};
  std::atomic<bool> ending_{false};
  mutable std::mutex reasons_;  ///< guards the two that follow; never taken in exchange
  std::string lost_why_ = "it stopped answering";
  std::string found_not_;  ///< why the last opening failed
  std::thread thread_;
};

}  // namespace haptrace
