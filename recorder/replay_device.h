// A device that replays a recording.
#pragma once

#include "base/nano_time.h"
#include "devices/loop/prefetcher.h"
#include "devices/registry.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace haptrace {

/// Answers with the last recorded position at or before its virtual time. Before the first position it answers with the
/// first, and after the end with the last. It does not interpolate. It accepts forces and ignores them.
///
/// Its own thread reads ahead, so that memory use does not grow with the recording. If that thread is late on the
/// monotonic clock, the device repeats the last row it has; on the virtual clock the loop waits between ticks. The
/// device is lost if the recording cannot be read.
class ReplayDevice final : public Device {
 public:
  static constexpr std::uint64_t kBlock = 16'384;  ///< rows

  /// Consecutive rows of a recording. A position that is not finite counts as missing.
  struct Rows {
    std::vector<std::int64_t> time_ns;                                 ///< since the first sample, in order
    std::vector<Vec3> position;                                        ///< one per time [m]
    std::vector<Vec3> force;                                           ///< measured, one per time or none [N]
    std::int64_t until_ns = std::numeric_limits<std::int64_t>::max();  ///< time of the following row
  };

  /// Replays rows that are all in memory: at least one row, and the first one has a position. `info` needs only the
  /// parts that a recording knows about its device.
  ReplayDevice(const DeviceInfo& info, Rows rows);

  /// Replays a recording of `blocks` blocks, of which `first` is loaded. `info` states its workspace and duration.
  ReplayDevice(DeviceInfo info, std::shared_ptr<const Rows> first, std::size_t blocks, Prefetcher<Rows>::Load load);

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;
  void close() noexcept override { closed_ = true; }
  [[nodiscard]] std::string lost_reason() const override;

 private:
  ReplayDevice(const DeviceInfo& info, std::shared_ptr<const Rows> rows);

  /// Moves to the last row at or before `now`, as far as rows are loaded. Returns false if they cannot be loaded.
  bool advance(std::int64_t now) noexcept;
  void take(std::size_t row) noexcept;

  DeviceInfo info_;
  std::size_t blocks_ = 1;
  Prefetcher<Rows> prefetcher_;
  const Rows* rows_;
  std::size_t block_ = 0;
  std::size_t row_ = 0;
  DeviceState state_;
  NanoTime time_;
  bool closed_ = false;
};

/// Returns the backend `replay`.
DeviceBackend replay_backend();

}  // namespace haptrace
