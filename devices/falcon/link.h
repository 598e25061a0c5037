// Link to a Falcon's firmware, over an FTDI chip that converts USB to a serial line.
#pragma once

#include "devices/guardian/guardian.h"

#include <cstdint>
#include <optional>
#include <span>

namespace haptrace {

/// A serial link to the firmware, open from its construction to close().
///
/// Threads: one at a time. Not real-time.
class FalconLink {
 public:
  /// Vendor requests without data to the chip (FTDI's FT232 series; as libnifalcon uses them).
  enum class Request : std::uint8_t { purge = 0, modem = 1, flow = 2, baud = 3, line = 4, latency_timer = 9 };

  virtual ~FalconLink() = default;
  FalconLink() = default;
  FalconLink(const FalconLink&) = delete;
  FalconLink& operator=(const FalconLink&) = delete;

  /// Sends a request. Throws Error(device) naming the refused request and the remedy.
  virtual void control(Request request, std::uint16_t value) = 0;

  /// Sends all of `bytes`. Returns false if that takes longer than `timeout` [s]; the rest is then not sent. Throws
  /// Error(device) if the device is gone.
  [[nodiscard]] virtual bool write(std::span<const std::uint8_t> bytes, double timeout) = 0;

  /// Reads the bytes that have come over the serial line, without the chip's own status bytes. Waits at most `timeout`
  /// [s] for the first byte. Returns the number of bytes; 0 if none came. Throws Error(device) if the device is gone.
  [[nodiscard]] virtual std::size_t read(std::span<std::uint8_t> bytes, double timeout) = 0;

  /// Returns the port by which a guardian reaches the firmware, valid until close(); nothing if no other process can.
  [[nodiscard]] virtual std::optional<GuardedPort> guarded_port() const noexcept { return std::nullopt; }

  /// Idempotent; the destructor calls it.
  virtual void close() noexcept = 0;
};

}  // namespace haptrace
