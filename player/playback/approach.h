// The way to where a session goes on.
#pragma once

#include "control/controller.h"
#include "control/path/min_jerk.h"

#include <algorithm>

namespace haptrace {

/// A minimum-jerk movement from one place to another at a bounded peak speed, never shorter than kShortest.
///
/// Real-time.
class Approach {
 public:
  static constexpr double kShortest = 0.3;  ///< [s]

  Approach() = default;
  /// From and to [m], peak speed [m/s]; lasts at least `shortest` [s].
  Approach(const Vec3& from, const Vec3& to, double peak_speed, double shortest = kShortest) noexcept
      : from_(from),
        way_(to - from),
        duration_(std::max({kShortest, shortest, MinJerk::kPeakSpeed * way_.norm() / peak_speed})) {}

  [[nodiscard]] double duration() const noexcept { return duration_; }  ///< [s]

  /// At `elapsed` [s] since its beginning.
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
