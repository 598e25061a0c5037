// Minimum-jerk approach to a position.
#pragma once

#include "control/controller.h"
#include "control/path/min_jerk.h"

#include <algorithm>

namespace haptrace {

/// Minimum-jerk movement between two positions at a bounded peak speed. Lasts at least kShortest.
///
/// Real-time.
class Approach {
 public:
  static constexpr double kShortest = 0.3;  ///< [s]

  Approach() = default;
  /// `from` and `to` [m], `peak_speed` [m/s], shortest duration `shortest` [s].
  Approach(const Vec3& from, const Vec3& to, double peak_speed, double shortest = kShortest) noexcept
      : from_(from),
        way_(to - from),
        duration_(std::max({kShortest, shortest, MinJerk::kPeakSpeed * way_.norm() / peak_speed})) {}

  [[nodiscard]] double duration() const noexcept { return duration_; }  ///< [s]

  /// Returns the reference `elapsed` [s] after the start.
  [[nodiscard]] Reference at(double elapsed) const noexcept {
    const MinJerk blend = MinJerk::at(elapsed / duration_);
    return {.position = from_ + blend.s * way_,
            .velocity = blend.ds / duration_ * way_,
            .acceleration = blend.dds / (duration_ * duration_) * way_};
  }

 private:
  Vec3 from_ = Vec3::Zero(), way_ = Vec3::Zero();
  double duration_ = kShortest;
};

}  // namespace haptrace
