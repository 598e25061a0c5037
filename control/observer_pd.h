// The PD law on an observer's estimates, and the disturbance observer that comes with it.
#pragma once

#include "control/design/tracking_design.h"
#include "control/pd.h"
#include "control/state_observer.h"

namespace haptrace {

/// F = Kp (x_d - x) + Kd (v_d - v) + load
///
/// with x, v and what loads the device as a StateObserver predicts them for the instant at which the force will act,
/// and the reference at that instant. The terms before this one are what of the load is known; the observer adds what
/// they miss, low-passed at observer_hz and clamped to its authority. It reckons with the force that was really sent,
/// so that nothing winds up while the device saturates or a person holds it fast.
///
/// At rest: an observer integrates, and integration, stiction and a position quantum make a limit cycle of about a
/// count. So once the reference rests and the device stays within kStillCounts of where it is, and that within
/// kRestCounts of the reference, for kRestTime, load and spring force are kept as they are and the gains are lowered to
/// kRestGains; farther than twice that, or when the reference moves, all is as before. Every time that it slips instead
/// of staying, both bounds grow by a tenth, up to five times, until the reference moves: whatever hunts comes to rest.
///
/// Friction that has not broken loose is a spring (presliding: Canudas de Wit, Olsson, Astrom and Lischinsky 1995),
/// stiff enough to put a small device at 30 to 50 Hz and with next to no damping of its own. The observer takes its
/// force for a load and follows it late, so that the damping it sees acts late too, and drives the device instead.
/// Lower gains do not help, an earlier estimate does: the state observer becomes faster by as much as the gains are
/// lowered, which leaves the noise of the force about what it was.
///
/// An axis without mass is not driven, whatever its gains.
class ObserverPd final : public ForceTerm {
 public:
  struct Options {
    TrackingDesign design;
    double rate_hz = 1000;
    double position_resolution = 0;  ///< [m]
  };

  static constexpr double kRestCounts = 2;
  static constexpr double kStillCounts = 1.5;
  static constexpr double kRestTime = 0.06;      ///< [s]
  static constexpr double kStandingGains = 0.6;  ///< of the gains
  static constexpr double kRestGains = 0.4;      ///< of the gains

  explicit ObserverPd(const Options& options);

  void start(const State& first) noexcept override;
  [[nodiscard]] bool feeds_back() const noexcept override { return true; }
  [[nodiscard]] Vec3 force(const TermInput& input) noexcept override;

 private:
  [[nodiscard]] bool rests(const State& state, const Reference& reference) noexcept;

  StateObserver observer_;
  Vec3 driven_;                 ///< 1 where there is mass, else 0
  double observer_hz_;          ///< of the state observer under full gains
  double authority_;            ///< [N]
  double quantum_;              ///< [m]
  Vec3 anchor_ = Vec3::Zero();  ///< where it stays [m]
  double rest_share_ = 1;       ///< of the gains, when rest began
  double patience_ = 1;
  double stood_ = 0;            ///< the reference, for how long [s]
  Vec3 known_ = Vec3::Zero();   ///< what the terms before answered at the last tick [N]
  Vec3 load_ = Vec3::Zero();    ///< low-passed [N]
  Vec3 kept_ = Vec3::Zero();    ///< at rest: the load that is kept; after it: what fades of the difference [N]
  Vec3 spring_ = Vec3::Zero();  ///< Kp (x_d - x) when rest began [N]
  double rested_ = 0;           ///< for how long [s]
  bool resting_ = false;
  double gain_share_ = 1;
};

}  // namespace haptrace
