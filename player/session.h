// One session: a device, a controller, the loop that joins them, and the recording of it.
#pragma once

#include "control/warning.h"
#include "devices/loop/servo_loop.h"
#include "player/tuning/live_monitor.h"
#include "recorder/recorder.h"
#include "scene/scene_controller.h"

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

/// Which clock drives a session.
enum class ClockChoice {
  automatic,  ///< virtual for virtual-time devices, else real
  real,
  virtual_time,
};

ClockChoice parse_clock(std::string_view name);  ///< "real" | "virtual" | "auto"; throws Error(input)

struct SessionOptions {
  ServoLoop::Options loop;  ///< `clock` decides about its virtual time
  ClockChoice clock = ClockChoice::automatic;
  std::string velocity = "lowpass:100";            ///< see make_velocity_estimator
  std::vector<Warning> known;                      ///< before the session, and shown by then: the first of its warnings
  std::function<std::vector<Warning>()> warnings;  ///< further ones; asked whenever a view is made
  std::function<std::vector<Warning>()> conclusions;  ///< further ones; asked once, when the loop has ended

  struct Recording {
    std::string file;
    Recorder::Options options;
    std::string title, subject, operator_name, notes;
    std::map<std::string, std::string> meta;
    nlohmann::json config = nlohmann::json::object();
    bool end_when_disk_is_low =
        false;  ///< the session ends before the disk is full, when there is nothing but to record
  };
  std::optional<Recording> recording;
};

/// A running session, for a person to look at.
struct SessionView {
  LiveStatus live;
  std::optional<Recorder::Status> recording;
  std::vector<Warning> warnings;  ///< since the last view, to be shown at once
};

/// What a session was like, and what of it is on the disk.
struct SessionResult {
  ServoReport servo;
  bool virtual_time = false;
  std::optional<Recorder::Status> recording;
  std::string recording_error;                  ///< what the disk refused, in words; empty when all is on it
  bool ended_by_disk = false;                   ///< see end_when_disk_is_low
  ZeroForce zero_force = ZeroForce::confirmed;  ///< what is known of the motors since
  std::vector<TouchFigures> touches;            ///< of each object of the scene that could be touched
  std::vector<Warning> warnings;                ///< all of them; events of a kind are one
  double gain_share = 1;                        ///< of the feedback gains that was in force at the end, after softening

  /// Adds a warning that is known only now.
  void warn(Warning::Severity severity, const char* code, std::string text) {
    warnings.push_back({severity, code, kNaN, std::move(text)});
  }

  /// False when something of the session is not on the disk.
  [[nodiscard]] bool recorded_all() const noexcept {
    return recording_error.empty() && !ended_by_disk && (!recording || recording->lost == 0);
  }
};

/// Called about ten times a second in the thread that called run_session.
using Progress = std::function<void(const SessionView&)>;

/// Runs one session to its end: the loop in a thread of its own, the recorder in another. `columns.reference` and
/// `columns.guidance` say what the controller fills; the device decides the others. Zero force has been sent when it
/// returns or throws. Throws what ServoLoop, Recorder and make_velocity_estimator throw before the first tick; what
/// goes wrong later is in the result.
SessionResult run_session(Device& device, Controller& controller, RecordingColumns columns,
                          std::span<SampleSink* const> sinks, const SessionOptions& options, const StopRequest& stop,
                          const Progress& progress = {});

/// The texts of notes that were made before a session, as its first warnings.
std::vector<Warning> known_warnings(Warning::Severity severity, const char* code, std::span<const std::string> texts);

/// The JSON of a session: samples, duration_s, overruns, latency_s, tick_s, stopped_by, warnings and what else there is
/// to report. "notices" holds the texts of the warnings for programs of before there were any.
nlohmann::json to_json(const SessionResult& result);
nlohmann::json to_json(const VibrationSummary& vibration);
nlohmann::json to_json(const DurationHistogram& durations);  ///< p50, p99, p999, max [s]

/// `software` of recordings: name and version.
const char* software_name() noexcept;

}  // namespace haptrace
