// A device that is reopened after it was lost, for example by a loose cable or an amplifier without power.
#pragma once

#include "devices/device.h"
#include "devices/loop/loose_thread.h"

#include <functional>
#include <memory>
#include <string>

namespace haptrace {

/// Forwards every call to the device that `open` returns. If that device is lost, this one reports `away`: its own
/// thread closes the lost device and calls `open` until the same device is back (same backend, model and serial
/// number). The first exchange after that sends zero force, whatever the caller asked for, with dt = 0. The caller must
/// check whether the device is ready and decide how long to keep asking.
///
/// The device is lost for good if another device answers in its place. That device is closed and not opened again,
/// because opening may move it. A device with a natural duration is lost for good too, because it would restart from
/// its beginning.
///
/// `open` is called at most every kRetry, measured by the dt of exchange. In virtual time, between_ticks waits for it,
/// so that every run is identical. On the monotonic clock, `open` may take any time. close waits for it but gives up a
/// call that does not return (LooseThread); `open` therefore owns everything it uses.
///
/// Threads: as for every device. `open` runs in another thread than exchange, never concurrently with a call of its
/// device. Real-time: exchange, if the device's exchange is; an atomic hands the device over.
class RecoveringDevice final : public Device {
 public:
  using Open = std::function<std::unique_ptr<Device>()>;  ///< opens the device, or throws

  static constexpr double kRetry = 0.1;  ///< [s]

  /// Opens the device for the first time. Throws what `open` throws.
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
