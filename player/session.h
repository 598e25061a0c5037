// Runs a session: a device, a controller, the servo loop that connects them, and the recording.
#pragma once

#include "base/stop_request.h"
#include "control/controller.h"
#include "control/design/plant_model.h"
#include "control/warning.h"
#include "devices/device.h"
#include "devices/loop/servo_session.h"
#include "formats/recording/recording.h"
#include "recorder/recorder_options.h"
#include "scene/scene_session.h"

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Clock that drives a session.
enum class ClockChoice {
  automatic,  ///< virtual for virtual-time devices, else real
  real,
  virtual_time,
};

ClockChoice parse_clock(std::string_view name);  ///< "real" | "virtual" | "auto"; throws Error(input)

template <class T>
class Mailbox;
class Scene;
struct SessionRequests;
struct SessionView;
struct SessionResult;
struct SessionOptions;

/// The path that a session follows, for a view of it: at most kMostPathPoints points in the order of the movement.
struct FollowedPath {
  static constexpr std::size_t kMostPathPoints = 4000;

  std::string mode;            ///< of the guidance: "tunnel", "cursor", "free", or a ReachGoal; empty for a playback
  std::vector<double> time;    ///< at which the recorded movement reaches each point [s]
  std::vector<Vec3> position;  ///< in W [m]
  std::vector<double> radius;  ///< of the tunnel at each point [m]; empty: no tunnel
};

/// Watches a session from outside its loop, as a live view does.
///
/// Threads: all but sink() are called in the thread that called run_session.
class SessionObserver {
 public:
  virtual ~SessionObserver() = default;

  /// Returns the sink that receives every sample and event, in the servo loop.
  [[nodiscard]] virtual SampleSink& sink() noexcept = 0;

  /// Called before the first tick. The arguments outlive the session.
  virtual void begins(Device& device, const SessionOptions& options, const RecordingColumns& columns,
                      bool virtual_time) = 0;

  /// Called about ten times a second.
  virtual void shows(const SessionView& view) = 0;

  /// Called after the last tick, when the result is complete.
  virtual void ends(const SessionResult& result) = 0;
};

/// The scene that the hand touches in a session, beside what its controller does.
struct TouchOptions {
  std::shared_ptr<Scene> scene;                  ///< null: none
  std::optional<SlowSceneOptions> slow;          ///< present when the scene runs slower than the loop
  std::optional<PlantModel> plant;               ///< calibrated model of the device, for the scene's passivity layer
  Mailbox<SessionRequests>* requests = nullptr;  ///< borrowed, may be null: the scene's force follows their share
  bool rests_in_pause = false;                   ///< a pause that they ask for fades the scene's force out
};

/// Support of the arm in a session, beside what its controller does (ArmSupport).
struct SupportOptions {
  double force = 0;         ///< part of the arm's weight that the device carries [N]; 0: none, unless it is adjustable
  bool adjustable = false;  ///< a command may raise it from 0
  Vec3 up = Vec3::UnitY();  ///< unit vector upwards, in W

  [[nodiscard]] bool acts() const noexcept { return force != 0 || adjustable; }
};

struct SessionOptions {
  ServoOptions loop;  ///< `clock` decides about its virtual time
  ClockChoice clock = ClockChoice::automatic;
  std::string velocity = "lowpass:100";            ///< see make_velocity_estimator
  std::vector<Warning> known;                      ///< before the session, and shown by then: the first of its warnings
  std::function<std::vector<Warning>()> warnings;  ///< further ones; asked whenever a view is made
  SessionObserver* observer = nullptr;             ///< borrowed; null: none
  FollowedPath followed;                           ///< for the observer; play() and guide() fill it
  TouchOptions touch;  ///< what the hand can touch; record(), play() and guide() fill its last three
  SupportOptions support;

