// Playback of a path on a device.
#pragma once

#include "control/design/identified_device.h"
#include "control/force_table.h"
#include "control/gain_profile.h"
#include "control/path/path.h"
#include "control/tuning.h"
#include "formats/documents/impedance_profile.h"
#include "formats/path/path_stretching.h"
#include "player/playback/playback_options.h"
#include "player/playback/tracking_figures.h"
#include "player/session.h"

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

namespace haptrace {

class LiveSession;
class LiveTuning;
class PathSource;
class TrajectoryPieces;

inline constexpr int kMostLearned = 1000;  ///< largest number of learned repetitions per session

/// Law of a playback that cancels the load.
enum class TrackingLaw : std::uint8_t {
  observer,  ///< PD gains on the state of an observer (ObserverPd)
  lqg,       ///< state feedback on a Kalman filter's estimate (LqgLaw)
};
const char* to_string(TrackingLaw law) noexcept;
TrackingLaw parse_tracking_law(std::string_view name);  ///< throws Error(input)

struct PlayOptions {
  std::optional<PdGains> gains;               ///< absent: those of the identified device, or cautious_gains
  std::optional<ImpedanceProfile> impedance;  ///< gains along the path, in place of `gains`
  /// Result of a calibration. Without it, the controller is a plain PD law.
  std::optional<IdentifiedDevice> identified;
  Compensations compensations{true, true, true, true, true, true};  ///< for an identified device
  /// Law of an identified device whose load is cancelled. An LQG law has gains of its own: with `gains` or `impedance`,
  /// and for a device that was identified without laws, the law is that with an observer. If neither law nor firmness
  /// is given, the playback takes the first of these that its trial did not refuse: LQG of firmness normal, quiet, the
  /// observer, plain PD control.
  std::optional<TrackingLaw> law;
  std::optional<Firmness> firmness;  ///< of an LQG law; absent: normal
  int learn = 0;                     ///< number of repetitions to learn from, up to kMostLearned
  ForceTable learned;                ///< learned force of earlier sessions, or empty
  bool guard = true;                 ///< soften when the loop vibrates; report a hand that resists or lets go
  bool watch_release = true;         ///< report a hand that lets go; false where the movement looks like that
  bool find_oscillations = false;  ///< report small oscillations too (OscillationMonitor, needs the delay); for studies
  Interpolation interpolation = Interpolation::cubic;
  /// Time constant of the path's smoothing [s], see smooth_positions(). Absent: chosen from the noise of the positions;
  /// 0: the trajectory passes through every sample.
  std::optional<double> smoothing;
  int thin = 1;      ///< keep every N-th sample of the path, see thinned()
  bool fit = false;  ///< move and scale the path into the workspace
  TurnOptions turn;
  PlaybackOptions playback;
  SessionOptions session;
  std::vector<SampleSink*> sinks;  ///< borrowed; receive every sample and event
  /// Borrowed, may be null. Changes the tuning during the playback, which starts with plan.tuning. Its notices become
  /// warnings of the session.
  LiveTuning* tuning = nullptr;
  /// Borrowed, may be null. Commands about the whole session, for a playback without `tuning`.
  LiveSession* live = nullptr;
};

/// Playback that was checked against a device and is ready to run. No force has been sent yet.
struct PlayPlan {
  std::shared_ptr<const TrajectoryPieces> path;  ///< the path as it will be played
  std::optional<Fit> fit;
  TimeStretch stretch;                ///< of the path's own time, where it would be too fast
  Tuning tuning;                      ///< initial tuning; with `schedule`, its gains are the largest ones of each axis
  std::optional<GainTable> schedule;  ///< gains along the path as it will be played
  Compensations composed;             ///< terms of the law besides PD
  /// The laws in place of the PD law with an observer. The gains of `tuning` are then their stiffness and damping.
  std::optional<std::array<std::optional<LqgLaws>, 3>> lqg;
  /// Gains of plain PD control that stands in for the law from the next repetition on, if it vibrates (StandInLaw).
  std::optional<PdGains> stand_in;
  Firmness firmness = Firmness::normal;  ///< of these laws
  double peak_speed = 0;                 ///< peak speed of the reference [m/s]
  /// Present when the playback also controls the tool's orientation.
  std::optional<OrientationOptions> turn;
  std::vector<std::string> notes;  ///< messages for the user
};

/// Checks the playback before a force is sent: the path against the workspace (the error names the distance), the gains
/// and the options. Where the path would move faster than 0.9 of the velocity limit, its time is stretched, up to
/// kMostStretch; a note says where and by how much. Reads only those blocks of a long path whose bounds are not
/// conclusive. The session examines each later piece between its samples before it plays it, and ends with
/// StopCause::no_path if the check fails. Throws Error(input).
PlayPlan plan_playback(const DeviceInfo& device, std::shared_ptr<const PathSource> path, const PlayOptions& options);
PlayPlan plan_playback(const DeviceInfo& device, Path path, const PlayOptions& options);

struct PlayResult {
  SessionResult session;
  PlayPlan plan;
  std::vector<TrackingFigures> repetitions;
  TrackingFigures last;
  std::vector<Lesson> lessons;  ///< results of the repetitions to learn from
  ForceTable learned;           ///< empty without learning
  Tuning tuning;                ///< tuning at the end, as requested

  /// Number of repetitions after which plain PD control stood in for the law; absent: never.
  std::optional<std::size_t> stood_in;

  /// Returns the gains in force at the end. They are softer than `tuning.gains` after a vibration, and those of plain
  /// PD control if that stands in for the law.
  [[nodiscard]] PdGains gains_in_force() const;
};

/// Returns the path of a playback, for a view. Throws what PathSource::read throws.
FollowedPath followed_path(const TrajectoryPieces& pieces);

/// Returns a sentence that says how much closer stiff PD control was in the trials of a calibration than the law that
/// playbacks choose; empty if it was not.
std::string stiff_text(const TrackingDesign& design);

/// Plays `plan` on `device`. A thread of the session reads the path meanwhile.
PlayResult play(Device& device, const PlayPlan& plan, const PlayOptions& options, const StopRequest& stop,
                const Progress& progress = {});

/// Refuses the law of a playback for later ones if it vibrated and was softened: it would do so again. The verdict
/// stays if the law may not have been the cause (other gains than its own, a scene, a rule that is no proof), and for
/// plain PD control. `now`: RFC 3339. Returns what to tell the user; an empty text if the verdict stays.
std::string refuse_vibrated(const PlayResult& result, const PlayOptions& options, const std::string& now,
                            IdentifiedDevice& device);

nlohmann::json to_json(const PlayResult& result);
nlohmann::json to_json(const PdGains& gains);

/// Reads {"kp": number or [x, y, z], "kd": ...}. Throws Error(input) that names the key.
PdGains gains_from_json(const nlohmann::json& json, const std::string& where);

}  // namespace haptrace
