// A device that passes on only positions and forces, like a lab's driver, and hides the properties of the device.
#pragma once

#include "devices/device.h"

namespace haptrace::test {

class BlindDevice final : public Device {
 public:
  explicit BlindDevice(Device& device) : device_(device) {
    info_.name = "unknown";
    info_.virtual_time = true;
    info_.force_axes = device.info().force_axes;
    info_.workspace_min = device.info().workspace_min;
    info_.workspace_max = device.info().workspace_max;
    info_.max_force = device.info().max_force;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    DeviceState told;
    const Status status = device_.exchange(wrench, dt, told);
    state.position = told.position;
    return status;
  }
  void close() noexcept override { device_.close(); }

 private:
  Device& device_;
  DeviceInfo info_;
};

}  // namespace haptrace::test
