// Histogram of durations with a fixed size: quantiles of a session of any length, without storing its durations.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

namespace haptrace {

/// Counts durations in buckets whose width is at most 1/32 of their value, from 1 ns to 2^40 ns (18 minutes).
///
/// Threads: one at a time. Real-time: record().
class DurationHistogram {
 public:
  /// Records a duration `times` times. A negative duration (from a timer that fired early) counts as zero.
  void record(std::int64_t duration_ns, std::uint64_t times = 1) noexcept {
    if (times == 0) return;
    const auto value = static_cast<std::uint64_t>(std::max<std::int64_t>(duration_ns, 0));
    counts_[bucket(value)] += times;
    count_ += times;
    max_ns_ = std::max(max_ns_, static_cast<std::int64_t>(value));
  }

  /// Adds the durations that `other` recorded.
  void merge(const DurationHistogram& other) noexcept {
    for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += other.counts_[i];
    count_ += other.count_;
    max_ns_ = std::max(max_ns_, other.max_ns_);
  }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }

  /// Returns the exact largest duration [s].
  [[nodiscard]] double max() const noexcept { return 1e-9 * static_cast<double>(max_ns_); }

  /// Returns the duration [s] that a fraction `q` of the recorded durations does not exceed, rounded up by at most
  /// 1/32; 0 if the histogram is empty.
  [[nodiscard]] double quantile(double q) const noexcept {
    if (count_ == 0) return 0;
    const double rank = std::clamp(q, 0.0, 1.0) * static_cast<double>(count_);
    std::uint64_t below = 0;
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      below += counts_[i];
      if (below > 0 && static_cast<double>(below) >= rank) return std::min(1e-9 * static_cast<double>(upper(i)), max());
    }
    return max();
  }

 private:
  static constexpr int kSubBits = 5;  ///< 32 buckets per octave
  static constexpr int kOctaves = 40;
  static constexpr std::uint64_t kSub = 1U << kSubBits;

  // Each value below 2 * kSub has its own bucket. Above, the six most significant bits of the value select the bucket.
  static std::size_t bucket(std::uint64_t value) noexcept {
    const int shift = std::max(0, static_cast<int>(std::bit_width(value)) - kSubBits - 1);
    const auto index = static_cast<std::size_t>(shift) * kSub + static_cast<std::size_t>(value >> shift);
    return std::min(index, std::tuple_size_v<decltype(counts_)> - 1);
  }

  static std::uint64_t upper(std::size_t index) noexcept {
    if (index < 2 * kSub) return index;
    const auto shift = index / kSub - 1;
    return (((index - shift * kSub) + 1) << shift) - 1;
  }

  std::array<std::uint64_t, (kOctaves - kSubBits + 1) * kSub> counts_{};
  std::uint64_t count_ = 0;
  std::int64_t max_ns_ = 0;
};

}  // namespace haptrace
