// What starts a recording: the hand pushes, moves, or presses a button.
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
  /// Reads alternatives, separated by '|': "force>0.5N", "speed>0.02" (m/s; m may stand before both units), "button"
  /// (any) and "button2" (the second). Force is what the device's sensor measures. Throws Error(input) naming the
  /// alternative.
  static Trigger parse(std::string_view text);

  /// The event `triggered` of the condition that is fulfilled, if one is.
  [[nodiscard]] std::optional<Event> check(const State& state) const noexcept;

  [[nodiscard]] bool needs_force_sensor() const noexcept;

 private:
  enum class Quantity : std::uint8_t { force, speed, button };  // the numbers are in files: see EventCode::triggered
  struct Condition {
    Quantity quantity;
    double threshold;    ///< [N] or [m/s]
    std::uint32_t mask;  ///< of buttons
  };
  static Condition parse_condition(std::string_view text);

  std::vector<Condition> conditions_;
};

}  // namespace haptrace
