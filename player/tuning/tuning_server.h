// Control socket: lets programs on the same machine send the commands of a session.
#pragma once

#include "player/tuning/commands.h"

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// Reads "5005", "127.0.0.1:5005", "localhost:5005" or "[::1]:5005"; 0 is any free port. Throws Error(input) for every
/// other address: every program that can reach the socket moves a motor.
std::uint16_t parse_tuning_port(std::string_view text);

/// Returns 128 random bits in hexadecimal digits.
std::string new_tuning_token();

/// Returns the token in a file, which may hold it as the line that a client sends, "token TOKEN". Throws Error(input):
/// the file is not a regular file of this user that nobody else can read, or holds no token of 16 to 128 printable
/// characters.
std::string read_tuning_token(const std::string& file);

/// Writes the line "token TOKEN" into a new file of mode 0600. Throws Error(input).
void write_tuning_token(const std::string& token, const std::string& file);

/// Executes the commands (Commands::obey) of up to 16 clients, one per line, and answers each with a line. Listens on
/// a Unix socket that only this user and root can open, on the loopback of TCP (127.0.0.1 and, where there is IPv6,
/// ::1), or on both; never on a network interface.
///
/// Every program on the machine can reach the loopback, including a web page in a browser. A TCP client is a stranger
/// until its first line is "token TOKEN". The first byte that cannot belong to that line closes the connection without
/// an answer; so do five seconds of silence and 64 newer strangers.
///
/// An admitted client gets an error for an unknown command and stays connected. A line that no user types (over 256
/// bytes, not printable, HTTP) ends its connection, because behind a forwarded port a client may still be a browser. If
/// a 17th client connects, the one that was silent longest is disconnected. A client gets at most 200 answers per
/// second, and its next command runs only after it has read the last answer, so that a client that never reads costs
/// nothing. A command without a line end is not executed.
///
/// Threads: one of its own, which ends with the object. It does not touch the servo loop.
class TuningServer {
 public:
  struct Options {
    std::string socket;                        ///< path of the Unix socket; empty: none
    std::optional<std::uint16_t> port;         ///< port on the loopback, 0: any free one
    std::string token;                         ///< token of TCP clients; required with a port
    std::chrono::milliseconds patience{5000};  ///< time limit for strangers
  };

  /// `commands` is borrowed and must outlive this. Throws Error(input) when the token is invalid or the socket or the
  /// port is not available.
  TuningServer(Commands& commands, Options options);
  ~TuningServer();
  TuningServer(const TuningServer&) = delete;
  TuningServer& operator=(const TuningServer&) = delete;

  /// Returns the TCP port; 0 if there is none.
  [[nodiscard]] std::uint16_t port() const noexcept;

 private:
  class Listeners;
  std::unique_ptr<Listeners> listeners_;
};

}  // namespace haptrace
