// Files of a session of a programme: a folder with one recording per repetition, the paths as they were followed, the
// device's profile if it was calibrated, and session.json, the log.
#pragma once

#include "control/initiation.h"
#include "formats/documents/device_profile.h"
#include "formats/documents/programme.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Settings of an exercise for one repetition; see Exercise. Values that its mode does not use have no meaning.
struct TrialSettings {
  double pace = 1;
  double radius = 0;                  ///< [m]
  std::optional<double> stiffness;    ///< [N/m]
  double assistance = 1;              ///< 0 to 1
  double level = 0;                   ///< of difficulty, 0 to 1
  std::optional<double> force_scale;  ///< factor on the expert's force, if a command changed it
  std::optional<double> start_hold;   ///< of a reach: hold in the start before the cue [s]
  std::optional<double> support;      ///< part of the arm's weight that the device carried [N]

  bool operator==(const TrialSettings&) const = default;
};

/// One repetition that was started.
struct LoggedTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int round = 1, repetition = 1;
  int attempt = 1;  ///< above 1 if the earlier ones did not reach their end
  TrialSettings settings;
  std::string file;         ///< recording, relative to the session's folder
  std::string began;        ///< RFC 3339
  double duration = 0;      ///< of its session, including the approach to the start [s]
  double force_dose = 0;    ///< [N s]
  std::string stopped_by;   ///< "finished", "time_over", "skipped", or another cause (StopCause); empty while it runs
  std::string detail;       ///< further explanation, if there is any
  std::string input;        ///< of a person who steered a simulated hand ("view"): no measure of skill; else empty
  bool unattended = false;  ///< softened because the controlling page was lost: it teaches the programme nothing
  std::optional<ShownParts> shown;  ///< to the trainee; absent in logs of older versions
  std::vector<std::string> notices;
  nlohmann::json figures;                ///< to_json(TrialFigures); null if it was stopped
  std::optional<Initiation> initiation;  ///< with a back wall
  std::optional<PlannedReach> reach;     ///< of an exercise with a cue
  std::optional<ReachTrial> places;      ///< its places and field, as they were used
  std::optional<SenseTrial> sense;       ///< of an exercise in mode sense, with its answer

  [[nodiscard]] bool finished() const { return stopped_by == "finished"; }
  [[nodiscard]] bool skipped() const { return stopped_by == "skipped"; }  ///< by a command
  /// Returns true if the participant came as far as they could until their time was over. It counts, with its share of
  /// the path (`completion` of the figures), but ranks below every finished repetition.
  [[nodiscard]] bool partial() const { return stopped_by == "time_over"; }
  /// Returns true if it need not be repeated: the participant reached the end, their time was over, or a command
  /// skipped it.
  [[nodiscard]] bool done() const { return finished() || partial() || skipped(); }
};

nlohmann::json json_of(const Initiation& initiation);

/// One stay of the participant at the device.
struct Sitting {
  std::string began, ended;  ///< RFC 3339; `ended` is empty during the sitting, and if the process died
  std::string ended_by;      ///< "complete" | "time" | "force_dose" | "fatigue" | "stopped" | "interrupted"
  std::string stopped_from;  ///< "user" | "page" | "lost_page" | "command" if it was interrupted; else empty
  std::string detail;
  std::size_t first_trial = 0;
  double duration = 0;    ///< including rests [s]
  double force_dose = 0;  ///< [N s]
};

/// One repetition that is to be done.
struct PlannedTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int round = 1, repetition = 1;
  std::optional<PlannedReach> reach;  ///< of an exercise with a cue
  std::optional<SenseTrial> sense;    ///< of an exercise in mode sense

  bool operator==(const PlannedTrial&) const = default;
};

struct SessionLog {
  std::string created, software;
  std::string subject, operator_name, notes;
  DeviceIdentity device;
  nlohmann::json programme;                          ///< as it was read
  nlohmann::json config = nlohmann::json::object();  ///< of the command that started it: it applies to every sitting
  std::string fit;  ///< description of how the paths were moved and scaled into the workspace; empty if they were not
  std::vector<PlannedTrial> schedule;  ///< of a random order, all of it; empty: the order of the programme
  std::string generator;               ///< that drew it from the programme's seed
  std::vector<std::string> paths;      ///< by exercise, relative to the session's folder
  std::vector<Sitting> sittings;
  std::vector<LoggedTrial> trials;  ///< in the order of their start
  bool complete = false;
};

inline constexpr const char* kSessionFile = "session.json";
inline constexpr const char* kSessionProfile = "profile.json";  ///< a DeviceProfile; absent without calibration

/// Prevents other processes from running this session: one of two logs would be lost.
class SessionLock {
 public:
  /// Throws Error(input) if the folder is missing or another process runs the session.
  explicit SessionLock(const std::string& folder);
  ~SessionLock();
  SessionLock(const SessionLock&) = delete;
  SessionLock& operator=(const SessionLock&) = delete;

 private:
  int folder_;
};

/// Replaces session.json in `folder`; the old file stays until the new one is complete. Throws Error(input) if the
/// folder is missing or a write to the disk fails.
void save_session_log(const SessionLog& log, const std::string& folder);

/// Reads a session. `where`: the folder, or the file in it. Throws Error(input) naming the file and the key.
SessionLog load_session_log(const std::string& where);

/// Returns true if `where` is a folder that holds a session, or the session.json of one.
bool is_session(const std::string& where);

}  // namespace haptrace
