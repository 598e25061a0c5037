// Request to stop a session or computation.
#pragma once

#include <atomic>
#include <cstdint>

namespace haptrace {

/// The cause of a request to stop.
enum class StopSource : std::uint8_t {
  user,       ///< a signal, a key, or the program itself
  page,       ///< a page of the live view
  lost_page,  ///< the controlling page fell silent, and that was to stop the session
  command,    ///< a command to the running session
};

/// A request from outside to stop a running session. May be raised in a signal handler.
class StopRequest {
 public:
  StopRequest() noexcept : StopRequest(nullptr) {}
  /// Includes the requests to `also`, which must outlive this object.
  explicit StopRequest(const StopRequest* also) noexcept : also_(also) {}

  /// Adds a request. After the first, the force fades out and the session ends; after the second, it ends at this tick.
  void raise(StopSource source = StopSource::user) noexcept {
    if (count_.load(std::memory_order_relaxed) == 0) source_.store(source, std::memory_order_relaxed);
    count_.fetch_add(1, std::memory_order_release);
  }
  [[nodiscard]] int count() const noexcept {
    return count_.load(std::memory_order_acquire) + (also_ != nullptr ? also_->count() : 0);
  }
  /// Returns what asked first, once count() is above 0.
  [[nodiscard]] StopSource source() const noexcept {
    const bool ours = also_ == nullptr || count_.load(std::memory_order_acquire) > 0;
    return ours ? source_.load(std::memory_order_relaxed) : also_->source();
  }

 private:
  const StopRequest* also_;
  std::atomic<int> count_{0};
  std::atomic<StopSource> source_{StopSource::user};
  static_assert(std::atomic<int>::is_always_lock_free);
};

}  // namespace haptrace
