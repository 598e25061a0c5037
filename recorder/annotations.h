// What a person has to say about a session while it is recorded.
#pragma once

#include "control/sample.h"

#include <atomic>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// An event whose text is known: what a recording keeps.
struct TimedEvent {
  std::int64_t time_ns = 0;  ///< of the session
  EventCode code = EventCode::mark;
  std::string text;
};

/// Marks and pauses from outside of the servo loop, from keys for example.
///
/// Threads: everything from any. Real-time: tick() only.
class Annotations {
 public:
  /// Marks the present instant, or another of the session's. Text beyond 127 bytes is cut.
  void mark(std::string text) { mark(std::move(text), now()); }
  void mark(std::string text, std::int64_t time_ns) { add({time_ns, EventCode::mark, std::move(text)}); }

  /// From now on, until resume(), samples are not kept; the session goes on.
  void pause() { add({now(), EventCode::paused, "paused"}); }
  void resume() { add({now(), EventCode::resumed, "resumed"}); }

  [[nodiscard]] std::int64_t now() const noexcept { return now_ns_.load(std::memory_order_relaxed); }

  /// The session's newest tick.
  void tick(std::int64_t time_ns) noexcept { now_ns_.store(time_ns, std::memory_order_relaxed); }

  /// What was said since the last call, in order.
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
