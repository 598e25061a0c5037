// A recording that answers as if it were the device.
#pragma once

#include "base/nano_time.h"
#include "devices/loop/prefetcher.h"
#include "devices/registry.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace haptrace {

/// Answers with the last recorded position at or before its own, virtual time, and with the last one of all when the
/// recording is over; before the first, with the first. Invents nothing in between. Takes forces and ignores them.
///
/// Reads ahead of its time in a thread of its own, so that memory is flat in the recording's length. Should that be
/// late on the monotonic clock, it goes on answering the last row it has; on the virtual clock the loop waits between
/// ticks. The device is lost where the recording cannot be read.
class ReplayDevice final : public Device {
 public:
  static constexpr std::uint64_t kBlock = 16'384;  ///< rows

  /// Consecutive rows of a recording. A position that is not finite is none.
  struct Rows {
    std::vector<std::int64_t> time_ns;                                 ///< since the first sample, in order
    std::vector<Vec3> position;                                        ///< [m], as many
    std::vector<Vec3> force;                                           ///< measured [N], as many, or none
    std::int64_t until_ns = std::numeric_limits<std::int64_t>::max();  ///< the time of the row that follows
  };

  /// Of rows that are all there. Of `info` it needs what a recording knows about its device. At least one row, the
  /// first with a position.
  ReplayDevice(const DeviceInfo& info, Rows rows);

  /// Of a recording in `blocks` blocks, the first of which is there. `info` says where it goes and how long it lasts.
  ReplayDevice(DeviceInfo info, std::shared_ptr<const Rows> first, std::size_t blocks, Prefetcher<Rows>::Load load);

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;
  void close() noexcept override { closed_ = true; }
  [[nodiscard]] std::string lost_reason() const override;

 private:
  ReplayDevice(const DeviceInfo& info, std::shared_ptr<const Rows> rows);

  /// Moves on to the last row at or before `now`, as far as there are rows. False where they cannot be had.
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

/// `replay`, with the option file.
DeviceBackend replay_backend();

}  // namespace haptrace
