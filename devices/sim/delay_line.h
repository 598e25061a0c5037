// A delay line for motor commands.
#pragma once

#include "base/types.h"

#include <cstdint>
#include <limits>
#include <vector>

namespace haptrace {

/// Delays each command by a fixed time. If several commands are given at one instant, the last one counts.
///
/// Allocates only when constructed.
class DelayLine {
 public:
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  /// Has room for one command every 50 us. If commands come faster, the newest replaces the previous one.
  explicit DelayLine(std::int64_t delay_ns)
      : delay_(delay_ns), ring_(static_cast<std::size_t>(delay_ns / 50'000 + 2)) {}

  void push(std::int64_t now, const Vec3& command) noexcept {
    if (count_ < ring_.size()) ++count_;
    at(count_ - 1) = {now + delay_, command};
    arrive(now);
  }

  /// Returns the time at which the output changes next [ns], or kNever.
  [[nodiscard]] std::int64_t next() const noexcept { return count_ > 0 ? ring_[first_].due : kNever; }

  void arrive(std::int64_t now) noexcept {
    while (count_ > 0 && ring_[first_].due <= now) {
      output_ = ring_[first_].command;
      first_ = (first_ + 1) % ring_.size();
      --count_;
    }
  }

  [[nodiscard]] const Vec3& output() const noexcept { return output_; }

 private:
  struct Entry {
    std::int64_t due = 0;  ///< [ns]
    Vec3 command = Vec3::Zero();
  };

  Entry& at(std::size_t i) noexcept { return ring_[(first_ + i) % ring_.size()]; }

  std::int64_t delay_;
  std::vector<Entry> ring_;
  std::size_t first_ = 0, count_ = 0;
  Vec3 output_ = Vec3::Zero();
};

}  // namespace haptrace
