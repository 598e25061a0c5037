// Request to stop a session or computation.
#pragma once

#include <atomic>

namespace haptrace {

/// A request from outside to stop a running session. May be raised in a signal handler.
class StopRequest {
 public:
  StopRequest() noexcept : StopRequest(nullptr) {}
  /// Includes the requests to `also`, which must outlive this object.
  explicit StopRequest(const StopRequest* also) noexcept : also_(also) {}

  /// Adds a request. After the first, the force fades out and the session ends; after the second, it ends at this tick.
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
