#include "control/trigger.h"

#include "base/error.h"
#include "base/number.h"
#include "base/units.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace haptrace {
namespace {

Error not_understood(std::string_view text) {
  return input_error("trigger '" + std::string(text) +
                     "' is not understood; write force>0.5N, speed>0.02m/s (thresholds of at least 0), button or "
                     "button2, or several of them separated by |");
}

}  // namespace

Trigger Trigger::parse(std::string_view text) {
  Trigger trigger;
  for (;;) {
    const std::size_t bar = text.find('|');
    trigger.conditions_.push_back(parse_condition(text.substr(0, bar)));
    if (bar == std::string_view::npos) return trigger;
    text.remove_prefix(bar + 1);
  }
}

Trigger::Condition Trigger::parse_condition(std::string_view text) {
  if (text == "button") return {Quantity::button, 0, ~0U};
  if (text.starts_with("button")) {
    const auto number = number_of<unsigned>(text.substr(6));
    if (!number || *number < 1 || *number > 32) throw not_understood(text);
    return {Quantity::button, 0, 1U << (*number - 1)};
  }
  const std::size_t above = text.find('>');
  if (above == std::string_view::npos) throw not_understood(text);
  const std::string_view name = text.substr(0, above);
  const bool force = name == "force";
  if (!force && name != "speed") throw not_understood(text);
  const std::optional<double> threshold = parse_quantity(text.substr(above + 1), force ? "N" : "m/s");
  if (!threshold || !(*threshold >= 0)) throw not_understood(text);
  return {force ? Quantity::force : Quantity::speed, *threshold, 0};
}

std::optional<Event> Trigger::check(const State& state) const noexcept {
  for (const Condition& condition : conditions_) {
    double value = 0;
    bool fulfilled = false;
    if (condition.quantity == Quantity::button) {
      const std::uint32_t pressed = state.buttons & condition.mask;
      fulfilled = pressed != 0;
      value = pressed;
    } else {
      value = condition.quantity == Quantity::force ? state.force_measured.norm() : state.velocity.norm();
      fulfilled = value > condition.threshold;
    }
    if (fulfilled)
      return Event{.code = EventCode::triggered,
                   .values = {static_cast<double>(condition.quantity), value, condition.threshold}};
  }
  return std::nullopt;
}

bool Trigger::needs_force_sensor() const noexcept {
  return std::any_of(conditions_.begin(), conditions_.end(),
                     [](const Condition& condition) { return condition.quantity == Quantity::force; });
}

}  // namespace haptrace
