// Terms that sum to a tracking force, and the first of them: the PD law.
#pragma once

#include "control/controller.h"
#include "control/tuning.h"

#include <memory>
#include <vector>

namespace haptrace {

/// Input of a force term.
struct TermInput {
  const State& state;
  const Reference& reference;  ///< finite, except its time
  const Tuning& tuning;
  Vec3 before = Vec3::Zero();  ///< sum of the terms before this one [N]
};

/// One summand of a tracking force. A session holds only the terms that it is composed of; a term that is off is
/// absent. The session calls the terms in their order, each with the sum of the terms before it.
///
/// Real-time: force and start.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  /// Called with the first state of a session, and with the first state after a gap in it.
  virtual void start(const State& first) noexcept { (void)first; }

  /// Returns this term's force on the hand [N], in W.
  [[nodiscard]] virtual Vec3 force(const TermInput& input) noexcept = 0;

  /// Returns the stiffness and damping of the last force; zero for a term that does not respond to the position.
  ///
  /// Real-time.
  [[nodiscard]] virtual PdGains gains(const Tuning& tuning) const noexcept {
    (void)tuning;
    return {};
  }

  /// Returns true if the term responds to the position, and thus oscillates when the loop does. Otherwise its force is
  /// known beforehand, from the reference.
  [[nodiscard]] virtual bool feeds_back() const noexcept { return false; }

  /// Called after every tick, outside of it, like SampleSink::between_ticks. May wait only if `may_wait` is set, that
  /// is, if time stands still meanwhile.
  virtual void between_ticks(bool may_wait) noexcept { (void)may_wait; }
};

using ForceTerms = std::vector<std::unique_ptr<ForceTerm>>;

/// Returns gains for a device of which only the maximum force [N] is known: the force reaches its limit at 16 mm of
/// deviation, and kd = 12 ms * kp. For a device of 8 N these are the 500 N/m and 6 N s/m of a cautious playback. Below
/// 200 Hz both gains shrink with the rate, like the largest stable gain (Colgate and Schenkel 1997: K < 2 b / T).
PdGains cautious_gains(double max_force, double rate_hz);

/// Returns F = Kp (x_d - x) + Kd (v_d - v) [N] (Basdogan and Srinivasan, Fig. 6.9). The velocity error replaces the
/// error's derivative, so that a quantised position is differentiated once.
///
/// Real-time.
inline Vec3 pd_force(const PdGains& gains, const State& state, const Reference& reference) noexcept {
  return gains.kp.cwiseProduct(reference.position - state.position) +
         gains.kd.cwiseProduct(reference.velocity - state.velocity);
}

/// Applies pd_force() with the current gains.
class PdLaw final : public ForceTerm {
 public:
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override {
    return pd_force(input.tuning.gains, input.state, input.reference);
  }
  [[nodiscard]] PdGains gains(const Tuning& tuning) const noexcept override { return tuning.gains; }
};

}  // namespace haptrace
