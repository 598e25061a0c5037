// Runs the exercises of a programme, with one recording per repetition and a log that is always up to date.
#pragma once

#include "formats/documents/device_profile.h"
#include "formats/documents/session_log.h"
#include "player/guidance/live_guidance.h"
#include "player/session.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// One repetition of a programme.
struct ScheduledTrial {
  std::size_t exercise = 0;  ///< see Programme::exercise
  int round = 1, repetition = 1;
  double rest = 0;                    ///< rest after the repetition [s]
  std::optional<PlannedReach> reach;  ///< of an exercise with a cue
  std::optional<SenseTrial> sense;    ///< of an exercise in mode sense
};

/// One repetition, as it is announced to a trainee.
struct TrainingTrial {
  std::string exercise, mode;           ///< name of the exercise, and of its mode
  std::size_t number = 1, of = 1;       ///< among all repetitions that are left
  int repetition = 1, repetitions = 1;  ///< of the exercise, in its round
  ShownParts show{true, true, true, true, true};
  std::string next;  ///< name of the next exercise; empty after the last repetition
};

/// Returns every repetition in order: the warm-up once, then the exercises, round by round, as the programme's order
/// asks (trial_order.h); a random order without a seed takes that of seed 0. The same generator then draws the reaches
/// or pairs of places of every exercise and round (reach_order.h). The last repetition has no rest. Throws Error(input)
/// like order_of_round() and order_of_reaches().
std::vector<ScheduledTrial> schedule(const Programme& programme);

/// Returns the same with a seed drawn from the operating system, if the programme needs one and states none.
nlohmann::json with_seed(nlohmann::json programme, const std::string& where);

/// Paths, repetitions and expected duration of a programme.
struct ProgrammePlan {
  struct Part {
    double path_length = 0;    ///< [m]
    double path_duration = 0;  ///< duration as recorded [s]
    double trial = 0;          ///< expected duration of a repetition, with approach and hold [s]
    std::optional<Fit> fit;
  };
  std::vector<Part> parts;  ///< indexed by exercise
  std::vector<Path> paths;  ///< paths as they will be followed
  std::vector<ScheduledTrial> trials;
  double duration = 0;             ///< expected duration of all repetitions, with rests [s]
  std::vector<std::string> notes;  ///< messages for the user
};

/// Reads the paths and checks the programme and, if `device` is not null, its paths against the workspace. `folder`:
/// folder of the programme's file; `where` names the file in messages. Throws Error(input).
ProgrammePlan plan_programme(const Programme& programme, const std::string& folder, const std::string& where,
                             const DeviceInfo* device, bool fit);

struct ProgrammeOptions {
  std::string folder;                    ///< folder of the session
  SessionOptions session;                ///< its recording holds what all trials have in common, without a file
  std::optional<DeviceProfile> profile;  ///< profile of a calibrated device; a resumed session has its own
  double max_deviation = 0.1;            ///< distance from the path or reference beyond which the session stops [m]

  /// Returns the device for a trial of `exercise` along `path`, a file: with a cue, of the movement to the target or of
  /// the target; in mode sense, of the pair. May return the same device again.
  std::function<std::shared_ptr<Device>(const Exercise& exercise, const TrialSettings& settings,
                                        const std::string& path)>
      open;
  /// Borrowed, may be null. Commands for all repetitions; its options say `programme`. While it is paused, no trial
  /// begins. A value that it changes holds for later repetitions of the same exercise.
  LiveGuidance* live = nullptr;

  std::function<void(const ScheduledTrial&, const TrialSettings&, std::size_t number, std::size_t of)> begins;
  std::function<void(const TrainingTrial&)> announces;  ///< called before `begins`
  std::function<void(const LoggedTrial&)> ended;
  std::function<void(double seconds_left)> rests;  ///< called about ten times a second; NaN while paused
  /// Asks for the farther one of two places (mode sense): returns 1 or 2, or 0 while there is no answer yet. Called
  /// about ten times a second, in virtual time once.
  std::function<int(double seconds_left)> asks;
};

/// Creates the folder of a session, with its paths, its profile and a log without trials. Throws Error(input) when the
/// folder is not empty; removes everything it created if it fails.
SessionLog begin_session(const nlohmann::json& programme, const std::string& where, const ProgrammePlan& plan,
                         const DeviceInfo& device, const ProgrammeOptions& options);

struct ProgrammeResult {
  SessionLog log;
  std::optional<SessionResult> last;  ///< last trial that was started; empty when there was none
};

/// Runs the remaining repetitions of the session in options.folder, from the first one that was not done. Writes the
/// log to the disk before and after each repetition, so that a crash of the process loses only the current repetition.
/// Rests take no time in virtual time.
///
/// Throws what play, guide and run_session throw before a trial's first force. Throws Error(input) when the device
/// differs from the one that the session was begun with, or when another process runs the session. The log stores the
/// reason.
ProgrammeResult run_programme(const ProgrammeOptions& options, const StopRequest& stop, const Progress& progress = {});

nlohmann::json to_json(const ProgrammePlan& plan, const Programme& programme);
nlohmann::json to_json(const ProgrammeResult& result);

}  // namespace haptrace
