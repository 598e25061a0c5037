// Along an expert's path, in the trainee's own time.
#pragma once

#include "base/running_time.h"
#include "control/controller.h"
#include "control/guidance.h"
#include "control/hand_watch.h"
#include "control/limits.h"
#include "control/pd.h"
#include "player/repetition_phases.h"

#include <memory>

namespace haptrace {

struct GuidanceOptions {
  bool cursor = false;          ///< a cursor moves in the expert's time; else the place is where the trainee is
  bool allow_back = false;      ///< the place may go back
  double speed = 1;             ///< of the cursor, times the expert's
  double wait = 0;              ///< distance from the trainee at which the cursor waits for him, 0: it does not [m]
  int repetitions = 1;          ///< 0: until stopped
  double hold = 0.5;            ///< at the end of every repetition [s]
  double approach_speed = 0.1;  ///< peak speed of the movement to the start [m/s]
  double time_limit = 0;        ///< of a repetition [s]; 0: none
  double max_deviation = 0.1;   ///< from the path, beyond which the session stops [m]
  /// From the reference on the way to the start, beyond which the session stops; as max_deviation when absent [m].
  std::optional<double> max_approach_deviation;
  bool led = true;        ///< a force leads the hand to the start; else nothing is sent until it is there
  double patience = 0;    ///< with a hand that resists on the path [s], see Command; the approach has kPatience
  HandWatchOptions hand;  ///< from which load the hand resists what has patience
  double rate_hz = 1000;
};

/// Throws Error(input) naming the option that is out of range.
void validate(const GuidanceOptions& options);

/// Guides a trainee along a path: approach, run, hold, again.
///
/// approach: minimum jerk from where the tool is to the start, on a PD law, or without any force until the trainee is
/// within the deviation limit of the start (or the time of a repetition is over); run: Guidance alone, until the end of
/// the path is reached (within 2 mm of its length), the cursor is there, or the time is over; hold: at the end. Between
/// the PD law and Guidance the forces blend over kBlend. Its reference is the trainee's place on the path (or the
/// cursor), with the expert's velocity and force there.
///
/// The servo loop softens walls that make it vibrate (ForceGuard).
class GuidanceController final : public Controller {
 public:
  static constexpr double kBlend = 0.3;     ///< [s]
  static constexpr double kArrived = 2e-3;  ///< [m]

  GuidanceController(std::shared_ptr<const ArcPath> path, Guidance guidance, const PdGains& approach,
                     const GuidanceOptions& options);

  void start(const State& first) noexcept override;
  /// The repetition begins anew, with the way to its start.
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;

  [[nodiscard]] const Guidance& guidance() const noexcept { return guidance_; }

 private:
  void begin_approach(const Vec3& from) noexcept;
  /// Moves on through the phases.
  void advance(const State& state, Command& command) noexcept;
  /// Where the trainee, or the cursor, is on the path now.
  const PathProjection::Foot& follow(const State& state) noexcept;
  [[nodiscard]] bool arrived() const noexcept;
  /// Whether the trainee may begin: always when he was led.
  [[nodiscard]] bool may_begin(const Vec3& position) const noexcept;
  /// Ends the session when the hand is too far from where it is led or kept.
  void watch_deviation(double deviation, Command& command) const noexcept;

  std::shared_ptr<const ArcPath> path_;
  Guidance guidance_;
  PdGains approach_gains_;
  GuidanceOptions options_;
  PathProjection projection_;

  RepetitionPhases phases_{options_.repetitions, options_.hold, options_.approach_speed};
  RunningTime cursor_time_;  ///< of the expert
  Ramp pace_{1};             ///< of the cursor: 0 while it waits
  HandWatch hand_{options_.hand};
  Ramp blend_{0};  ///< 0 the PD law, 1 guidance
};

}  // namespace haptrace
