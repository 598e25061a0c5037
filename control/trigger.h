// Triggers that start a recording when the hand pushes, moves or presses a button.
#pragma once

#include "control/controller.h"

#include <optional>
#include <string_view>
#include <vector>

namespace haptrace {

/// Fires at the first state that fulfils any of its conditions.
///
/// Real-time: check.
class Trigger {
 public:
  /// Parses alternatives separated by '|': "force>0.5N", "speed>0.02" (m/s; other units as in parse_quantity), "button"
  /// (any) and "button2" (the second). The force is the value of the device's sensor. Throws Error(input) naming the
  /// alternative.
  static Trigger parse(std::string_view text);

  /// Returns the event `triggered` of the first condition that is fulfilled, if any.
  [[nodiscard]] std::optional<Event> check(const State& state) const noexcept;

  [[nodiscard]] bool needs_force_sensor() const noexcept;

 private:
  enum class Quantity : std::uint8_t { force, speed, button };  // files store these numbers: see EventCode::triggered
  struct Condition {
    Quantity quantity;
    double threshold;    ///< [N] or [m/s]
    std::uint32_t mask;  ///< mask of buttons
  };
  static Condition parse_condition(std::string_view text);

  std::vector<Condition> conditions_;
};

}  // namespace haptrace
