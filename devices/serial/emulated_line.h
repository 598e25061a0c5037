// A board at the other end of a serial line, without either: a pseudo-terminal, and a thread that is the board.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace haptrace {

/// What a board does with time and bytes. Called by the line's thread alone.
class EmulatedBoard {
 public:
  virtual ~EmulatedBoard() = default;
  EmulatedBoard() = default;
  EmulatedBoard(const EmulatedBoard&) = delete;
  EmulatedBoard& operator=(const EmulatedBoard&) = delete;

  /// Goes on to `now_ns` of the monotonic clock. Called a thousand times a second or more often.
  virtual void advance(std::int64_t now_ns) = 0;
  /// A byte came; what it answers is appended to `answer`.
  virtual void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) = 0;
  /// Its power failed and came back.
  virtual void power_cycle() = 0;
};

/// Opens a pseudo-terminal whose name is what a driver opens as its port. Bytes pass at once: no baud rate.
///
/// Threads: any; faults on demand come at the next byte or wake-up of the line's thread.
class EmulatedLine {
 public:
  enum class Way : std::uint8_t { to_board, to_host };
  enum class Fault : std::uint8_t { lose_byte, flip_bit, insert_garbage };

  /// Throws Error(device) when there are no pseudo-terminals.
  explicit EmulatedLine(std::unique_ptr<EmulatedBoard> board);
  ~EmulatedLine();
  EmulatedLine(const EmulatedLine&) = delete;
  EmulatedLine& operator=(const EmulatedLine&) = delete;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// Happens to the byte after the next `after` ones.
  void inject(Way way, Fault fault, int after = 0);
  /// No byte passes either way; the board lives on.
  void fall_silent(bool silent) noexcept { silent_ = silent; }
  /// The cable is out, for good.
  void unplug() noexcept { unplugged_ = true; }
  void power_cycle() noexcept { cycle_power_ = true; }

 private:
  struct Planned {
    Way way;
    Fault fault;
    int after;
  };

  void run() noexcept;
  void pass(Way way, const std::uint8_t* bytes, std::size_t count, std::vector<std::uint8_t>& passed);
  void send(const std::vector<std::uint8_t>& bytes) const noexcept;

  std::unique_ptr<EmulatedBoard> board_;
  int master_ = -1;
  std::string path_;
  std::mutex plan_;  ///< guards planned_
  std::vector<Planned> planned_;
  std::atomic<bool> silent_{false}, unplugged_{false}, cycle_power_{false}, ending_{false};
  std::thread thread_;
};

}  // namespace haptrace
