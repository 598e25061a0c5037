// Stepwise softening of the feedback of a vibrating control loop.
#pragma once

#include "control/sample.h"
#include "control/vibration_monitor.h"

#include <array>
#include <optional>

namespace haptrace {

/// Computes the share of the feedback that may act, from the alarms of VibrationMonitor.
///
/// Scaling the whole law reduces stiffness and damping alike. That is right for both ways in which a loop becomes
/// unstable: a stiffness too high for its damping, and a damping too high for its delay.
///
/// A fast alarm (energy, half_cycles, contacts, torque) reduces the share to 0.3 of itself within 20 ms, and again
/// after 120 ms for as long as alarms arrive, to no less than 0.05. If an alarm arrives at 0.05, softening cannot help,
/// and the session must end; contacts alone do not end one. A remainder of a vibration 0.25 s after a step reduces the
/// share as well, but does not end the session. This share does not recover: gains that vibrated once will do so again.
/// Only other gains get it back, over 0.5 s; see renew().
///
/// The slow hint halves a share of its own, which never ends a session, waits for max(0.25 s, 2 periods), and stops at
/// 0.2. After 2 s without a hint it recovers over 5 s; after three returns of the hint it stays. All of this can be
/// undone, because the hand may have caused it.
///
/// Real-time. Threads: one at a time.
class ReactionLadder {
 public:
  /// Takes the alarm of this tick, `dt` [s] after the previous one. Returns an event for each step, for the end of a
  /// recovery, and for a vibration that softening cannot stop.
  std::optional<Event> update(const std::optional<VibrationAlarm>& alarm, double dt) noexcept {
    if (!alarm && !stepped_) return std::nullopt;
    return advance(alarm, dt);
  }

  /// Gives back the share that fast alarms took: from now on, other gains compute the feedback. Does nothing if none
  /// was taken, or if softening could not help.
  void renew() noexcept;

  /// Returns the factor on the feedback.
  [[nodiscard]] double share() const noexcept { return fast_.share * slow_.share; }
  /// Returns the share at the end of a running ramp.
  [[nodiscard]] double target() const noexcept { return fast_.target * slow_.target; }
  /// Returns true after the first step for a fast alarm.
  [[nodiscard]] bool softened() const noexcept { return fast_.target < 1; }
  /// Returns true if the loop vibrates although almost no feedback is left.
  [[nodiscard]] bool beyond_help() const noexcept { return beyond_help_; }
  /// Returns the number of steps by VibrationRule.
  [[nodiscard]] const std::array<int, kVibrationRules>& steps() const noexcept { return steps_; }

 private:
  struct Share {
    double share = 1, target = 1;
    double slope = 0;    ///< rate of a step down, or of a renewal [1/s]
    double since = 1e9;  ///< time since the last step [s]
    /// Returns true if the share goes down.
    bool step_down(double factor, double least) noexcept;
    void advance(double dt) noexcept;
  };

  std::optional<Event> advance(const std::optional<VibrationAlarm>& alarm, double dt) noexcept;
  std::optional<Event> react_to_fast(const VibrationAlarm& alarm) noexcept;
  std::optional<Event> react_to_hint(const VibrationAlarm& alarm) noexcept;
  std::optional<Event> recover(double dt) noexcept;
  [[nodiscard]] std::optional<Event> event_of(const VibrationAlarm& alarm) noexcept;

  Share fast_, slow_;
  double slow_wait_ = 0;       ///< wait before the next step of the hint [s]
  double quiet_ = 0;           ///< time since the last hint [s]
  double recovery_slope_ = 0;  ///< [1/s]
  int returns_ = 0;
  bool stepped_ = false;  ///< true after the first step
  bool recovering_ = false;
  bool beyond_help_ = false;
  std::array<int, kVibrationRules> steps_{};
};

}  // namespace haptrace
