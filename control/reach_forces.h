// Forces of a reach: a velocity-dependent field, or a channel that keeps the hand on a line.
#pragma once

#include "control/controller.h"
#include "control/energy_account.h"
#include "control/energy_tank.h"
#include "control/limits.h"
#include "control/reaching.h"

#include <optional>

namespace haptrace {

/// Channel between start and target (error clamp: Scheidt and others, J. Neurophysiology 84, 2000; Smith, Ghazizadeh
/// and Shadmehr, PLoS Biology 4(6), 2006).
struct ClampOptions {
  double stiffness = 1000;  ///< [N/m]
  double damping = 3;       ///< of movement across the channel [N s/m]
  double rise = 1.5;        ///< time over which it comes on [s]
  double break_out = 0.03;  ///< distance from the line at which it goes off for the rest of the reach [m]
  bool locks = false;       ///< it also holds the hand along the line, in the start
  double holds = 2;         ///< time for which its force may hold a hand at rest before it decays [s]
};

/// Computes the force of a reach at every tick. With p the position, v the estimated velocity, u the direction of the
/// reach, d = (p - start) - u (u . (p - start)) and v_d = v - u (u . v):
///
///     field   F = g s h sat(B v)
///     clamp   F = -g h sat(k d + b v_d)
///
/// A clamp that locks has d = p - start and v_d = v.
///
/// g is a ramp: the force comes on over `rise` and goes off within kFall, that of a lock within kDecay. sat() limits
/// the magnitude to `max_force` and keeps the direction.
///
/// Energy. A curl field does no work, but the velocity estimate is late: B v(t - tau) of a free mass m that turns at
/// w = |B| / m has the growth rate w^2 tau, so the force does add energy. Other fields add energy by design. An
/// EnergyTank therefore pays for all work on the hand, beyond the energy that the channel's spring held. s is the share
/// that it leaves to the field; damping takes overdrawn energy back. The force gives at most the content of the tank
/// and a tick's work. A channel comes on only as far as the tank pays for the energy in its spring.
///
/// A force that holds decays: after `holds` of a force beyond kHeld on a hand that is slower than kStill, h falls to 0
/// within kDecay. It rises again over `rise` when the hand moves.
///
/// A stale state is no state: at a first tick, after a gap and for values that are not finite, the force is zero.
///
/// Real-time: all but the constructor. Threads: one at a time.
class ReachForces {
 public:
  static constexpr double kFall = 0.2;                   ///< [s]
  static constexpr double kDecay = 1, kHeld = 0.5;       ///< [s], [N]
  static constexpr double kStill = 0.01, kMoves = 0.02;  ///< speeds of a hand at rest, and not [m/s]

  struct Options {
    Eigen::Matrix3d field = Eigen::Matrix3d::Zero();  ///< B, in W [N s/m]; zero: none
    std::optional<ClampOptions> clamp;                ///< instead of the field
    double field_rise = 0.1;                          ///< shorter than a hand takes to react [s]
    double max_force = 5;                             ///< [N]
    double energy = 0.5;                              ///< content of the tank [J]
    double delay = 5e-3;                              ///< from sending a force to its effect [s]
    double rate_hz = 1000;
    double max_damping = 10;  ///< largest damping that takes overdrawn energy back [N s/m]
  };

  /// Throws Error(input) naming the value that is out of its range.
  ReachForces(const ReachGeometry& geometry, const Options& options);

  /// Starts a reach: no force acts, the channel is whole again, and the tank keeps its level.
  void begin() noexcept;

  /// Returns the force on the hand, in W [N]. `acts` turns it on, `share` (0 to 1) scales it. `alone` is false while
  /// another force of the controller acts: its work is not charged.
  [[nodiscard]] Vec3 update(const State& state, bool acts, double share, bool alone) noexcept;

  /// Returns the part of a vector from the start, or of a velocity, that the channel acts on.
  [[nodiscard]] Vec3 off(const Vec3& vector) const noexcept { return vector - along_.dot(vector) * along_; }
  /// Returns the force of the last update [N].
  [[nodiscard]] const Vec3& force() const noexcept { return force_; }
  /// Counts the time for which a force has held a hand at rest anew.
  void hold_anew() noexcept { still_ = 0; }
  /// Returns true while a force that has held a hand for too long decays.
  [[nodiscard]] bool lets_go() const noexcept {
    return still_ >= (options_.clamp ? *options_.clamp : ClampOptions{}).holds;
  }
  /// Returns true if the hand broke out of the channel in this reach.
  [[nodiscard]] bool broken() const noexcept { return broken_; }
  [[nodiscard]] const EnergyTank& tank() const noexcept { return tank_; }
  /// Returns the energy given to the hand, beyond that in the spring [J].
  [[nodiscard]] double given() const noexcept { return given_; }
  [[nodiscard]] const Options& options() const noexcept { return options_; }

 private:
  [[nodiscard]] double stored(const Vec3& position, double gain) const noexcept;
  /// A hand that presses against a lock must not fall forwards when it goes.
  [[nodiscard]] double fall() const noexcept { return options_.clamp && options_.clamp->locks ? kDecay : kFall; }
  [[nodiscard]] double rise() const noexcept { return options_.clamp ? options_.clamp->rise : options_.field_rise; }
  /// Moves the ramps of the gain. Returns the gain.
  double advance(const State& state, bool acts, double share) noexcept;
  [[nodiscard]] Vec3 limited(const Vec3& force) const noexcept;

  ReachGeometry geometry_;
  Vec3 along_;  ///< of the channel's free movement; zero if it locks
  Options options_;
  EnergyTank tank_;
  EnergyAccount account_;
  Ramp on_{0}, holding_{1};
  double gain_ = 0;
  double still_ = 0;           ///< time for which a force has held a hand at rest [s]
  Vec3 force_ = Vec3::Zero();  ///< of the last update [N]
  bool broken_ = false;
  double given_ = 0;
};

}  // namespace haptrace
