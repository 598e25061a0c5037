// PD law on the estimates of a state observer, with a disturbance observer.
#pragma once

#include "control/design/tracking_design.h"
#include "control/force_term.h"
#include "control/rest.h"
#include "control/state_observer.h"

namespace haptrace {

/// F = Kp (x_d - x) + Kd (v_d - v) + load
///
/// where a StateObserver predicts x, v and load for the instant at which the force will act, and x_d and v_d are the
/// reference at that instant. The terms before this one give the known part of the load. The observer adds the rest,
/// low-passed at observer_hz and clamped to its authority. It accounts for the force that was really sent, so that
/// nothing winds up while the device saturates or an operator holds it.
///
/// While the reference rests, Rest keeps the load and lowers the gains to kRestGains, at standstill to kStandingGains.
///
/// Before it breaks loose, friction is a spring (presliding: Canudas de Wit, Olsson, Astrom and Lischinsky 1995), stiff
/// enough to put a small device at 30 to 50 Hz, with almost no damping of its own. The observer takes the force of this
/// spring for a load and follows it late. The damping then acts late too, and drives the device instead. Lower gains do
/// not help, but an earlier estimate does: the state observer becomes faster by the factor by which the gains are
/// lowered, which leaves the noise of the force about the same.
///
/// An axis without mass is not driven, whatever its gains.
class ObserverPd final : public ForceTerm {
 public:
  struct Options {
    TrackingDesign design;
    double rate_hz = 1000;
    double position_resolution = 0;  ///< [m]
  };

  static constexpr double kStandingGains = 0.6;  ///< share of the gains at standstill
  static constexpr double kRestGains = 0.4;      ///< share of the gains at rest

  explicit ObserverPd(const Options& options);

  void start(const State& first) noexcept override;
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;
  [[nodiscard]] PdGains gains(const Tuning& tuning) const noexcept override;

 private:
  /// Returns the share of the tuned gains in the last force, smaller at rest.
  [[nodiscard]] double gain_share() const noexcept { return 1 - (1 - kRestGains) * rest_.weight(); }

  StateObserver observer_;
  Vec3 driven_;         ///< 1 for an axis with mass, else 0
  double observer_hz_;  ///< bandwidth of the state observer under full gains
  double authority_;    ///< [N]
  Rest rest_;
  Vec3 known_ = Vec3::Zero();  ///< force of the terms before this one at the last tick [N]
  Vec3 load_ = Vec3::Zero();   ///< low-passed load [N]
};

}  // namespace haptrace
