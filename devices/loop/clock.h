// Clocks of the servo loop: the monotonic clock and virtual time.
#pragma once

#include <cerrno>
#include <cstdint>
#include <ctime>

namespace haptrace {

/// Clock of a servo loop, in integer nanoseconds: no drift in a week, and exact differences.
///
/// Real-time.
class ServoClock {
 public:
  virtual ~ServoClock() = default;
  [[nodiscard]] virtual std::int64_t now() noexcept = 0;
  virtual void wait_until(std::int64_t time_ns) noexcept = 0;
};

inline std::int64_t monotonic_ns() noexcept {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{1'000'000'000} * t.tv_sec + t.tv_nsec;
}

/// CLOCK_MONOTONIC with absolute deadlines.
class MonotonicClock final : public ServoClock {
 public:
  [[nodiscard]] std::int64_t now() noexcept override { return monotonic_ns(); }
  void wait_until(std::int64_t time_ns) noexcept override {
    const timespec t{time_ns / 1'000'000'000, time_ns % 1'000'000'000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
    }
  }
};

/// Advances only when it is waited for: a session runs as fast as the machine allows, and every run is identical.
class VirtualClock final : public ServoClock {
 public:
  [[nodiscard]] std::int64_t now() noexcept override { return now_; }
  void wait_until(std::int64_t time_ns) noexcept override { now_ = time_ns; }

 private:
  std::int64_t now_ = 0;
};

}  // namespace haptrace
