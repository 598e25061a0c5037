// The current place of a servo thread.
#pragma once

#include <atomic>
#include <cstdint>

namespace haptrace {

/// Tells another thread whether ticks continue and, if one hangs, where it hangs.
///
/// Threads: at() in the servo thread only, the others in any thread. Real-time: one store.
class TickPulse {
 public:
  enum class Place : std::uint8_t { outside, device, controller, sinks };

  void at(Place place) noexcept {
    count_ += kPlaces;
    beat_.store(count_ | static_cast<std::uint64_t>(place), std::memory_order_relaxed);
  }

  /// Returns a value that changes with every call of at().
  [[nodiscard]] std::uint64_t beat() const noexcept { return beat_.load(std::memory_order_relaxed); }
  [[nodiscard]] static Place place_of(std::uint64_t beat) noexcept { return static_cast<Place>(beat % kPlaces); }

 private:
  static constexpr std::uint64_t kPlaces = 4;

  std::uint64_t count_ = 0;
  std::atomic<std::uint64_t> beat_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

}  // namespace haptrace
