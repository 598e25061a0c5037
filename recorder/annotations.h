// Marks and pauses that a user adds to a session while it is recorded.
#pragma once

#include "control/sample.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// An event with its text, as a recording stores it.
struct TimedEvent {
  std::int64_t time_ns = 0;  ///< time of the session
  EventCode code = EventCode::mark;
  std::string text;
};

/// Collects marks and pauses from outside the servo loop, for example from keys.
///
/// Threads: all functions from any thread. Real-time: tick() only.
class Annotations {
 public:
  /// Marks the current time, or another time of the session. Text beyond 127 bytes is cut.
  void mark(std::string text) { mark(std::move(text), now()); }
  void mark(std::string text, std::int64_t time_ns) { add({time_ns, EventCode::mark, std::move(text)}); }

  /// Adds an event of any kind.
  void add(TimedEvent event) {
    const std::lock_guard lock(mutex_);
    events_.push_back(event);
    log_.push_back(std::move(event));
    ++count_;
    if (log_.size() > kKept) log_.pop_front();
  }

  /// Stops keeping samples until resume(); the session continues.
  void pause() { add({now(), EventCode::paused, "paused"}); }
  void resume() { add({now(), EventCode::resumed, "resumed"}); }

  /// Notes what a person steers a simulated hand with, see EventCode::input.
  void input(int device, bool depth_from_path) {
    const Event event{.code = EventCode::input,
                      .values = {static_cast<double>(device), depth_from_path ? 1.0 : 0.0, kNaN}};
    add({now(), event.code, describe(event)});
  }

  [[nodiscard]] std::int64_t now() const noexcept { return now_ns_.load(std::memory_order_relaxed); }

  /// Sets the time of the session's newest tick.
  void tick(std::int64_t time_ns) noexcept { now_ns_.store(time_ns, std::memory_order_relaxed); }

  /// Returns the number of events so far, and those from the event of this number on, the last kKept at most. Other
  /// readers than the recorder follow the events with these.
  [[nodiscard]] std::uint64_t count() const {
    const std::lock_guard lock(mutex_);
    return count_;
  }
  [[nodiscard]] std::vector<TimedEvent> from(std::uint64_t number) const {
    const std::lock_guard lock(mutex_);
    const auto wanted =
        static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(count_ - std::min(number, count_), log_.size()));
    return {log_.end() - wanted, log_.end()};
  }

  /// Returns the events since the last call, in order.
  std::vector<TimedEvent> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(events_, {});
  }

  static constexpr std::size_t kKept = 1000;

 private:
  std::atomic<std::int64_t> now_ns_{0};
  mutable std::mutex mutex_;
  std::vector<TimedEvent> events_;  ///< for take()
  std::deque<TimedEvent> log_;      ///< the last ones
  std::uint64_t count_ = 0;
};

}  // namespace haptrace
