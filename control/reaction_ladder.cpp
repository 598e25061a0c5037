#include "control/reaction_ladder.h"

#include <algorithm>

namespace haptrace {
namespace {

constexpr double kRamp = 0.02;  // duration of a step [s]
constexpr double kFastFactor = 0.3, kFastLeast = 0.05;
constexpr double kFastWait = 0.12;     // [s]
constexpr double kRenewal = 0.5;       // in which other gains get the feedback back [s]
constexpr double kRemainsWait = 0.25;  // [s]: the time over which the monitor looks for a remainder
constexpr double kSlowFactor = 0.5, kSlowLeast = 0.2;
constexpr double kSlowWait = 0.25, kSlowPeriods = 2;  // [s], periods
constexpr double kQuiet = 2, kRecovery = 5;           // [s]
constexpr int kReturns = 3;                           // returns of the hint after which its share stays

EventCode code_of(VibrationRule rule) noexcept {
  switch (rule) {
    case VibrationRule::energy:
      return EventCode::vibrates;
    case VibrationRule::half_cycles:
      return EventCode::vibrates_regularly;
    case VibrationRule::contacts:
      return EventCode::bounces;
    case VibrationRule::torque:
      return EventCode::torque_vibrates;
    case VibrationRule::slow:
      break;
  }
  return EventCode::sways;
}

}  // namespace

bool ReactionLadder::Share::step_down(double factor, double least) noexcept {
  const double lower = std::max(factor * target, least);
  if (!(lower < target)) return false;
  target = lower;
  slope = (share - target) / kRamp;
  since = 0;
  return true;
}

void ReactionLadder::Share::advance(double dt) noexcept {
  since += dt;
  if (share > target) share = std::max(target, share - slope * dt);
  if (share < target) share = std::min(target, share + slope * dt);
}

void ReactionLadder::renew() noexcept {
  if (!softened() || beyond_help_) return;
  fast_.target = 1;
  fast_.slope = (1 - fast_.share) / kRenewal;
}

std::optional<Event> ReactionLadder::event_of(const VibrationAlarm& alarm) noexcept {
  stepped_ = true;
  ++steps_[static_cast<std::size_t>(alarm.rule)];
  return Event{.code = code_of(alarm.rule), .values = {alarm.ripple, alarm.frequency_hz, target()}};
}

std::optional<Event> ReactionLadder::react_to_fast(const VibrationAlarm& alarm) noexcept {
  if (fast_.since < (alarm.remains ? kRemainsWait : kFastWait) || beyond_help_) return std::nullopt;
  if (fast_.step_down(kFastFactor, kFastLeast)) return event_of(alarm);
  if (alarm.remains || alarm.rule == VibrationRule::contacts) return std::nullopt;
  beyond_help_ = true;
  return Event{.code = EventCode::vibration_stays, .values = {alarm.ripple, alarm.frequency_hz, target()}};
}

std::optional<Event> ReactionLadder::react_to_hint(const VibrationAlarm& alarm) noexcept {
  quiet_ = 0;
  if (recovering_) {
    recovering_ = false;
    ++returns_;
  }
  if (slow_.since < slow_wait_ || !slow_.step_down(kSlowFactor, kSlowLeast)) return std::nullopt;
  slow_wait_ = std::max(kSlowWait, kSlowPeriods / alarm.frequency_hz);
  return event_of(alarm);
}

std::optional<Event> ReactionLadder::recover(double dt) noexcept {
  quiet_ += dt;
  if (!(slow_.target < 1) || quiet_ < kQuiet || returns_ >= kReturns) return std::nullopt;
  if (!recovering_) recovery_slope_ = (1 - slow_.target) / kRecovery;
  recovering_ = true;
  slow_.share = slow_.target = std::min(1.0, slow_.target + recovery_slope_ * dt);
  if (slow_.target < 1) return std::nullopt;
  return Event{.code = EventCode::sway_over, .values = {slow_.since, quiet_, target()}};
}

std::optional<Event> ReactionLadder::advance(const std::optional<VibrationAlarm>& alarm, double dt) noexcept {
  fast_.advance(dt);
  slow_.advance(dt);
  if (!alarm) return recover(dt);
  return alarm->rule == VibrationRule::slow ? react_to_hint(*alarm) : react_to_fast(*alarm);
}

}  // namespace haptrace
