// The terms that a tracking force is summed from, and the first of them: the PD law.
#pragma once

#include "control/controller.h"
#include "control/mailbox.h"
#include "control/tuning.h"

namespace haptrace {

/// One summand of a tracking force. A session holds the terms it was composed of and nothing else: a term that is off
/// is not there.
///
/// Real-time: force and start.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  virtual void start(const State& first) noexcept { (void)first; }

  /// This term's force on the hand [N], in W. `reference` is finite.
  [[nodiscard]] virtual Vec3 force(const State& state, const Reference& reference) noexcept = 0;
};

/// Gains for a device of which only its maximum force [N] is known: the force limit is reached at 16 mm of deviation,
/// and kd = 12 ms * kp. For a device of 8 N this is the 500 N/m and 6 N s/m of a cautious playback. Below 200 Hz both
/// shrink with the rate, since the largest stable gain does (Colgate and Schenkel 1997: K < 2 b / T).
PdGains cautious_gains(double max_force, double rate_hz);

/// F = Kp (x_d - x) + Kd (v_d - v)        Basdogan and Srinivasan, Fig. 6.9, with the velocity error in place of the
///                                        error's derivative, so that a quantised position is differentiated once.
///
/// Gains may be changed from one other thread while the law runs: the tick takes the newest without a lock.
class PdLaw final : public ForceTerm {
 public:
  explicit PdLaw(const PdGains& gains) : gains_(gains) {}

  /// From one thread at a time, at any moment. `gains` must be valid.
  void set_gains(const PdGains& gains) noexcept { gains_.post(gains); }

  [[nodiscard]] Vec3 force(const State& state, const Reference& reference) noexcept override {
    const PdGains& g = gains_.latest();
    return g.kp.cwiseProduct(reference.position - state.position) +
           g.kd.cwiseProduct(reference.velocity - state.velocity);
  }

 private:
  Mailbox<PdGains> gains_;
};

}  // namespace haptrace
