// Keeps a control loop that vibrates from shaking the hand: VibrationMonitor and ReactionLadder for the servo loop.
#pragma once

#include "control/reaction_ladder.h"
#include "control/vibration_monitor.h"

namespace haptrace {

struct ForceGuardOptions {
  VibrationMonitorOptions monitor;
  double max_torque = 0;  ///< of the session; 0: torques are not watched [N m]
};

/// What a session's ForceGuard saw and did.
struct VibrationSummary {
  bool watched = false;                      ///< false when the session sent no force or the guard was off
  double share = 1;                          ///< of the feedback at the end
  double worst_ripple = 0;                   ///< largest rms of the force above 20 Hz over about 50 ms [N]
  double frequency_hz = kNaN;                ///< of the last alarm that took the share down
  double ripple = kNaN;                      ///< of the same alarm [N]
  std::array<int, kVibrationRules> steps{};  ///< steps down, by VibrationRule
  bool ended = false;                        ///< the session ended because the vibration stayed
};

/// Scales the feedback of a controller by the share that ReactionLadder leaves, and watches what was sent.
///
/// Torque: the energy rule of VibrationMonitor alone, against the limit of the torque. Force and torque share one
/// ladder, since they come from one controller.
///
/// Real-time: all but the constructor. Threads: one at a time.
class ForceGuard {
 public:
  /// Throws Error(input) naming the option that is out of its range.
  explicit ForceGuard(const ForceGuardOptions& options);

  /// Returns the wrench to send in place of `asked`, whose part `feedforward` [N] cannot vibrate and stays.
  [[nodiscard]] Wrench soften(const Wrench& asked, const Vec3& feedforward) const noexcept {
    const double share = ladder_.share();
    return {.force = feedforward + share * (asked.force - feedforward), .torque = share * asked.torque};
  }

  /// Takes the wrench that is sent at this tick after all limits, without its feedforward, the position that it
  /// answers, the declared amplitude [N] of an effect that vibrates on purpose, and the time since the tick before.
  /// Returns the event of a step or of a recovery.
  std::optional<Event> watch(const Wrench& sent, const Vec3& position, double declared, double dt) noexcept;

  [[nodiscard]] bool beyond_help() const noexcept { return ladder_.beyond_help(); }
  [[nodiscard]] const VibrationSummary& summary() noexcept;

 private:
  VibrationMonitor monitor_;
  ReactionLadder ladder_;
  std::optional<RippleEnergy> torque_;
  float torque_limit_;  ///< of its rms [N m]
  VibrationSummary summary_;
};

}  // namespace haptrace
