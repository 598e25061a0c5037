// A recording that answers as if it were the device.
#pragma once

#include "devices/nano_time.h"
#include "devices/registry.h"

#include <optional>
#include <vector>

namespace haptrace {

/// Answers with the last recorded sample at or before its own, virtual time, and with the last one of all when the
/// recording is over; before the first, with the first. Invents nothing in between. Takes forces and ignores them.
/// Keeps time, position and measured force of the whole recording in memory.
class ReplayDevice final : public Device {
 public:
  /// What a recording knows about its device.
  struct Recording {
    DeviceInfo info;
    std::vector<std::int64_t> time_ns;  ///< since the first sample, in order
    std::vector<Vec3> position;         ///< [m], as many
    std::vector<Vec3> force;            ///< measured [N], as many, or none
  };

  /// With one sample at least.
  explicit ReplayDevice(Recording recording);

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return recording_.info; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override { closed_ = true; }
  [[nodiscard]] std::string lost_reason() const override { return "the replay is closed"; }

 private:
  Recording recording_;
  std::size_t row_ = 0;
  NanoTime time_;
  bool closed_ = false;
};

/// `replay`, with the option file.
DeviceBackend replay_backend();

}  // namespace haptrace
