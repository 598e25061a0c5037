// Sum of time steps.
#pragma once

namespace haptrace {

/// A sum of time steps that is accurate to its last digit for any number of steps: the rounding remainder of each step
/// is added to the next (Kahan 1965). A plain sum of milliseconds is off by tens of microseconds after a day.
///
/// Real-time.
class RunningTime {
 public:
  RunningTime() = default;
  explicit RunningTime(double seconds) noexcept : seconds_(seconds) {}

  [[nodiscard]] double seconds() const noexcept { return seconds_; }

  /// Returns the time `step` [s] later.
  [[nodiscard]] RunningTime after(double step) const noexcept {
    const double whole = step + left_;
    RunningTime later(seconds_ + whole);
    later.left_ = whole - (later.seconds_ - seconds_);
    return later;
  }

 private:
  double seconds_ = 0;
  double left_ = 0;  ///< rounding remainder of the steps so far [s]
};

}  // namespace haptrace
