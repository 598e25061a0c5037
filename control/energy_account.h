// What a device gave to a hand, and how to take it back.
#pragma once

#include "control/controller.h"
#include "control/sent_forces.h"

#include <algorithm>
#include <optional>

namespace haptrace {

/// The account of a port, every tick: with u the force that acted (sent after all limits, `delay` ago) and dx what the
/// hand moved meanwhile, u . dx plus the change of what springs hold is what was given. It is exact while the delay is
/// whole ticks, for u is constant then; a part of a tick counts as if the hand moved evenly within one.
///
/// Real-time: all but the constructor.
class EnergyAccount {
 public:
  /// `delay` [s] from a force's sending to its effect, at least 0; `rate_hz` positive.
  EnergyAccount(double delay, double rate_hz) : delay_(delay * rate_hz), sent_(delay_) {}

  /// Forgets where the hand was; what was sent goes on acting.
  void begin() noexcept { begun_ = false; }
  /// Forgets what was sent, too: no force acts.
  void reset() noexcept {
    begin();
    force_.setZero();
    sent_.fill(Vec3::Zero());
  }

  /// Given to the hand since the tick before [J], with `stored` [J] held by springs at this tick's position. Nothing at
  /// the first tick since begin().
  [[nodiscard]] std::optional<double> update(const State& state, double stored) noexcept {
    sent_.push(state.force_applied);
    force_ = sent_.acted(delay_);
    std::optional<double> given;
    if (begun_) given = force_.dot(state.position - position_) + stored - stored_;
    begun_ = true;
    position_ = state.position;
    stored_ = stored;
    return given;
  }

  /// The mean force that acted between the last two ticks [N].
  [[nodiscard]] const Vec3& force() const noexcept { return force_; }

 private:
  double delay_;  ///< [ticks]
  SentForces sent_;
  Vec3 force_ = Vec3::Zero();
  bool begun_ = false;
  Vec3 position_ = Vec3::Zero();  ///< at the tick before [m]
  double stored_ = 0;             ///< then [J]
};

/// Damping [N s/m] that takes `overdrawn` [J] back within a tick from a hand that moves at `velocity`, and no more than
/// `most`: alpha = E / (T v^2) (Hannaford and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). None when nothing
/// is overdrawn or nothing moves.
inline double recovering_damping(double overdrawn, const Vec3& velocity, double rate_hz, double most) noexcept {
  const double speed2 = velocity.squaredNorm();
  if (!(overdrawn > 0) || !(speed2 > 0)) return 0;
  return std::min(overdrawn * rate_hz / speed2, most);
}

}  // namespace haptrace
