// Timer that ends a session if the hand resists.
#pragma once

#include <algorithm>

namespace haptrace {

/// Time for which a hand may resist the force that leads it, and the time if the reference waits for it [s].
inline constexpr double kPatience = 15, kPatienceOfPause = 20;

/// Counts the time for which a demand exceeds the force that the limits allow for long. This is the sign of a force
/// that meets a hand that does not yield. The count falls at half the speed at which it rises, so that shaking the tool
/// does not reset it.
///
/// Real-time.
class ResistanceTimer {
 public:
  static constexpr double kTellAfter = 1;      ///< count from which the resistance is reported [s]
  static constexpr double kForgetting = 0.5;   ///< seconds by which the count falls in a second
  static constexpr double kLongestStep = 0.1;  ///< most that one tick counts: a stall hides the hand [s]

  enum class Verdict { none, begins, over };

  /// Takes one tick, `dt` [s] after the previous one. `held_back`: the limits reduce the force, or the controller
  /// reports resistance. `patience` [s]: the count at which the resistance is over; with 0, nothing counts. Returns
  /// `begins` once for each resistance.
  Verdict update(bool held_back, double patience, double dt) noexcept {
    const double step = std::clamp(dt, 0.0, kLongestStep);
    if (!held_back || !(patience > 0)) {
      count_ = std::max(0.0, count_ - kForgetting * step);
      if (count_ == 0) told_ = false;
      return Verdict::none;
    }
    count_ += step;
    if (count_ >= patience) return Verdict::over;
    if (told_ || count_ < kTellAfter) return Verdict::none;
    told_ = true;
    return Verdict::begins;
  }

  [[nodiscard]] double count() const noexcept { return count_; }  ///< [s]

 private:
  double count_ = 0;
  bool told_ = false;
};

}  // namespace haptrace
