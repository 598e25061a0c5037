// A serial line as it is: bytes, and no terminal's ways with them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <termios.h>

namespace haptrace {

/// A tty with 8 data bits, no parity, no flow control, nothing translated; of this program alone. Open from its making
/// to close(), which leaves the line's settings as they were found.
///
/// Opening raises DTR, which resets boards of the Arduino Uno's kind; never choose 1200 baud, which erases an Arduino
/// Due.
///
/// Threads: one at a time. Not real-time.
class SerialPort {
 public:
  /// `baud` means nothing to boards that are on USB themselves. Throws Error(device), saying what is in the way and
  /// what to do: no such port (and which there are), no permission, in use, no serial port, a speed it does not have.
  SerialPort(const std::string& path, int baud);
  ~SerialPort() { close(); }
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  /// Sends all of `bytes`; returns false when that lasts longer than `timeout` [s], and a part of them may have gone.
  /// Throws Error(device) when the port is gone.
  [[nodiscard]] bool write(std::span<const std::uint8_t> bytes, double timeout);

  /// Takes what has come, and waits for the first byte at most `timeout` [s]. Returns how many there are: 0 when none
  /// came. Throws Error(device) when the port is gone.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> bytes, double timeout);

  /// Forgets what has come and was not read.
  void discard_input() noexcept;

  /// Waits a little until what was written has left. Idempotent; the destructor calls it.
  void close() noexcept;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }
  [[nodiscard]] int descriptor() const noexcept { return fd_; }  ///< -1 once it is closed

 private:
  [[nodiscard]] bool wait(short event, double timeout) const;
  void configure(int baud);
  void hurry() noexcept;

  std::string path_;
  int fd_ = -1;
  termios found_{};
  std::optional<int> found_flags_;  ///< of the driver, where it has an opinion on latency
};

}  // namespace haptrace
