// Energy that a device gives to a hand, and the damping that takes it back.
#pragma once

#include "base/types.h"
#include "control/sent_forces.h"

#include <algorithm>
#include <optional>

namespace haptrace {

/// Computes the energy that a port gives at every tick. With u the force that acted (sent after all limits, `delay`
/// ago) and dx the movement of the hand in the meantime, this energy is u . dx plus the change of the energy in
/// springs. It is exact if the delay is a whole number of ticks, because u is then constant. For a fraction of a tick,
/// the hand is assumed to move evenly within the tick.
///
/// Real-time: all but the constructor.
class EnergyAccount {
 public:
  /// `delay` [s] from a force's sending to its effect, at least 0; `rate_hz` positive.
  EnergyAccount(double delay, double rate_hz) : delay_(delay * rate_hz), sent_(delay_) {}

  /// Forgets the position of the hand; forces that were sent continue to act.
  void begin() noexcept { begun_ = false; }
  /// Forgets the sent forces as well: no force acts.
  void reset() noexcept {
    begin();
    force_.setZero();
    sent_.fill(Vec3::Zero());
  }

  /// Returns the energy given to the hand since the previous tick [J], or nothing at the first tick since begin().
  /// `force` [N] is the port's part of the force sent at the previous tick, and `stored` [J] the energy in springs at
  /// this tick's `position` [m].
  [[nodiscard]] std::optional<double> update(const Vec3& position, const Vec3& force, double stored) noexcept {
    sent_.push(force);
    force_ = sent_.acted(delay_);
    std::optional<double> given;
    if (begun_) given = force_.dot(position - position_) + stored - stored_;
    begun_ = true;
    position_ = position;
    stored_ = stored;
    return given;
  }

  /// States that the springs hold `energy` [J] less, after a change of the springs without work.
  void discard(double energy) noexcept { stored_ -= energy; }

  /// Returns the mean force that acted between the last two ticks [N].
  [[nodiscard]] const Vec3& force() const noexcept { return force_; }

 private:
  double delay_;  ///< [ticks]
  SentForces sent_;
  Vec3 force_ = Vec3::Zero();
  bool begun_ = false;
  Vec3 position_ = Vec3::Zero();  ///< position at the previous tick [m]
  double stored_ = 0;             ///< energy in springs at the previous tick [J]
};

/// Returns the damping [N s/m] that takes `overdrawn` [J] back within a tick from a hand that moves at `velocity`, at
/// most `most`: alpha = E / (T v^2) (Hannaford and Ryu, IEEE Trans. Robotics and Automation 18(1), 2002). Returns 0 if
/// nothing is overdrawn or nothing moves.
inline double recovering_damping(double overdrawn, const Vec3& velocity, double rate_hz, double most) noexcept {
  const double speed2 = velocity.squaredNorm();
  if (!(overdrawn > 0) || !(speed2 > 0)) return 0;
  return std::min(overdrawn * rate_hz / speed2, most);
}

}  // namespace haptrace
