// Looks after a tracking law while it acts on a person.
#pragma once

#include "control/hand_watch.h"
#include "control/oscillation_monitor.h"

#include <array>
#include <optional>

namespace haptrace {

/// Notices a hand that resists or lets go and, for studies, small oscillations of a loop whose delay is known. It
/// softens nothing: the servo loop does (ForceGuard).
///
/// Real-time: all but the constructor.
class TrackingGuard {
 public:
  struct Options {
    std::optional<OscillationMonitorOptions> oscillation;
    HandWatchOptions hand;
  };

  /// Throws Error(input) naming the option that is out of its range.
  explicit TrackingGuard(const Options& options) : hand_(options.hand) {
    if (options.oscillation) monitor_.emplace(*options.oscillation);
  }

  /// At every tick, before its force is sent. `feedback` [N]: what of the force that was sent last answers the
  /// position; the rest is known beforehand and cannot oscillate.
  void watch(const State& state, const Reference& reference, const Vec3& feedback) noexcept;

  /// After a gap: what was seen before it says nothing of what comes.
  void resume() noexcept {
    if (monitor_) monitor_->reset();
    hand_.reset();
  }

  [[nodiscard]] bool hand_resists() const noexcept { return hand_.resists(); }

  /// The next thing to tell, if any: one for each call.
  std::optional<Event> take_event() noexcept;

 private:
  static constexpr double kSpacing = 0.2;  ///< between two events of an oscillation [s]

  std::optional<OscillationMonitor> monitor_;
  double since_told_ = kSpacing;  ///< of an oscillation [s]
  HandWatch hand_;
  std::optional<Event> oscillation_, hand_event_;
};

}  // namespace haptrace
