// Running a programme: exercise after exercise, one recording per repetition, and a log that is never behind.
#pragma once

#include "formats/documents/device_profile.h"
#include "formats/documents/session_log.h"
#include "player/session.h"

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// One repetition of a programme.
struct ScheduledTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int round = 1, repetition = 1;
  double rest = 0;  ///< after it [s]
};

/// Every repetition in order: the warm-up once, then the exercises, round by round. None is followed by a rest at the
/// end.
std::vector<ScheduledTrial> schedule(const Programme& programme);

/// What a programme will take.
struct ProgrammePlan {
  struct Part {
    double path_length = 0;    ///< [m]
    double path_duration = 0;  ///< as it was recorded [s]
    double trial = 0;          ///< about, way to the start and hold included [s]
    std::optional<Fit> fit;
  };
  std::vector<Part> parts;  ///< by exercise
  std::vector<Path> paths;  ///< as they are followed
  std::vector<ScheduledTrial> trials;
  double duration = 0;             ///< of all, rests included, about [s]
  std::vector<std::string> notes;  ///< what a person should know
};

/// Reads the paths and checks everything that can be checked without a device, or with one (may be null): its
/// workspace. `folder`: of the programme's file; `where` names it. Throws Error(input).
ProgrammePlan plan_programme(const Programme& programme, const std::string& folder, const std::string& where,
                             const DeviceInfo* device, bool fit);

struct ProgrammeOptions {
  std::string folder;                    ///< of the session
  SessionOptions session;                ///< its recording: what all have in common, without a file
  std::optional<DeviceProfile> profile;  ///< of the device, where it was calibrated; of a session that goes on, its own
  double max_deviation = 0.1;            ///< of what is guided, beyond which the session stops [m]

  /// The device for a trial of `exercise`, whose path this is. Answers the same device again where it has nothing of
  /// its own to show.
  std::function<std::shared_ptr<Device>(const Exercise& exercise, const TrialSettings& settings,
                                        const std::string& path)>
      open;
  const std::atomic<bool>* pause = nullptr;  ///< while true, no trial begins

  std::function<void(const ScheduledTrial&, const TrialSettings&, std::size_t number, std::size_t of)> begins;
  std::function<void(const LoggedTrial&)> ended;
  std::function<void(double seconds_left)> rests;  ///< about ten times a second; NaN: it was paused
};

/// Makes the folder of a session, with its paths, its profile and a log without trials. Throws Error(input) when the
/// folder holds anything; what was made of it is gone again when that fails.
SessionLog begin_session(const nlohmann::json& programme, const std::string& where, const ProgrammePlan& plan,
                         const DeviceInfo& device, const ProgrammeOptions& options);

struct ProgrammeResult {
  SessionLog log;
  std::optional<SessionResult> last;  ///< of the last trial that was begun; nothing when none was
};

/// Goes through what the session in options.folder has not done yet: from the first repetition that was not done.
/// Before and after each the log on the disk is brought up to date, so that a process that dies loses the repetition it
/// was in and nothing else. Rests take no time in virtual time.
///
/// Throws what play, guide and run_session throw before a trial's first force, and Error(input) when the device is
/// another than the session was begun with, or another process runs it. The log keeps why.
ProgrammeResult run_programme(const ProgrammeOptions& options, const StopRequest& stop, const Progress& progress = {});

nlohmann::json to_json(const ProgrammePlan& plan, const Programme& programme);
nlohmann::json to_json(const ProgrammeResult& result);

}  // namespace haptrace
