// The first term of a tracking force: the PD law.
#pragma once

#include "control/controller.h"
#include "control/force_term.h"
#include "control/tuning.h"

namespace haptrace {

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
