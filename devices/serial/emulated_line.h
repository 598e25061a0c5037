// Emulation of a board on a serial line: a pseudo-terminal, and a thread that runs the board.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace haptrace {

/// The behaviour of a board. Only the line's thread calls it.
class EmulatedBoard {
 public:
  virtual ~EmulatedBoard() = default;
  EmulatedBoard() = default;
  EmulatedBoard(const EmulatedBoard&) = delete;
  EmulatedBoard& operator=(const EmulatedBoard&) = delete;

  /// Advances to `now_ns` of the monotonic clock. Called at least a thousand times a second.
  virtual void advance(std::int64_t now_ns) = 0;
  /// Takes a byte and appends the answer to `answer`.
  virtual void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) = 0;
  /// Restarts the board, as if its power failed and came back.
  virtual void power_cycle() = 0;
};

/// Opens a pseudo-terminal, whose name a driver opens as its port. Bytes pass at once, without a baud rate.
///
/// Threads: any. Injected faults act at the next byte or wake-up of the line's thread.
class EmulatedLine {
 public:
  enum class Way : std::uint8_t { to_board, to_host };
  enum class Fault : std::uint8_t { lose_byte, flip_bit, insert_garbage };

  /// Throws Error(device) if no pseudo-terminal is available.
  explicit EmulatedLine(std::unique_ptr<EmulatedBoard> board);
  ~EmulatedLine();
  EmulatedLine(const EmulatedLine&) = delete;
  EmulatedLine& operator=(const EmulatedLine&) = delete;

  [[nodiscard]] const std::string& path() const noexcept { return path_; }

  /// Applies `fault` to the byte after the next `after` bytes.
  void inject(Way way, Fault fault, int after = 0);
  /// Blocks all bytes in both directions while `silent`; the board keeps running.
  void fall_silent(bool silent) noexcept { silent_ = silent; }
  /// Pulls the cable out, for good.
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
