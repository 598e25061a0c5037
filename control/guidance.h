// Guidance: forces that keep a trainee near an expert's path, and reproduce the expert's forces there.
#pragma once

#include "control/energy_account.h"
#include "control/energy_tank.h"
#include "control/guide_term.h"
#include "control/walked_set.h"
#include "control/wall_release.h"

namespace haptrace {

/// Sums its terms. An energy tank limits the energy that the active ones give.
///
/// An EnergyAccount measures the energy given to the hand. A spring that is sampled and late gives more than it held:
/// the excess is charged like any other energy, and damping takes it back when the tank is overdrawn. The allowance of
/// the path (GuideTerm::allowance) is credited where it is walked for the first time, over no more than the distance
/// that the hand moved. In cursor mode, the work of the cursor's drag is credited too. Over any session this gives
///
///     given to the hand  <=  energy + allowances of the path + work of the cursor's drag.
///
/// The terms can be retuned while they act. Every value approaches its target by all but 2 % of the difference in
/// 0.2 s. A narrower or stiffer wall holds more energy at the same depth, which it would give to the hand: the account
/// charges the difference to the tank, and such a change waits while the tank does not hold enough.
///
/// The same holds when the plausible tunnels change (PlaceTracker). If the springs hold less energy at the same
/// position of the hand, the difference is discarded and never credited. If they hold more, the walls continue with a
/// share that holds the same energy, and the share rises to 1 within 0.3 s, as far as the tank pays. If their force
/// would make a step, WallRelease takes it over, and the walls begin without force.
///
/// Real-time: all but the constructor. Threads: one at a time.
class Guidance {
 public:
  struct Options {
    double energy = 0.3;       ///< capacity of the tank [J]
    double gate_width = 2e-3;  ///< depth beyond the radius at which the gate is closed, or the radius if larger [m]
    double delay = 1e-3;       ///< time from sending a force to its effect [s]
    double rate_hz = 1000;
    double max_damping = 10;  ///< largest damping that takes overdrawn energy back [N s/m]
  };

  /// Throws Error(input) naming the option that is out of range, and if no term restores the position: replayed forces
  /// without such a term drift away. An empty list of terms leaves the hand alone.
  Guidance(GuideTerms terms, const Options& options);

  /// Restarts at the start of the path: its allowances may be earned again, and the tank keeps its level.
  void begin() noexcept {
    account_.begin();
    walked_.clear();
    release_ = {};
    spring_.setZero();
  }

  /// Sets the tuning that the terms approach from now on; with `at_once`, they have it now. Values must be finite.
  void tune(const GuideTuning& target, bool at_once = false) noexcept {
    target_ = target;
    if (at_once) tuning_ = target;
  }
  /// Approaches the tuning for `dt` [s] in which the terms do not act.
  void rest(double dt) noexcept;
  /// Returns the tuning in force.
  [[nodiscard]] const GuideTuning& tuning() const noexcept { return tuning_; }

  /// Returns the force on the hand, in W [N]. `cursor` means that the foot moves by itself. If the state is not finite,
  /// returns zero and charges nothing.
  [[nodiscard]] Vec3 update(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept;

  [[nodiscard]] const EnergyTank& tank() const noexcept { return tank_; }
  /// Returns true if a term draws from the tank.
  [[nodiscard]] bool is_active() const noexcept;
  /// Returns the tunnel on which the walls act, with the path's own radius, and the share of the walls that acts.
  [[nodiscard]] const PathProjection::Tube& tube() const noexcept { return tube_; }
  [[nodiscard]] double wall_share() const noexcept { return wall_share_; }
  /// Returns the force of walls that are no longer there.
  [[nodiscard]] const WallRelease& release() const noexcept { return release_; }
  /// Returns the certainty of the place at the last update.
  [[nodiscard]] double certainty() const noexcept { return certainty_; }
  /// Returns the energy given to the hand beyond the energy stored in springs [J].
  [[nodiscard]] double given() const noexcept { return given_; }
  /// Returns the capacity of the tank plus all credits so far [J]. given() exceeds it by at most a tick's work.
  [[nodiscard]] double budget() const noexcept { return budget_; }

 private:
  [[nodiscard]] double gate(const PathProjection::Foot& foot) const noexcept;
  void account(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept;
  /// Credits the allowance for the part of the path that is walked at this tick.
  void credit(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept;
  /// Returns the energy that the springs hold with `tuning` in the foot's `tube`, which has the path's own radius [J].
  [[nodiscard]] double stored(const PathProjection::Foot& foot, const PathProjection::Tube& tube,
                              const GuideTuning& tuning) const noexcept;
  /// Returns the force of the springs in the foot's tunnel, with the tuning in force and all of the walls [N].
  [[nodiscard]] Vec3 springs(const State& state, const PathProjection::Foot& foot) const noexcept;
  /// Lets the walls act on another tunnel: they hold no more energy than before, and what they hold less is lost.
  void change_tunnels(const State& state, const PathProjection::Foot& foot) noexcept;
  /// Approaches the target as far as the tank allows.
  void approach(const PathProjection::Foot& foot, double dt) noexcept;

  GuideTerms terms_;
  Options options_;
  EnergyTank tank_;
  EnergyAccount account_;
  GuideTuning target_, tuning_;
  double given_ = 0, budget_ = 0;
  Vec3 place_ = Vec3::Zero();  ///< foot at the previous tick [m]
  WalkedSet walked_;           ///< parts of the path whose allowance is credited
  double s_ = 0;               ///< arc length of the foot at the previous tick [m]
  Vec3 hand_ = Vec3::Zero();   ///< position at the previous tick [m]
  PathProjection::Tube tube_;
  double wall_share_ = 1;
  WallRelease release_;
  double certainty_ = 1;
  Vec3 spring_ = Vec3::Zero();  ///< force of the restoring terms at the previous tick [N]
};

}  // namespace haptrace
