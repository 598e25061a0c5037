// Who tells a board to stop pulling when its host no longer can.
#pragma once

#include <cstdint>
#include <string>
#include <sys/types.h>
#include <vector>

namespace haptrace {

/// What is said to a board in the host's place. Either takes the force away, wherever the host's last bytes broke off.
struct LastWords {
  std::vector<std::uint8_t> when_silent;  ///< the host shows no life: it is stopped, or starved. It may come back
  std::vector<std::uint8_t> when_dead;    ///< the host is gone
};

/// A process of its own, for boards that keep their last force for ever. It holds the port too; killing the host does
/// not kill it, nor does Ctrl+C or a closed terminal. What kills every process of a machine, a container or a service
/// kills it as well.
///
/// Threads: one at a time. Not real-time.
class Guardian {
 public:
  static constexpr double kPatience = 0.1;    ///< after which a host is silent [s]
  static constexpr double kHeartbeat = 0.02;  ///< the longest a caller should leave between two beats [s]

  /// `port` is an open descriptor. Throws Error(device) when its program cannot be run.
  Guardian(int port, const LastWords& words);
  ~Guardian() { speak_and_go(); }
  Guardian(const Guardian&) = delete;
  Guardian& operator=(const Guardian&) = delete;

  /// The host lives. Throws Error(device) when the guardian does not: nobody would be there to stop the motors.
  void beat();

  /// It is no longer needed: it goes without a word. Idempotent, as is the next.
  void dismiss() noexcept;

  /// It says its last words and goes.
  void speak_and_go() noexcept;

  [[nodiscard]] pid_t process() const noexcept { return process_; }

 private:
  void leave() noexcept;

  int line_ = -1;  ///< to its standard input
  pid_t process_ = -1;
  std::int64_t beaten_ns_ = 0;
};

/// The guardian's program: beside this program when both are installed, else where it was built or installed to; empty
/// when it is nowhere.
std::string guardian_program();

}  // namespace haptrace
