// A control socket: the commands of a LiveTuning over TCP, for programs on the same machine.
#pragma once

#include "player/live_tuning.h"

#include <cstdint>
#include <memory>
#include <string_view>

namespace haptrace {

/// Reads "5005", "127.0.0.1:5005", "localhost:5005" or "[::1]:5005"; 0 is any free port. Throws Error(input) for every
/// other address: whoever can reach the socket moves a motor.
std::uint16_t parse_tuning_port(std::string_view text);

/// Listens on the loopback, 127.0.0.1 and, where there is IPv6, ::1, and on nothing else: there is no way to ask for
/// it. Up to 16 clients send commands (LiveTuning::obey), a line each, and get a line for each. Lines over 256 bytes
/// are refused; what has no line's end is no command; a web browser is turned away. A client is served at most 200
/// commands a second, and its next command only once it took the last answer, so that one that never reads costs
/// nothing.
///
/// Threads: one of its own, which ends with the object. Nothing here is near the servo loop.
class TuningServer {
 public:
  /// `tuning` is borrowed and must outlive this. Throws Error(input) when the port cannot be had.
  TuningServer(LiveTuning& tuning, std::uint16_t port);
  ~TuningServer();
  TuningServer(const TuningServer&) = delete;
  TuningServer& operator=(const TuningServer&) = delete;

  [[nodiscard]] std::uint16_t port() const noexcept;

 private:
  class Listeners;
  std::unique_ptr<Listeners> listeners_;
};

}  // namespace haptrace
