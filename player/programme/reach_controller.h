// Controller of one trial with a cue: a reach to a target, a range of motion, a press against a lock, tracking, or the
// weight of an arm on a lock.
#pragma once

#include "control/controller.h"
#include "control/hand_watch.h"
#include "control/limits.h"
#include "control/reach_forces.h"
#include "control/tuning.h"
#include "player/repetition_phases.h"
#include "player/tuning/session_requests.h"

#include <optional>

namespace haptrace {

/// Course of one reach.
struct ReachCourse {
  double start_hold = 0.75;     ///< hold in the start before the cue [s]
  double target_hold = 0.5;     ///< hold in the target, or at the farthest place, that ends the reach [s]
  double time_limit = 3;        ///< from the cue [s]; a press, tracking and a weight end at it
  double hold = 0.5;            ///< pause at the end [s]; of a press at least the time in which its lock goes
  bool pull = false;            ///< a force leads the hand to the start; else the participant finds it
  double approach_speed = 0.1;  ///< of that force's reference, at its peak [m/s]
  double max_deviation = 0.1;   ///< distance from that reference at which the session stops [m]
  double rate_hz = 1000;
};

/// Runs one reach in the phases of every session:
///
/// approach: the hand moves to the start. With `pull`, a PD law along a minimum-jerk movement leads it there, rises and
/// falls within kBlend, and is off before the hold in the start counts. A hand that leaves the start for kAway is led
/// back. The hold must be whole: a hand that leaves the start too early begins it again.
/// run: begins with the cue to go. By ReachGoal,
///   - target: it ends when the hand has stayed in the target for its hold;
///   - range: it ends when the hand, out of the start, has stayed at its farthest place for that hold;
///   - press: it ends at the time limit, when the hand has broken the lock, or when the lock has held for so long that
///     its force decays;
///   - track: the reference is the moving target; it ends at the time limit;
///   - weigh: as a press.
///   A target and a range that were not held end at the time limit, as trials whose time is over.
/// hold: the pause at the end, without force.
///
/// The hold before a press counts only while the hand does not press; that before a weight counts wherever the lock
/// carries the arm. A clamp, or the lock of a press, comes on in the
/// start and is complete before the cue if the hold is as long as its rise. A field comes on with the cue: on a light
/// hand that rests, a late estimate of the velocity would let it grow by itself. A pause takes all forces away; after
/// it the reach starts again with the approach. So it does after a gap. If the hand is not in the start after
/// kLongestStart, the reach ends as one whose time is over.
///
/// Real-time: all but the constructor.
class ReachController final : public Controller {
 public:
  static constexpr double kBlend = 0.3;        ///< [s]
  static constexpr double kAway = 1;           ///< [s]
  static constexpr double kLongestStart = 60;  ///< [s]
  static constexpr double kEmptyLasts = 0.1;   ///< an event reports an energy tank that is empty for so long [s]
  /// A hand stays at its farthest place if it comes no farther by kFarther, and goes back by no more than kSteady [m].
  static constexpr double kFarther = 1e-3, kSteady = 5e-3;
  static constexpr double kShortestStay = 0.5;  ///< of a range that ends, however short its hold is [s]

  /// Throws Error(input) that names the value that is out of its range.
  ReachController(const ReachTrial& trial, const ReachForces::Options& forces, const ReachCourse& course,
                  const PdGains& pull, const HandWatchOptions& hand);

  /// Obeys the requests that arrive in `requests`, which must outlive the controller. Before start.
  void obey(Mailbox<SessionRequests>& requests) noexcept { mailbox_ = &requests; }

  void start(const State& first) noexcept override;
  /// Starts the reach again, with the approach.
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;

  [[nodiscard]] const ReachForces& forces() const noexcept { return forces_; }

 private:
  void begin_approach(const Vec3& from) noexcept;
  /// Follows the requests. Returns true while the session is paused.
  bool follow_requests(const State& state) noexcept;
  void advance(const State& state, Command& command) noexcept;
  void advance_start(const State& state, Command& command) noexcept;
  void advance_run(const State& state, Command& command) noexcept;
  void end_run(Command& command, bool reached, const Vec3& position) noexcept;
  /// Returns true if the hand is where the goal asks it to hold.
  [[nodiscard]] bool holds(const Vec3& position) noexcept;
  [[nodiscard]] Vec3 goal() const noexcept;
  /// Adds the force that leads to the start. Returns true if it acts.
  bool add_pull(const State& state, Command& command) noexcept;
  /// Reports a broken channel, and an energy tank that weakens the field.
  void watch_forces(const State& state, Command& command) noexcept;

  ReachGeometry geometry_;
  ReachGoal goal_;
  TrackSignal track_;
  ReachForces forces_;
  ReachCourse course_;
  PdGains pull_gains_;
  HandWatch hand_;
  RepetitionPhases phases_;
  RequestFollower requests_;
  Mailbox<SessionRequests>* mailbox_ = nullptr;
  bool paused_ = false;
  Ramp pull_{0};
  bool leads_ = false;      ///< the pull is on
  bool arrived_ = false;    ///< the hand has been in the start since the approach began
  bool let_go_ = false;     ///< the lock waits for a hand that has pressed too long before the cue
  double waited_ = 0;       ///< time of the approach, leading back included [s]
  double held_ = 0;         ///< time in the start, then in the target or at the farthest place [s]
  double farthest_ = kNaN;  ///< range: how far the hand last came to stay, along the direction [m]
  double away_ = 0;         ///< time out of the start [s]
  double empty_ = 0;        ///< [s]
  bool told_broken_ = false, told_empty_ = false;
};

}  // namespace haptrace
