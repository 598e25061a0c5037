// A request to end what is running.
#pragma once

#include <atomic>

namespace haptrace {

/// How a session is asked to stop from outside. May be raised in a signal handler.
class StopRequest {
 public:
  StopRequest() noexcept : StopRequest(nullptr) {}
  /// Counts the requests to `also` as well; `also` must outlive this.
  explicit StopRequest(const StopRequest* also) noexcept : also_(also) {}

  /// Once: the force fades out and the session ends. Twice: it ends at this tick.
  void raise() noexcept { count_.fetch_add(1, std::memory_order_relaxed); }
  [[nodiscard]] int count() const noexcept {
    return count_.load(std::memory_order_relaxed) + (also_ != nullptr ? also_->count() : 0);
  }

 private:
  const StopRequest* also_;
  std::atomic<int> count_{0};
  static_assert(std::atomic<int>::is_always_lock_free);
};

}  // namespace haptrace
