// Monitor of a tracking law that acts on a hand.
#pragma once

#include "control/hand_watch.h"
#include "control/oscillation_monitor.h"

#include <array>
#include <optional>

namespace haptrace {

/// Detects a hand that resists or lets go and, for studies, small oscillations of a loop with known delay. Does not
/// soften the force; the servo loop does (ForceGuard).
///
/// Real-time: all but the constructor.
class TrackingGuard {
 public:
  struct Options {
    std::optional<OscillationMonitorOptions> oscillation;
    HandWatchOptions hand;
  };

  /// Throws Error(input) that names the option that is out of range.
  explicit TrackingGuard(const Options& options) : hand_(options.hand) {
    if (options.oscillation) monitor_.emplace(*options.oscillation);
  }

  /// Called at every tick before its force is sent. `feedback` [N]: part of the last sent force that depends on the
  /// position. The rest is known beforehand and cannot oscillate.
  void watch(const State& state, const Reference& reference, const Vec3& feedback) noexcept;

  /// Resets the monitors after a gap.
  void resume() noexcept {
    if (monitor_) monitor_->reset();
    hand_.reset();
  }

  [[nodiscard]] bool hand_resists() const noexcept { return hand_.resists(); }

  /// Returns the next event to report, if any; one per call.
  std::optional<Event> take_event() noexcept;

 private:
  static constexpr double kSpacing = 0.2;  ///< shortest time between two oscillation events [s]

  std::optional<OscillationMonitor> monitor_;
  double since_told_ = kSpacing;  ///< time since the last oscillation event [s]
  HandWatch hand_;
  std::optional<Event> oscillation_, hand_event_;
};

}  // namespace haptrace
