// Marks and pauses that a user adds to a session while it is recorded.
#pragma once

#include "control/sample.h"

#include <atomic>
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

  /// Stops keeping samples until resume(); the session continues.
  void pause() { add({now(), EventCode::paused, "paused"}); }
  void resume() { add({now(), EventCode::resumed, "resumed"}); }

  [[nodiscard]] std::int64_t now() const noexcept { return now_ns_.load(std::memory_order_relaxed); }

  /// Sets the time of the session's newest tick.
  void tick(std::int64_t time_ns) noexcept { now_ns_.store(time_ns, std::memory_order_relaxed); }

  /// Returns the events since the last call, in order.
  std::vector<TimedEvent> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(events_, {});
  }

 private:
  void add(TimedEvent event) {
    const std::lock_guard lock(mutex_);
    events_.push_back(std::move(event));
  }

  std::atomic<std::int64_t> now_ns_{0};
  std::mutex mutex_;
  std::vector<TimedEvent> events_;
};

}  // namespace haptrace
