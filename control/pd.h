// The terms that a tracking force is summed from, and the first of them: the PD law.
#pragma once

#include "control/controller.h"
#include "control/tuning.h"

#include <memory>
#include <vector>

namespace haptrace {

/// What a term is asked with.
struct TermInput {
  const State& state;
  const Reference& reference;  ///< finite, but for its time
  const Tuning& tuning;
  Vec3 before = Vec3::Zero();  ///< the sum of the terms before this one [N]
};

/// One summand of a tracking force. A session holds the terms it was composed of and nothing else: a term that is off
/// is not there. They are asked in their order, each with the sum of those before it.
///
/// Real-time: force and start.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  /// The first state of a session, and the first after a gap in it.
  virtual void start(const State& first) noexcept { (void)first; }

  /// This term's force on the hand [N], in W.
  [[nodiscard]] virtual Vec3 force(const TermInput& input) noexcept = 0;

  /// Whether it answers the position: what oscillates when a loop does. Else it is known beforehand, from the
  /// reference.
  [[nodiscard]] virtual bool feeds_back() const noexcept { return false; }

  /// As for SampleSink: after every tick, outside of it; may wait only where time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

using ForceTerms = std::vector<std::unique_ptr<ForceTerm>>;

/// Gains for a device of which only its maximum force [N] is known: the force limit is reached at 16 mm of deviation,
/// and kd = 12 ms * kp. For a device of 8 N this is the 500 N/m and 6 N s/m of a cautious playback. Below 200 Hz both
/// shrink with the rate, since the largest stable gain does (Colgate and Schenkel 1997: K < 2 b / T).
PdGains cautious_gains(double max_force, double rate_hz);

/// F = Kp (x_d - x) + Kd (v_d - v)        Basdogan and Srinivasan, Fig. 6.9, with the velocity error in place of the
///                                        error's derivative, so that a quantised position is differentiated once.
///
/// Real-time.
inline Vec3 pd_force(const PdGains& gains, const State& state, const Reference& reference) noexcept {
  return gains.kp.cwiseProduct(reference.position - state.position) +
         gains.kd.cwiseProduct(reference.velocity - state.velocity);
}

/// pd_force with the gains of the moment.
class PdLaw final : public ForceTerm {
 public:
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    return pd_force(input.tuning.gains, input.state, input.reference);
  }
};

}  // namespace haptrace
