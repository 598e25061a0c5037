// Guidance: what keeps a trainee near an expert's path, and lets him feel the expert's forces where he is.
#pragma once

#include "control/controller.h"
#include "control/energy_account.h"
#include "control/energy_tank.h"
#include "control/path/path_projection.h"

#include <memory>
#include <vector>

namespace haptrace {

/// What a term of guidance is asked with.
struct GuideInput {
  const State& state;
  const PathProjection::Foot& foot;
  double gate = 1;  ///< how closely the trainee follows: 1 within the tunnel, 0 far from it
};

/// One summand of guidance. A session holds those that it was composed of, and nothing else.
///
/// Real-time: all.
class GuideTerm {
 public:
  /// What a term can do with energy.
  enum class Kind {
    restoring,    ///< a spring: gives back at most what it holds, see stored()
    dissipative,  ///< takes only
    active,       ///< may give: draws from the tank
  };

  virtual ~GuideTerm() = default;
  [[nodiscard]] virtual Kind kind() const noexcept = 0;
  /// On the hand, in W [N].
  [[nodiscard]] virtual Vec3 force(const GuideInput& input) noexcept = 0;
  /// Energy that a restoring term holds [J].
  [[nodiscard]] virtual double stored(const PathProjection::Foot& foot) const noexcept {
    (void)foot;
    return 0;
  }
  /// What the path allows an active term to give along a metre of it, the first time that it is walked [J/m].
  [[nodiscard]] virtual double allowance(const PathProjection::Foot& foot) const noexcept {
    (void)foot;
    return 0;
  }
};

using GuideTerms = std::vector<std::unique_ptr<GuideTerm>>;

/// Springs back towards the path from its radius on. The stiffness rises linearly over `onset`, so that neither the
/// force nor its slope has a step where the wall begins:
///
///     f(d) = k d^2 / (2 w) for d < w,   k (d - w / 2) beyond, at most f_max,   d = distance - radius
class TunnelWall final : public GuideTerm {
 public:
  struct Options {
    double stiffness = 500;  ///< [N/m]
    double onset = 1e-3;     ///< w [m]
    double max_force = 5;    ///< [N]; below what the device can do, so that it gives back what it took
  };
  explicit TunnelWall(const Options& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::restoring; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double stored(const PathProjection::Foot& foot) const noexcept override;

 private:
  Options options_;
};

/// Damps what moves outwards in the wall, never what comes back: f = -b (v . n) n, rising over `onset`.
class WallDamping final : public GuideTerm {
 public:
  WallDamping(double damping, double onset) noexcept : damping_(damping), onset_(onset) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::dissipative; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double damping_, onset_;  ///< [N s/m], [m]
};

/// The expert's force at this place of the path, times a scale that is negative where the trainee is to overcome it.
/// It follows the gate down at once and up within kReturn.
class ExpertForce final : public GuideTerm {
 public:
  explicit ExpertForce(double scale) noexcept : scale_(scale) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  /// What the expert's force does along the path, either way.
  [[nodiscard]] double allowance(const PathProjection::Foot& foot) const noexcept override;

  static constexpr double kReturn = 0.3;  ///< [s]

 private:
  double scale_;
  double share_ = 0;  ///< of the gate
};

/// Helps along the path who is slower there than the expert was, by more than a margin and kUnnoticed; never slows
/// down, and drags nobody: the help is bounded.
class PaceHelp final : public GuideTerm {
 public:
  struct Options {
    double pace = 1;       ///< times the expert's speed
    double margin = 0.2;   ///< of that, below which nothing is done
    double gain = 20;      ///< [N s/m]
    double max_force = 1;  ///< [N]
  };
  explicit PaceHelp(const Options& options) noexcept : options_(options) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double allowance(const PathProjection::Foot&) const noexcept override { return options_.max_force; }

  /// No hand keeps to a speed so closely, and no device measures it [m/s].
  static constexpr double kUnnoticed = 5e-3;

 private:
  Options options_;
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

/// Pushes away from the path, so that the trainee has to be more exact than he need be: f = min(k d, f_max), gone where
/// the wall begins (error augmentation, Patton et al. 2006).
class ErrorAmplification final : public GuideTerm {
 public:
  ErrorAmplification(double stiffness, double max_force) noexcept : stiffness_(stiffness), max_force_(max_force) {}
  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;

 private:
  double stiffness_, max_force_;  ///< [N/m], [N]
};

/// What walls bear that are sampled at `rate_hz` [Hz] and act `delay` [s] late, on a device with so much damping of its
/// own [N s/m] that nobody holds [N/m]: K < b / (T / 2 + delay) (Colgate and Schenkel 1997; with the delay, Gil et al.
/// 2004). The damping of the wall is not counted: it is as late.
double largest_wall_stiffness(double rate_hz, double delay, double damping = 1);

/// The sum of its terms, with what the active ones may give kept by an energy tank.
///
/// What was given is told by an EnergyAccount. A spring that is sampled and late gives more than it held: that is
/// charged like everything else, and when the tank is overdrawn, damping takes it back. Credited is what the path
/// allows for (GuideTerm::allowance) where it is walked for the first time, and in cursor mode what the cursor drags.
/// So over any session
///
///     given to the hand  <=  energy + allowances of the path + what the cursor dragged.
///
/// Real-time: all but the constructor. Threads: one at a time.
class Guidance {
 public:
  struct Options {
    double energy = 0.3;       ///< of the tank [J]
    double gate_width = 2e-3;  ///< over which the gate closes beyond the radius, at least; else a radius [m]
    double delay = 1e-3;       ///< from a force's sending to its effect [s]
    double rate_hz = 1000;
    double max_damping = 10;  ///< that takes overdrawn energy back [N s/m]
  };

  /// Throws Error(input) naming the option that is out of range, and when none of the terms restores the position:
  /// forces that are replayed without one drift away. No terms at all leave the hand alone.
  Guidance(GuideTerms terms, const Options& options);

  /// Begins at the start of the path anew: what was walked may be walked again, the tank stays as it is.
  void begin() noexcept {
    account_.begin();
    farthest_ = 0;
  }

  /// `cursor`: the foot moves by itself.
  /// A state that is not finite is answered by no force, and nothing is charged for it.
  [[nodiscard]] Vec3 update(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept;

  [[nodiscard]] const EnergyTank& tank() const noexcept { return tank_; }
  /// What was given to the hand beyond what is stored in springs [J].
  [[nodiscard]] double given() const noexcept { return given_; }
  /// Credits so far, with the tank's first content [J]: what given() never passes by more than a tick's work.
  [[nodiscard]] double budget() const noexcept { return budget_; }

 private:
  [[nodiscard]] double gate(const PathProjection::Foot& foot) const noexcept;
  void account(const State& state, const PathProjection::Foot& foot, bool cursor) noexcept;

  GuideTerms terms_;
  Options options_;
  EnergyTank tank_;
  EnergyAccount account_;
  double given_ = 0, budget_ = 0;
  Vec3 place_ = Vec3::Zero();   ///< the foot at the tick before [m]
  double farthest_ = 0;         ///< arc length [m]
  Vec3 spring_ = Vec3::Zero();  ///< of the restoring terms, at the tick before [N]
};

}  // namespace haptrace
