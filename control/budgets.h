// Warning before the motors reach their thermal limit.
#pragma once

#include "control/limits.h"
#include "control/sample.h"

#include <optional>

namespace haptrace {

/// Warns before the continuous limit of a ForceLimiter reduces the force. The limiter's mean square of the force is a
/// first-order thermal model of the motors: the squared current heats them, and they cool with its time constant.
///
/// Real-time.
class MotorBudget {
 public:
  static constexpr double kWarnAt = 0.8;   ///< share of the heat at which the limiter begins to reduce forces
  static constexpr double kCoolAt = 0.64;  ///< share below which it may warn again

  /// Returns a warning when the heat reaches kWarnAt. Call it after limiter.limit() of this tick. `force` [N] is the
  /// magnitude that was sent; the time left in the warning applies to this force.
  std::optional<Event> update(const ForceLimiter& limiter, double force) noexcept {
    const double heat = limiter.heat();
    if (heat < kCoolAt) warned_ = false;
    if (heat < kWarnAt || warned_) return std::nullopt;
    warned_ = true;
    return Event{.code = EventCode::warming, .values = {heat, limiter.time_left(force), kNaN}};
  }

 private:
  bool warned_ = false;
};

}  // namespace haptrace
