// Recording of hand movements.
#pragma once

#include "control/design/plant_model.h"
#include "control/trigger.h"
#include "devices/device.h"
#include "player/session.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

class LiveSession;

struct RecordOptions {
  double duration = 0;  ///< [s], from the trigger if there is one; 0: the device's natural duration, or until stopped
  std::optional<Trigger> trigger;  ///< needs session.recording->options.capture.pre of at least 0
  /// Returns the calibrated model of a device, for a scene with a passivity layer. If not set, no device counts as
  /// calibrated.
  std::function<std::optional<PlantModel>(const DeviceInfo&)> identified;
  SessionOptions session;       ///< without a scene in `touch` and without support, no force is sent
  LiveSession* live = nullptr;  ///< borrowed, may be null: commands to the session, whose notices become warnings
};

/// Records the hand while it moves freely or touches the scene. Throws Error(input) when a session in virtual time
/// would never end, when the trigger needs a sensor that the device does not have, and as run_session does.
SessionResult record(Device& device, const RecordOptions& options, const StopRequest& stop,
                     const Progress& progress = {});

/// Series of recordings with the same options.
struct Trials {
  int count = 1;
  double pause = 0;  ///< pause between two trials, without recording [s]

  /// Opens the device: once, or before each trial if the device has a natural duration. Trials count from 1.
  std::function<std::unique_ptr<Device>(int trial)> open;

  /// Called with the device before each trial; `file` is the trial's recording.
  std::function<void(int trial, const Device& device, const std::string& file)> begin;
};

inline constexpr int kMostTrials = 100'000;

/// Returns the file of a trial: `file` itself for a single trial, else with -001 and so on before the extension.
std::string trial_file(const std::string& file, int trial, int count);

/// Records trial after trial until all are done, one is stopped or faults, or its recording fails. Stores the trial's
/// number in its metadata (trial, trials). Throws what record throws. Throws Error(input) before the first trial when
/// an option is out of range or the file of any trial exists.
std::vector<SessionResult> record_trials(const Trials& trials, const RecordOptions& options, const StopRequest& stop,
                                         const Progress& progress = {});

}  // namespace haptrace
