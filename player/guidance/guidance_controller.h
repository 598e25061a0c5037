// Controller that guides a trainee along an expert's path at the trainee's own pace.
#pragma once

#include "base/running_time.h"
#include "control/back_wall.h"
#include "control/controller.h"
#include "control/guidance.h"
#include "control/guidance_options.h"
#include "control/hand_watch.h"
#include "control/limits.h"
#include "control/path/place_tracker.h"
#include "control/pd.h"
#include "control/walked_set.h"
#include "player/repetition_phases.h"
#include "player/tuning/session_requests.h"

#include <memory>

namespace haptrace {

struct DeviceInfo;
struct GuideOptions;
struct GuidePlan;

/// Guides a trainee along a path in repetitions of three phases: approach, run and hold.
///
/// approach: a PD law follows a minimum-jerk movement from the tool's position to the start. Without `led`, no force is
/// sent, and the phase lasts until the trainee is within the deviation limit of the start or the time limit of a
/// repetition has passed.
/// run: Guidance alone acts until the trainee reaches the end of the path (within 2 mm of its length), the cursor
/// reaches it, or the time limit passes.
/// hold: the session waits at the end.
/// Between the PD law and Guidance the forces blend over kBlend. The reference is the trainee's place on the path (or
/// the cursor), with the expert's velocity and force there.
///
/// The end of the path counts only while the place is not in full doubt, and for a trainee who walked at least kWalked
/// of the path: where a path ends near its start, a hand that trembles there is near the end, too. Events report a
/// place that is in doubt and an energy tank that is empty for long.
///
/// The servo loop softens walls that make it vibrate (ForceGuard).
class GuidanceController final : public Controller {
 public:
  static constexpr double kBlend = 0.3;     ///< [s]
  static constexpr double kWalked = 0.25;   ///< share of the path; a trainee may leave out the rest
  static constexpr double kDoubtLasts = 1;  ///< an event reports a doubt that lasts so long, ...
  static constexpr double kEmptyLasts = 2;  ///< ... and so long an empty tank [s]
  /// Share of the active forces below which the place counts as in doubt, and the tank as empty.
  static constexpr double kFaded = 0.5;

  GuidanceController(std::shared_ptr<const ArcPath> path, Guidance guidance, const PdGains& approach,
                     const GuidanceOptions& options);

  /// Obeys the requests and approaches the tunings that arrive in `requests` and `tunings`, which must outlive the
  /// controller. While a pause lasts, the force is zero, the place on the path stands still, and the deviation has no
  /// limit. After it the repetition continues where it was, or restarts if the hand is beyond the deviation limit.
  /// Before start.
  void obey(Mailbox<SessionRequests>& requests, Mailbox<GuideTuning>& tunings) noexcept;

  /// From now on the load in `hand` decides when the hand resists. Before start. Throws the errors of validate().
  void watch(const HandWatchOptions& hand) { hand_ = HandWatch(hand); }

  /// Moves `wall`, a term of the guidance, and reports with an event after every run how it began. Before start.
  void move_wall(BackWall& wall) noexcept { wall_ = &wall; }
  /// Returns how the present or last repetition began; null without a back wall.
  [[nodiscard]] const Initiation* initiation() const noexcept {
    return wall_ != nullptr ? &wall_->initiation() : nullptr;
  }

  void start(const State& first) noexcept override;
  /// Restarts the repetition with the approach to its start.
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;

  [[nodiscard]] const Guidance& guidance() const noexcept { return guidance_; }
  /// Returns the share of the time of all runs in which the place was in doubt, and in which the tank was empty; 0
  /// without a run.
  [[nodiscard]] double share_in_doubt() const noexcept { return run_time_ > 0 ? doubt_.total / run_time_ : 0; }
  [[nodiscard]] double share_empty() const noexcept { return run_time_ > 0 ? empty_.total / run_time_ : 0; }

 private:
  void begin_approach(const Vec3& from) noexcept;
  /// Follows the requests. Returns true while the session is paused.
  bool follow_requests(const State& state) noexcept;
  /// Advances the time and switches between the phases.
  void advance(const State& state, Command& command) noexcept;
  /// Reports how the run began once it is over.
  void tell_initiation(Command& command) noexcept;
  /// Updates and returns the place of the trainee or the cursor on the path.
  const PathProjection::Foot& follow(const State& state) noexcept;
  [[nodiscard]] bool arrived() const noexcept;
  /// Returns true when the run may begin: always if a force led the trainee, else near the start or after the time
  /// limit.
  [[nodiscard]] bool may_begin(const Vec3& position) const noexcept;
  /// Counts the time in doubt and with an empty tank, and reports when it lasts.
  void watch_forces(const State& state, Command& command) noexcept;
  /// Ends the session when `deviation` exceeds the limit of the current phase.
  void watch_deviation(double deviation, Command& command) const noexcept;

  std::shared_ptr<const ArcPath> path_;
  Guidance guidance_;
  PdGains approach_gains_;
  GuidanceOptions options_;
  PlaceTracker tracker_;

  RepetitionPhases phases_{options_.repetitions, options_.hold, options_.approach_speed};
  RunningTime cursor_time_;  ///< of the expert
  Ramp pace_{1};             ///< of the cursor: 0 while it waits
  HandWatch hand_;
  Ramp blend_{0};  ///< 0: PD law, 1: guidance
  RequestFollower requests_;
  Mailbox<SessionRequests>* mailbox_ = nullptr;
  Mailbox<GuideTuning>* tunings_ = nullptr;
  bool paused_ = false;
  BackWall* wall_ = nullptr;  ///< owned by guidance_
  bool ran_ = false;          ///< a run's initiation has not been reported
  WalkedSet walked_;          ///< in this run
  double walked_length_ = 0;  ///< of it [m]

  /// A state that may last.
  struct Lasting {
    double now = 0, total = 0;  ///< duration of the present one, and of all [s]
    /// Returns true when it has lasted for `time` [s].
    bool update(bool is, double dt, double time) noexcept;
  };
  Lasting doubt_, empty_;
  double run_time_ = 0;  ///< [s]
};

/// Returns the controller that guide() runs, for other kinds of sessions. It has no time limit unless the options set
/// one.
GuidanceController guidance_controller(const DeviceInfo& device, const GuidePlan& plan, const GuideOptions& options);

}  // namespace haptrace
