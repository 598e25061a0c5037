// Takes a tracking law down when the loop oscillates.
#pragma once

#include "control/limits.h"
#include "control/oscillation_monitor.h"

#include <optional>

namespace haptrace {

struct GainSoftenerOptions {
  double factor = 0.5;       ///< that every step takes the share down by, in (0, 1)
  double least = 0.05;       ///< share that is never gone below, in (0, 1]
  double ramp = 0.02;        ///< over which a step acts [s]
  double wait = 0.2;         ///< from one step to the next at least: the monitor's window has to see what it did [s]
  double recover_after = 0;  ///< time without a verdict from which the share grows again [s]; 0: it stays soft
  double recover_time = 10;  ///< in which it would grow from nothing to all [s]
};

/// Throws Error(input) naming the option that is out of its range.
void validate(const GainSoftenerOptions& options);

/// The share of a tracking law's feedback that may act: 1, halved within 20 ms by the first verdict of the monitor, and
/// again for as long as the loop goes on oscillating. Scaling the whole law takes down stiffness and damping alike,
/// which is right for both ways in which a loop becomes unstable: a stiffness too high for its damping, and a damping
/// too high for its delay. By default what was taken is not given back within the session: gains that oscillated once
/// will do so again.
///
/// Real-time: all but the constructor. Threads: one at a time.
class GainSoftener {
 public:
  /// Throws what validate throws.
  explicit GainSoftener(const GainSoftenerOptions& options = {});

  /// Takes what the monitor says at this tick, `dt` [s] after the one before. Answers the event to tell when a step
  /// down begins (oscillation), or once when the loop oscillates with the least share (oscillation_stays).
  std::optional<Event> update(const std::optional<OscillationVerdict>& verdict, double dt) noexcept;

  /// To multiply the law's feedback by.
  [[nodiscard]] double share() const noexcept { return share_; }
  /// True when the least share did not end the oscillation: then only an end of the session does.
  [[nodiscard]] bool exhausted() const noexcept { return exhausted_; }

 private:
  GainSoftenerOptions options_;
  double share_ = 1, target_ = 1;
  double step_ = 0;           ///< of the share in the present ramp
  double since_step_ = 0;     ///< [s]
  double since_verdict_ = 0;  ///< [s]
  bool exhausted_ = false;
};

}  // namespace haptrace
