// Access to a serial port as raw bytes, without terminal processing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <termios.h>

namespace haptrace {

/// A tty with 8 data bits, no parity, no flow control and no translation, for exclusive use by this program. Open from
/// its construction to close(), which restores the line's settings.
///
/// Opening raises DTR, which resets boards like the Arduino Uno. Never choose 1200 baud, which erases an Arduino Due.
///
/// Threads: one at a time. Not real-time.
class SerialPort {
 public:
  /// Opens the port. `baud` has no effect on boards with their own USB. Throws Error(device), with the remedy, if there
  /// is no such port (naming those there are), permission is missing, the port is in use, it is no serial port, or it
  /// does not support the speed.
  SerialPort(const std::string& path, int baud);
  ~SerialPort() { close(); }
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// Sends all of `bytes`. Returns false if that takes longer than `timeout` [s]; a part of them may have been sent.
  /// Throws Error(device) if the port is gone.
  [[nodiscard]] bool write(std::span<const std::uint8_t> bytes, double timeout);

  /// Reads the bytes that have come. Waits at most `timeout` [s] for the first byte. Returns the number of bytes; 0 if
  /// none came. Throws Error(device) if the port is gone.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> bytes, double timeout);

  /// Discards bytes that have come and were not read.
  void discard_input() noexcept;

  /// Waits briefly until written bytes are sent, and closes the port. Idempotent; the destructor calls it.
  void close() noexcept;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  [[nodiscard]] int descriptor() const noexcept { return fd_; }  ///< -1 once closed

 private:
  [[nodiscard]] bool wait(short event, double timeout) const;
  void configure(int baud);
  void hurry() noexcept;

  std::string path_;
  int fd_ = -1;
  termios found_{};
  std::optional<int> found_flags_;  ///< original flags of the driver, if its latency was changed
};

}  // namespace haptrace
