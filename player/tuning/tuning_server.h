// A control socket: the commands of a LiveTuning for programs on the same machine.
#pragma once

#include "player/tuning/live_tuning.h"

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// Reads "5005", "127.0.0.1:5005", "localhost:5005" or "[::1]:5005"; 0 is any free port. Throws Error(input) for every
/// other address: whoever can reach the socket moves a motor.
std::uint16_t parse_tuning_port(std::string_view text);

/// Returns 128 random bits in hexadecimal digits.
std::string new_tuning_token();

/// Returns the token in a file, which may hold it as the line that a client sends, "token TOKEN". Throws Error(input):
/// the file is not a regular file of this user that nobody else can read, or holds no token of 16 to 128 printable
/// characters.
std::string read_tuning_token(const std::string& file);

/// Writes the line "token TOKEN" into a new file of mode 0600. Throws Error(input).
void write_tuning_token(const std::string& token, const std::string& file);

/// Obeys the commands (LiveTuning::obey) of up to 16 clients, a line each, and answers a line for each. Listens on a
/// Unix socket that only this user and root can open, on the loopback of TCP (127.0.0.1 and, where there is IPv6, ::1),
/// or on both; never on a network.
///
/// Every program of the machine can reach the loopback, a web page in a browser included. A TCP client is a stranger
/// until its first line is "token TOKEN". The first byte that cannot belong to that line closes the connection without
/// an answer; so do five seconds of silence, and sixty-four newer strangers.
///
/// A client that may give commands gets an error for a command that is unknown, and goes on. A line that no person
/// types (over 256 bytes, not printable, HTTP) ends its connection: behind a forwarded port, a client may be a browser
/// after all. When a seventeenth client comes, the one that was silent longest loses its place to it. A client is
/// served at most 200 commands a second, and its next command only once it took the last answer, so that one that never
/// reads costs nothing. A command without the end of its line is not obeyed.
///
/// Threads: one of its own, which ends with the object. Nothing here is near the servo loop.
class TuningServer {
 public:
  struct Options {
    std::string socket;                        ///< path of the Unix socket; empty: none
    std::optional<std::uint16_t> port;         ///< of the loopback, 0: any free one
    std::string token;                         ///< of TCP clients; needed with a port
    std::chrono::milliseconds patience{5000};  ///< with strangers
  };

  /// `tuning` is borrowed and must outlive this. Throws Error(input) when the socket or the port cannot be had.
  TuningServer(LiveTuning& tuning, Options options);
  ~TuningServer();
  TuningServer(const TuningServer&) = delete;
  TuningServer& operator=(const TuningServer&) = delete;

  /// Of TCP; 0 when there is none.
  [[nodiscard]] std::uint16_t port() const noexcept;

 private:
  class Listeners;
  std::unique_ptr<Listeners> listeners_;
};

}  // namespace haptrace
