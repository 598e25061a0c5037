// What a session may spend: the heat of the motors.
#pragma once

#include "control/limits.h"
#include "control/sample.h"

#include <optional>

namespace haptrace {

/// Tells before the continuous limit of a ForceLimiter takes force away. The limiter's mean square of the force is a
/// first-order thermal model of the motors: what heats them is the current squared, and they cool with its time
/// constant.
///
/// Real-time.
class MotorBudget {
 public:
  static constexpr double kWarnAt = 0.8;   ///< of the heat from which forces are limited
  static constexpr double kCoolAt = 0.64;  ///< below which it may warn again

  /// After limiter.limit() of this tick. `force` [N] is the magnitude that was sent; the time left is told for it.
  std::optional<Event> update(const ForceLimiter& limiter, double force) noexcept {
    const double heat = limiter.heat();
    if (heat < kCoolAt) warned_ = false;
    if (heat < kWarnAt || warned_) return std::nullopt;
    warned_ = true;
    return Event{.code = EventCode::warming, .values = {heat, limiter.time_left(force), kNaN}};
  }

  [[nodiscard]] bool warm() const noexcept { return warned_; }

 private:
  bool warned_ = false;
};

}  // namespace haptrace
