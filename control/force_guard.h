// Protection of the hand from a vibrating control loop: VibrationMonitor and ReactionLadder for the servo loop.
#pragma once

#include "control/reaction_ladder.h"
#include "control/vibration_monitor.h"
#include "control/vibration_summary.h"

namespace haptrace {

struct ForceGuardOptions {
  VibrationMonitorOptions monitor;
  double max_torque = 0;  ///< torque limit of the session; 0: torques are not watched [N m]
};

/// Scales the feedback of a controller by the share from ReactionLadder, and watches the wrench that was sent.
///
/// For the torque, it applies only the energy rule of VibrationMonitor, against the torque limit. Force and torque
/// share one ladder, because they come from one controller.
///
/// Real-time: all but the constructor. Threads: one at a time.
class ForceGuard {
 public:
  /// Throws Error(input) naming the option that is out of its range.
  explicit ForceGuard(const ForceGuardOptions& options);

  /// Returns the wrench to send in place of `asked`. Does not scale `feedforward` [N], the part that cannot vibrate.
  [[nodiscard]] Wrench soften(const Wrench& asked, const Vec3& feedforward) const noexcept {
    return {.force = feedforward + share() * (asked.force - feedforward), .torque = share() * asked.torque};
  }

  /// Tells the guard that other gains compute the feedback from now on. Returns the event of what they get back.
  std::optional<Event> renew() noexcept;

  /// Returns true from a vibration of the feedback until other gains compute it.
  [[nodiscard]] bool vibrated() const noexcept { return ladder_.softened(); }

  /// Returns the share to which soften() scales feedback.
  [[nodiscard]] double share() const noexcept { return ladder_.share(); }

  /// Takes the wrench sent at this tick (after all limits, without its feedforward) and the position that it responds
  /// to. `declared` is the amplitude of an intended vibration [N], `dt` the time since the previous tick [s]. Returns
  /// the event of a step, of a recovery, or of a vibration that persists at the least share.
  std::optional<Event> watch(const Wrench& sent, const Vec3& position, double declared, double dt) noexcept;

  [[nodiscard]] bool beyond_help() const noexcept { return ladder_.beyond_help(); }
  [[nodiscard]] const VibrationSummary& summary() noexcept;

 private:
  VibrationMonitor monitor_;
  ReactionLadder ladder_;
  std::optional<RippleEnergy> torque_;
  float torque_limit_;  ///< limit of the torque's rms [N m]
  VibrationSummary summary_;
};

}  // namespace haptrace
