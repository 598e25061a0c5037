// Playing a recording back.
#pragma once

#include "control/design/tracking_design.h"
#include "control/path/path.h"
#include "control/path/trajectory.h"
#include "control/pd.h"
#include "player/playback/learning.h"
#include "player/playback/playback_controller.h"
#include "player/playback/reference_stream.h"
#include "player/playback/tracking_metrics.h"
#include "player/session.h"
#include "player/tuning/live_tuning.h"

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

namespace haptrace {

inline constexpr int kMostLearned = 1000;  ///< repetitions of one session

/// How a path's orientations are followed, where the path has some and the device takes torque in every axis.
struct TurnOptions {
  bool off = false;
  std::optional<OrientationGains> gains;  ///< when absent: cautious_orientation_gains
  double max_deviation = 1;               ///< from the orientation of the reference [rad]
};

/// The torque limit [N m] is reached at 20 degrees, and kd = 20 ms * kp.
OrientationGains cautious_orientation_gains(double max_torque);

struct PlayOptions {
  std::optional<PdGains> gains;  ///< when absent: those of the identified device, or cautious_gains
  /// What calibration found. Without it, nothing but a PD law is sent.
  std::optional<IdentifiedDevice> identified;
  Compensations compensations{true, true, true, true, true};  ///< of an identified device
  int learn = 0;                                              ///< repetitions to learn from, up to kMostLearned
  ForceTable learned;                                         ///< in earlier sessions, or empty
  bool guard = true;               ///< soften when the loop vibrates, tell of a hand that resists or lets go
  bool find_oscillations = false;  ///< small ones as well, by OscillationMonitor, which needs the delay; for studies
  Interpolation interpolation = Interpolation::cubic;
  /// Time constant of the path's smoothing [s], see smooth_positions(): when absent, as much as the noise in its
  /// positions asks for; 0 passes through every sample.
  std::optional<double> smoothing;
  int thin = 1;      ///< of the path every so many-th sample is kept, see thinned()
  bool fit = false;  ///< move and scale the path into the workspace
  TurnOptions turn;
  PlaybackOptions playback;
  SessionOptions session;
  std::vector<SampleSink*> sinks;  ///< borrowed: see every row and event too
  /// Borrowed, may be null: changes the tuning while the plan is played, from plan.gains on if it starts with them. Its
  /// notices become the session's.
  LiveTuning* tuning = nullptr;
};

/// A playback that was checked against a device and is ready to run: nothing has been sent yet.
struct PlayPlan {
  TrajectoryPieces path;  ///< as it will be played
  std::optional<Fit> fit;
  Tuning tuning;           ///< to begin with
  Compensations composed;  ///< what the law is made of, beside the PD law
  double peak_speed = 0;   ///< of the reference [m/s]
  /// The tool is turned too.
  std::optional<OrientationFollower::Options> turn;
  std::vector<std::string> notes;  ///< what a person should know of the plan
};

/// Checks everything that can be checked before a force is sent: the path against the workspace (an error names the
/// distance), its speed against the velocity limit, the gains, the options. Of a long path it reads only what its
/// figures do not clear; what that leaves unseen between samples is looked at again before it is played, and ends the
/// session with StopCause::no_path. Throws Error(input).
PlayPlan plan_playback(const DeviceInfo& device, std::shared_ptr<const PathSource> path, const PlayOptions& options);
PlayPlan plan_playback(const DeviceInfo& device, Path path, const PlayOptions& options);

struct PlayResult {
  SessionResult session;
  PlayPlan plan;
  std::vector<TrackingFigures> repetitions;
  TrackingFigures last;
  std::vector<LearningTerm::Lesson> lessons;  ///< of the repetitions that were to be learned from
  ForceTable learned;                         ///< empty without learning
  Tuning tuning;                              ///< at the end, as it was wanted

  /// What of its gains was in force at the end: a loop that oscillated has softer ones.
  [[nodiscard]] PdGains gains_in_force() const {
    return {session.gain_share * tuning.gains.kp, session.gain_share * tuning.gains.kd};
  }
};

/// The controller that play() runs, for sessions of another kind. It does not learn: what of `options` is learned is
/// what was learned before.
PlaybackController playback_controller(const DeviceInfo& device, const PlayPlan& plan, const PlayOptions& options);

/// Plays `plan` on `device`. Its path is read by a thread of the session meanwhile.
PlayResult play(Device& device, const PlayPlan& plan, const PlayOptions& options, const StopRequest& stop,
                const Progress& progress = {});

nlohmann::json to_json(const PlayResult& result);
nlohmann::json to_json(const PdGains& gains);

/// Reads {"kp": number or [x, y, z], "kd": ...}. Throws Error(input) naming the key.
PdGains gains_from_json(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
