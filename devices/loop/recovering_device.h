// A device that is opened again when it is lost: a cable that slipped, an amplifier that was switched off.
#pragma once

#include "devices/device.h"
#include "devices/loop/loose_thread.h"

#include <functional>
#include <memory>
#include <string>

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
/// that a session is the same every time. On the monotonic clock it may last as long as it likes; close waits for it,
/// but gives up one that does not return (LooseThread), so `open` owns what it uses.
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
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override;

 private:
  class Search;

  const std::shared_ptr<Search> search_;  ///< shared with the thread
  const DeviceInfo info_;
  double until_retry_ = 0;  ///< [s]
  bool closed_ = false;
  LooseThread thread_;
};

}  // namespace haptrace
