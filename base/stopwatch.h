// Time that has passed.
#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>

namespace haptrace {

/// Returns the time between two readings of the monotonic clock [s]. Real-time.
inline double seconds_between(std::chrono::steady_clock::time_point from,
                              std::chrono::steady_clock::time_point to) noexcept {
  return std::chrono::duration<double>(to - from).count();
}

/// Measures the time since its construction with the monotonic clock. Real-time.
class Stopwatch {
 public:
  /// Returns the time since the construction [s].
  [[nodiscard]] double seconds() const noexcept { return seconds_between(began_, std::chrono::steady_clock::now()); }

 private:
  std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
};

/// Measures the processor time that this thread, or the whole process, has used since its construction. Real-time.
class CpuStopwatch {
 public:
  enum class Of : std::uint8_t { thread, process };
  explicit CpuStopwatch(Of of) noexcept
      : clock_(of == Of::thread ? CLOCK_THREAD_CPUTIME_ID : CLOCK_PROCESS_CPUTIME_ID), began_(now()) {}

  /// Returns the processor time since the construction [s].
  [[nodiscard]] double seconds() const noexcept { return now() - began_; }

 private:
  [[nodiscard]] double now() const noexcept {
    timespec t{};
    clock_gettime(clock_, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  }

  clockid_t clock_;
  double began_;
};

}  // namespace haptrace
