// The way to a Falcon's firmware: an FTDI chip that turns USB into a serial line.
#pragma once

#include "devices/guardian/guardian.h"

#include <cstdint>
#include <optional>
#include <span>

namespace haptrace {

/// Open from its making to close().
///
/// Threads: one at a time. Not real-time.
class FalconLink {
 public:
  /// Vendor requests of the chip that take no data (FTDI's FT232 series; as libnifalcon uses them).
  enum class Request : std::uint8_t { purge = 0, modem = 1, flow = 2, baud = 3, line = 4, latency_timer = 9 };

  virtual ~FalconLink() = default;
  FalconLink() = default;
  FalconLink(const FalconLink&) = delete;
  FalconLink& operator=(const FalconLink&) = delete;

  /// Throws Error(device), saying what was refused and what to do.
  virtual void control(Request request, std::uint16_t value) = 0;

  /// Sends all of `bytes`; returns false when that lasts longer than `timeout` [s], and nothing more of them is sent.
  /// Throws Error(device) when the device is gone.
  [[nodiscard]] virtual bool write(std::span<const std::uint8_t> bytes, double timeout) = 0;

  /// Takes what has come of the serial line, without the chip's own status bytes, and waits for the first byte at most
  /// `timeout` [s]. Returns how many there are: 0 when none came. Throws Error(device) when the device is gone.
  [[nodiscard]] virtual std::size_t read(std::span<std::uint8_t> bytes, double timeout) = 0;

  /// Where a guardian reaches the firmware, until close(); nothing where no other process can.
  [[nodiscard]] virtual std::optional<GuardedPort> guarded_port() const noexcept { return std::nullopt; }

  /// Idempotent; the destructor calls it.
  virtual void close() noexcept = 0;
};

}  // namespace haptrace
