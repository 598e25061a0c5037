// Along a path: approach, run, hold, again.
#pragma once

#include "base/mailbox.h"
#include "base/running_time.h"
#include "control/controller.h"
#include "control/limits.h"
#include "control/pd.h"
#include "player/playback/orientation_follower.h"
#include "player/playback/reference_stream.h"
#include "player/playback/tracking_guard.h"
#include "player/repetition_phases.h"

#include <array>
#include <memory>
#include <string_view>
#include <vector>

namespace haptrace {

/// What a playback does when the hand is farther from the reference than allowed.
enum class DeviationPolicy {
  stop,    ///< the session ends and the force fades
  pause,   ///< the reference waits, also on the way to the start, until the hand is back within half the limit
  soften,  ///< the reference goes on; the force grows no further than it was at the limit
};

DeviationPolicy parse_deviation_policy(std::string_view name);  ///< throws Error(input)
const char* to_string(DeviationPolicy policy) noexcept;

struct PlaybackOptions {
  double speed = 1;             ///< of the path's own time
  int repetitions = 1;          ///< 0: until stopped
  double hold = 0.5;            ///< at the end of every repetition [s]
  double approach_speed = 0.1;  ///< peak speed of the movement to the start [m/s]
  double max_deviation = 0.03;  ///< [m]
  DeviationPolicy on_deviation = DeviationPolicy::stop;
  double rate_hz = 1000;                       ///< of the servo loop, [Hz]
  std::array<bool, 3> axes{true, true, true};  ///< that the device can drive; the others have no reference
};

/// Throws Error(input) naming the option that is out of range.
void validate(const PlaybackOptions& options);

/// Follows a trajectory with the sum of its terms: F = sum_i term_i(x, x_d). The reference has a time on the path, but
/// on the way to its start.
///
/// approach: minimum jerk from where the tool is to the start of the path; run: x_d(t) along the path, t advancing by
/// speed * dt; hold: at the end. The reference never jumps: after a stall of the loop the path's time advances by at
/// most five ticks, so that the hand is not pulled after a reference that ran away meanwhile; and where the path was
/// not read in time, its time stands still until it was. It also stands still while the device is away: the reference
/// then goes from where the tool is by minimum jerk to where it stood (phase approach), and on from there.
class PlaybackController final : public Controller {
 public:
  /// Begins with `tuning` and goes over to what arrives in `changes`, if there is one; it must outlive the controller.
  PlaybackController(ReferenceStream path, ForceTerms terms, const Tuning& tuning, const PlaybackOptions& options,
                     Mailbox<Tuning>* changes = nullptr);

  /// From now on a guard tells of the hand. Before start.
  void guard(const TrackingGuard::Options& options) { guard_.emplace(options); }

  /// From now on the tool is turned along the path's orientations as well. Before start.
  void turn(const OrientationFollower::Options& options) { orientation_.emplace(options); }

  void start(const State& first) noexcept override;
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  [[nodiscard]] const ReferenceStream& path() const noexcept { return path_; }

 private:
  /// Where there is no motor there is no error: the reference follows the hand.
  void follow_hand(const State& state, Reference& reference) const noexcept;
  /// Moves reference_ along the path to `time`, or leaves it where it is.
  void follow(const RunningTime& time, Command& command) noexcept;
  Reference advance(double step, Command& command) noexcept;
  void begin_repetition(const Vec3& from) noexcept;
  /// To the reference, wherever on the path it stands.
  void begin_approach(const Vec3& from) noexcept;
  /// 0 while the reference waits for the hand, else 1.
  [[nodiscard]] double wanted_pace() const noexcept {
    return beyond_ && options_.on_deviation == DeviationPolicy::pause ? 0 : 1;
  }
  /// How fast the path's time passes: times its own.
  [[nodiscard]] double pace() const noexcept {
    return phases_.phase() == Phase::run ? options_.speed * pace_.value() : 0;
  }
  void turn_tool(const State& state, double scale, Command& command) noexcept;
  void keep_guard(const State& state, const Reference& reference, Command& command) noexcept;
  /// The scale of the force under the policy; may end or pause the session.
  double watch_deviation(const State& state, const Reference& reference, Command& command) noexcept;

  ReferenceStream path_;
  ForceTerms terms_;
  Tuning tuning_;
  Mailbox<Tuning>* changes_;
  std::optional<TrackingGuard> guard_;
  std::optional<OrientationFollower> orientation_;
  Vec3 feedforward_ = Vec3::Zero();  ///< of the last tick [N]
  PlaybackOptions options_;
  bool has_undriven_axes_;

  RepetitionPhases phases_;
  Ramp approach_pace_{1};  ///< 1 approaching, 0 paused
  RunningTime path_time_;
  Reference reference_;   ///< of the path at path_time_, at its own speed
  bool waiting_ = false;  ///< for the path to be read
  Ramp pace_{1};          ///< 1 running, 0 paused
  bool beyond_ = false;
};

}  // namespace haptrace
