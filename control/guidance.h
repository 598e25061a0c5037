// Guidance: forces that keep a trainee near an expert's path, and reproduce the expert's forces there.
#pragma once

#include "control/controller.h"
#include "control/energy_account.h"
#include "control/energy_tank.h"
#include "control/guidance_options.h"
#include "control/path/path_projection.h"
#include "control/walked_set.h"
#include "control/wall_release.h"

#include <algorithm>
#include <memory>
#include <vector>

namespace haptrace {

/// Changes of guidance while it runs, relative to the terms as they were composed. Plain data, to be posted through a
/// Mailbox.
struct GuideTuning {
  double radius_scale = 1;   ///< factor on the path's radius ...
  double radius_offset = 0;  ///< ... to which this is added [m]
  double stiffness = 1;      ///< factor on the stiffness of the walls
  double damping = 1;        ///< factor on the damping in the walls
  double force = 1;          ///< factor on the expert's force
  double assist = 1;         ///< factor on the force that helps along the path
  double share = 1;          ///< factor on all forces, 0 to 1

  /// Returns the radius of the tunnel for a path's `radius` [m].
  [[nodiscard]] double radius(double radius) const noexcept {
    return std::max(0.0, radius_scale * radius + radius_offset);
  }
};

/// Input of a guidance term.
struct GuideInput {
  const State& state;
  const PathProjection::Foot& foot;  ///< with the radius in force; walls act on its tube, other forces at its place
  double gate = 1;                   ///< closeness of the trainee to the path: 1 within the tunnel, 0 far from it
  GuideTuning tuning = {};           ///< in force
};

/// One summand of guidance. A session holds only the terms that it is composed of.
///
/// Real-time: all.
class GuideTerm {
 public:
  /// Effect of a term on energy.
  enum class Kind {
    restoring,    ///< a spring: gives back at most the energy that it holds, see stored()
    dissipative,  ///< only takes energy
    active,       ///< may give energy: draws from the tank
  };

  virtual ~GuideTerm() = default;
  [[nodiscard]] virtual Kind kind() const noexcept = 0;
  /// Returns the force on the hand, in W [N].
  [[nodiscard]] virtual Vec3 force(const GuideInput& input) noexcept = 0;
  /// Returns the energy that a restoring term holds [J]. The foot has the radius in force.
  [[nodiscard]] virtual double stored(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
    (void)foot, (void)tuning;
    return 0;
  }
  /// Returns the energy that the path allows an active term to give per metre, on the first pass [J/m].
  [[nodiscard]] virtual double allowance(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept {
    (void)foot, (void)tuning;
    return 0;
  }
};

using GuideTerms = std::vector<std::unique_ptr<GuideTerm>>;

/// Springs back towards the path beyond its radius. The stiffness rises linearly over `onset`, so that neither the
/// force nor its slope has a step where the wall begins:
///
///     f(d) = k d^2 / (2 w) for d < w,   k (d - w / 2) beyond, at most f_max,   d = distance - radius
///
/// It acts on the foot's tube, the nearest of all tunnels in which the trainee may be.
class TunnelWall final : public GuideTerm {
 public:
  struct Options {
    double stiffness = 500;  ///< [N/m]
    double onset = 1e-3;     ///< w [m]
    double max_force = 5;    ///< below the device's limit, so that the wall gives back the energy it took [N]
  };
  explicit TunnelWall(const Options& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::restoring; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double stored(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept override;

 private:
  Options options_;
};

/// Damps outward movement in the wall, never the return: f = -b (v . n) n, rising over `onset`.
class WallDamping final : public GuideTerm {
 public:
  WallDamping(double damping, double onset) noexcept : damping_(damping), onset_(onset) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double damping_, onset_;  ///< [N s/m], [m]
};

/// Applies the expert's force at this place of the path, times a scale. A negative scale makes the trainee overcome the
/// force. It follows the gate, times the certainty of the place. After the gate was closed, it returns within kReturn
/// of the expert's time: a faster trainee, by up to kFastest times, would else be past the place before the force is
/// back.
class ExpertForce final : public GuideTerm {
 public:
  explicit ExpertForce(double scale) noexcept : scale_(scale) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  /// Returns the scaled force of the expert along the path, regardless of its direction.
  [[nodiscard]] double allowance(const PathProjection::Foot& foot, const GuideTuning& tuning) const noexcept override;

  static constexpr double kReturn = 0.3;  ///< [s]
  static constexpr double kFastest = 4;   ///< relative to the expert's speed

 private:
  double scale_;
  double share_ = 0;     ///< gate, with its rise limited
  bool returns_ = true;  ///< the gate was closed, and the share has not caught up with it
};

/// Helps a trainee along the path if they are slower than the expert by more than a margin and kUnnoticed. It never
/// slows the trainee down, and its force is bounded, so that it does not drag them. Where the direction is in doubt, it
/// fades.
class PaceHelp final : public GuideTerm {
 public:
  explicit PaceHelp(const PaceHelpOptions& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double allowance(const PathProjection::Foot&, const GuideTuning& tuning) const noexcept override {
    return tuning.assist * options_.max_force;
  }

  /// Speed difference that causes no help: no hand keeps a speed so closely, and no device measures it [m/s].
  static constexpr double kUnnoticed = 5e-3;

 private:
  PaceHelpOptions options_;
};

/// Resists movement along the path, in both directions: f = -b (v . t) t.
class Resistance final : public GuideTerm {
 public:
  explicit Resistance(double damping) noexcept : damping_(damping) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double damping_;  ///< [N s/m]
};

/// Resists all movement: f = -b v.
class Viscosity final : public GuideTerm {
 public:
  explicit Viscosity(double damping) noexcept : damping_(damping) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override { return -damping_ * input.state.velocity; }

 private:
  double damping_;  ///< [N s/m]
};

/// Pushes away from the path, so that the trainee has to be more accurate than necessary: f = min(k d, f_max), fading
/// to zero where the wall begins (error augmentation, Patton et al. 2006).
class ErrorAmplification final : public GuideTerm {
 public:
  ErrorAmplification(double stiffness, double max_force) noexcept : stiffness_(stiffness), max_force_(max_force) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double stiffness_, max_force_;  ///< [N/m], [N]
};

/// Returns the largest stiffness [N/m] of walls that are sampled at `rate_hz` [Hz] and act `delay` [s] late, on a
/// device that no hand holds and whose own damping is `damping` [N s/m]: K < b / (T / 2 + delay) (Colgate and Schenkel
/// 1997; with the delay, Gil et al. 2004). The wall's own damping does not count, because it is as late.
double largest_wall_stiffness(double rate_hz, double delay, double damping = 1);

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
