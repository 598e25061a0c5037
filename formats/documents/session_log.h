// A session of a programme on the disk: a folder with one recording per repetition, the paths as they were followed,
// the device's profile where it was calibrated, and session.json, which says what was done.
#pragma once

#include "formats/documents/device_profile.h"
#include "formats/documents/programme.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// What an exercise was set to for one repetition; see Exercise. Of what its mode does not use, the value means
/// nothing.
struct TrialSettings {
  double pace = 1;
  double radius = 0;                ///< [m]
  std::optional<double> stiffness;  ///< [N/m]
  double assistance = 1;            ///< 0 to 1
  double level = 0;                 ///< of difficulty, 0 to 1

  bool operator==(const TrialSettings&) const = default;
};

/// One repetition that was begun.
struct LoggedTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int round = 1, repetition = 1;
  int attempt = 1;  ///< more than 1 when the ones before did not come to their end
  TrialSettings settings;
  std::string file;        ///< its recording, from the session's folder
  std::string began;       ///< RFC 3339
  double duration = 0;     ///< of its session, way to the start included [s]
  double force_dose = 0;   ///< [N s]
  std::string stopped_by;  ///< "finished", "time_over", or what else ended it (StopCause); empty while it runs
  std::string detail;      ///< in words, where there is more to say
  std::vector<std::string> notices;
  nlohmann::json figures;  ///< to_json(TrialFigures); null when it was stopped

  [[nodiscard]] bool finished() const { return stopped_by == "finished"; }
  /// It need not be done again: the person came to the end, or his time was over.
  [[nodiscard]] bool done() const { return finished() || stopped_by == "time_over"; }
};

/// From when somebody sat down until he got up.
struct Sitting {
  std::string began, ended;  ///< RFC 3339; `ended` is empty while it lasts, and when the process died
  std::string ended_by;      ///< "complete" | "time" | "force_dose" | "fatigue" | "stopped" | "interrupted"
  std::string detail;
  std::size_t first_trial = 0;
  double duration = 0;    ///< rests included [s]
  double force_dose = 0;  ///< [N s]
};

struct SessionLog {
  std::string created, software;
  std::string subject, operator_name, notes;
  DeviceIdentity device;
  nlohmann::json programme;                          ///< as it was read
  nlohmann::json config = nlohmann::json::object();  ///< of the command that began it: every sitting goes by it
  std::string fit;  ///< how the paths were moved and scaled into the workspace, in words; empty when they were not
  std::vector<std::string> paths;  ///< by exercise, from the session's folder
  std::vector<Sitting> sittings;
  std::vector<LoggedTrial> trials;  ///< in the order in which they were begun
  bool complete = false;
};

inline constexpr const char* kSessionFile = "session.json";
inline constexpr const char* kSessionProfile = "profile.json";  ///< a DeviceProfile; absent without calibration

/// While it lives, no other process runs this session: one of two logs would be lost.
class SessionLock {
 public:
  /// Throws Error(input): the folder is missing, or another process runs the session.
  explicit SessionLock(const std::string& folder);
  ~SessionLock();
  SessionLock(const SessionLock&) = delete;
  SessionLock& operator=(const SessionLock&) = delete;

 private:
  int folder_;
};

/// Replaces session.json in `folder`; what stood there stays until the new one is complete. Throws Error(fault) or
/// Error(input): the folder is missing, the disk refuses.
void save_session_log(const SessionLog& log, const std::string& folder);

/// `where`: the folder, or the file in it. Throws Error(input) naming the file and the key.
SessionLog load_session_log(const std::string& where);

/// Whether `where` is a folder that holds a session, or the session.json of one.
bool is_session(const std::string& where);

}  // namespace haptrace