  struct Recording {
    std::string file;
    RecorderOptions options;
    std::string title, subject, operator_name, notes;
    std::map<std::string, std::string> meta;
    nlohmann::json config = nlohmann::json::object();
    bool end_when_disk_is_low = false;  ///< end the session before the disk is full; for sessions that only record
  };
  std::optional<Recording> recording;

  /// Adds a source to those of `warnings`.
  void also_warn(std::function<std::vector<Warning>()> more);
};

/// Current status of a session.
struct LiveStatus {
  double time = 0;          ///< since the first tick [s]
  double rate = 0;          ///< ticks per second of the session's clock, since the first tick [Hz]
  double jitter = 0;        ///< largest wake-up latency since the last status [s]
  double force = 0;         ///< magnitude sent [N]
  double deviation = kNaN;  ///< distance from the reference [m]
  double speed = 0;         ///< speed of the tool [m/s]
  Phase phase = Phase::idle;
  std::uint64_t samples = 0;
  std::uint64_t overruns = 0;
  std::uint64_t losses = 0;  ///< number of times the device was lost
  bool away = false;         ///< the device is lost
};

/// Status of a running session with its recording and its news, for display.
struct SessionView {
  LiveStatus live;
  std::optional<RecorderStatus> recording;
  std::vector<Warning> warnings;  ///< warnings since the last view, to be shown at once
};

/// Result of a session, including the state of its recording.
struct SessionResult {
  ServoReport servo;
  bool virtual_time = false;
  std::optional<RecorderStatus> recording;
  std::string recording_error;                  ///< error message of the recording; empty if it succeeded
  bool ended_by_disk = false;                   ///< see end_when_disk_is_low
  ZeroForce zero_force = ZeroForce::confirmed;  ///< known state of the motors after the session
  std::vector<TouchFigures> touches;            ///< contact metrics of each touchable object of the scene
  std::vector<Warning> warnings;                ///< all warnings; one for each kind of event
  double support = 0;                           ///< force that carried the arm at the end, once it had risen [N]
  double gain_share = 1;                        ///< share of the feedback gains in force at the end, after softening

  /// Adds a warning after the session.
  void warn(Severity severity, const char* code, std::string text) {
    warnings.push_back({severity, code, kNaN, std::move(text)});
  }

  /// Returns false when part of the session is missing on the disk.
  [[nodiscard]] bool recorded_all() const noexcept {
    return recording_error.empty() && !ended_by_disk && (!recording || recording->lost == 0);
  }
};

/// Called about ten times a second in the thread that called run_session.
using Progress = std::function<void(const SessionView&)>;

/// Runs one session to its end, with the loop and the recorder in threads of their own. `columns.reference` and
/// `columns.guidance` say which columns the controller fills; the device and the scene determine the others. The force
/// of the scene in `options.touch` and the support of the arm are added to that of `controller` (TouchingController,
/// SupportingController). Zero force has been sent when the function returns or throws. Throws what ServoLoop,
/// Recorder, make_velocity_estimator, make_scene_controller and plan_support throw before the first tick; the result
/// reports later errors.
SessionResult run_session(Device& device, Controller& controller, RecordingColumns columns,
                          std::span<SampleSink* const> sinks, const SessionOptions& options, const StopRequest& stop,
                          const Progress& progress = {});

/// Returns warnings with the given texts and no time, one for each text.
std::vector<Warning> known_warnings(Severity severity, const char* code, std::span<const std::string> texts);

/// Returns the JSON of a session: samples, duration_s, overruns, latency_s, tick_s, stopped_by, warnings and further
/// results. "notices" holds the texts of the warnings for programs that predate "warnings".
nlohmann::json to_json(const SessionResult& result);
nlohmann::json to_json(const VibrationSummary& vibration);
nlohmann::json to_json(const DurationHistogram& durations);  ///< keys p50, p99, p999, max [s]

/// Returns the name and version for the `software` field of recordings.
const char* software_name() noexcept;

}  // namespace haptrace
