// Looks after a tracking law while it acts on a person.
#pragma once

#include "control/gain_softener.h"
#include "control/hand_watch.h"
#include "control/oscillation_monitor.h"

#include <array>
#include <optional>

namespace haptrace {

/// Softens a law that makes the loop oscillate, and notices a hand that resists or lets go.
///
/// Real-time: all but the constructor.
class TrackingGuard {
 public:
  struct Options {
    OscillationMonitorOptions oscillation;
    HandWatchOptions hand;
  };

  /// Throws Error(input) naming the option that is out of its range.
  explicit TrackingGuard(const Options& options) : monitor_(options.oscillation), hand_(options.hand) {}

  /// At every tick, before its force is sent. `feedback` [N]: what of the force that was sent last answers the
  /// position; the rest is known beforehand and cannot oscillate.
  void watch(const State& state, const Reference& reference, const Vec3& feedback) noexcept;

  /// After a gap: what was seen before it says nothing of what comes. What was softened stays soft.
  void resume() noexcept {
    monitor_.reset();
    hand_.reset();
  }

  /// What of the feedback may act, 0 to 1.
  [[nodiscard]] double share() const noexcept { return softener_.share(); }
  /// The loop oscillates although next to nothing of the force is left.
  [[nodiscard]] bool beyond_help() const noexcept { return softener_.exhausted(); }
  /// The next thing to tell, if any: one for each call.
  std::optional<Event> take_event() noexcept;

 private:
  OscillationMonitor monitor_;
  GainSoftener softener_;
  HandWatch hand_;
  std::optional<Event> oscillation_, hand_event_;
};

}  // namespace haptrace
