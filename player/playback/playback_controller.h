// Controller that follows a path in repetitions.
#pragma once

#include "base/mailbox.h"
#include "base/running_time.h"
#include "control/controller.h"
#include "control/gain_profile.h"
#include "control/limits.h"
#include "control/pd.h"
#include "player/playback/orientation_follower.h"
#include "player/playback/playback_options.h"
#include "player/playback/reference_stream.h"
#include "player/playback/tracking_guard.h"
#include "player/repetition_phases.h"
#include "player/tuning/session_requests.h"

#include <array>
#include <memory>
#include <string_view>
#include <vector>

namespace haptrace {

struct DeviceInfo;
struct PlayOptions;
struct PlayPlan;

/// Follows a trajectory with the sum of its terms: F = sum_i term_i(x, x_d). Except during the approach to its start,
/// the reference has a time on the path.
///
/// approach: a minimum-jerk movement from the tool's position to the start of the path.
/// run: the reference x_d(t) moves along the path; t advances by speed * dt.
/// hold: the reference rests at the end.
/// The reference never jumps. After a stall of the loop, the path's time advances by at most five ticks, so that the
/// reference does not pull the hand after it. If the path has not been read in time, its time stands still until it
/// has. It also stands still while the device is away: the reference then moves by minimum jerk from the tool's
/// position to its last place (phase approach) and continues there.
class PlaybackController final : public Controller {
 public:
  /// Starts with `tuning` and approaches the tunings that arrive in `changes`, if it is not null. `changes` must
  /// outlive the controller.
  PlaybackController(ReferenceStream path, ForceTerms terms, const Tuning& tuning, const PlaybackOptions& options,
                     Mailbox<Tuning>* changes = nullptr);

  /// From now on a guard tells of the hand. Before start.
  void guard(const TrackingGuard::Options& options) { guard_.emplace(options); }

  /// From now on the tool is turned along the path's orientations as well. Before start.
  void turn(const OrientationOptions& options) { orientation_.emplace(options); }

  /// From now on the gains are those of the tuning times the shares of a table along the path. Before start.
  void schedule(GainTable table) { schedule_.emplace(std::move(table)); }

  /// Obeys the requests that arrive in `requests`, which must outlive the controller: while a pause lasts, the
  /// reference stands still. Before start.
  void obey(Mailbox<SessionRequests>& requests) noexcept { mailbox_ = &requests; }

  void start(const State& first) noexcept override;
  void resume(const State& first) noexcept override;
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override;

  [[nodiscard]] const ReferenceStream& path() const noexcept { return path_; }

 private:
  /// Where there is no motor there is no error: the reference follows the hand.
  void follow_hand(const State& state, Reference& reference) const noexcept;
  /// Moves reference_ along the path to `time`, or leaves it in place while the path is not readable.
  void follow(const RunningTime& time, Command& command) noexcept;
  Reference advance(double step, Command& command) noexcept;
  void begin_repetition(const Vec3& from) noexcept;
  /// Begins an approach to the reference at its current place on the path.
  void begin_approach(const Vec3& from) noexcept;
  /// Follows the requests.
  void follow_requests(double dt) noexcept;
  /// Returns 0 while the reference waits for the hand or is to stand still, else 1.
  [[nodiscard]] double wanted_pace() const noexcept {
    return requests_.paused() || skips_ || (beyond_ && options_.on_deviation == DeviationPolicy::pause) ? 0 : 1;
  }
  /// How fast the path's time passes: times its own.
  [[nodiscard]] double pace() const noexcept {
    return phases_.phase() == Phase::run ? options_.speed * pace_.value() : 0;
  }
  void turn_tool(const State& state, double scale, Command& command) noexcept;
  void keep_guard(const State& state, const Reference& reference, Command& command) noexcept;
  /// Returns the scale of the force under the policy. May end the session or pause the reference.
  double watch_deviation(const State& state, const Reference& reference, Command& command) noexcept;

  ReferenceStream path_;
  ForceTerms terms_;
  Tuning tuning_;
  Mailbox<Tuning>* changes_;
  std::optional<TrackingGuard> guard_;
  std::optional<OrientationFollower> orientation_;
  std::optional<GainSchedule> schedule_;
  Vec3 feedforward_ = Vec3::Zero();  ///< feedforward force of the last tick [N]
  PlaybackOptions options_;
  bool has_undriven_axes_;

  RepetitionPhases phases_;
  Ramp approach_pace_{1};  ///< 1 approaching, 0 paused
  RunningTime path_time_;
  Reference reference_;   ///< reference on the path at path_time_, at the path's own speed
  bool waiting_ = false;  ///< the path has not been read yet
  Ramp pace_{1};          ///< 1: running, 0: paused
  bool beyond_ = false;
  Mailbox<SessionRequests>* mailbox_ = nullptr;
  RequestFollower requests_;
  bool skips_ = false;  ///< the reference comes to rest, and the repetition ends
};

/// The controller that play() runs, for sessions of another kind. It does not learn: what of `options` is learned is
/// what was learned before.
PlaybackController playback_controller(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options);

}  // namespace haptrace
