// Exchange of the newest value between two threads, without locks and without waiting.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace haptrace {

/// A triple buffer: the writer always has a free slot, and the reader always has a complete value. A newer value
/// replaces one that the reader has not fetched in time.
///
/// Threads: one writer (post), one reader (latest). Real-time: both are wait-free and copy one T.
template <class T>
class Mailbox {
 public:
  explicit Mailbox(const T& initial = T{}) : slots_{initial, initial, initial} {}

  void post(const T& value) noexcept {
    slots_[write_] = value;
    write_ = middle_.exchange(static_cast<std::uint8_t>(write_ | kFresh), std::memory_order_acq_rel) & kIndex;
  }

  /// Returns the newest value; the reference is valid until the next call.
  const T& latest() noexcept {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) != 0)
      read_ = middle_.exchange(read_, std::memory_order_acq_rel) & kIndex;
    return slots_[read_];
  }

 private:
  static constexpr std::uint8_t kIndex = 3, kFresh = 4;

  std::array<T, 3> slots_;
  std::uint8_t write_ = 0;
  std::atomic<std::uint8_t> middle_{1};
  std::uint8_t read_ = 2;
};

}  // namespace haptrace
