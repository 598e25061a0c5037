// An expert's recording with the force that a trainee shall feel.
#pragma once

#include "formats/documents/device_profile.h"
#include "formats/path/csv_options.h"
#include "formats/path/path_source.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Force of an expert's recording that guidance replays.
enum class ReplayedForce : std::uint8_t {
  task,      ///< measured at the handle, less the inertia, friction and weight of the expert's device; see task_force
  measured,  ///< measured at the handle: holds the expert's device, which the trainee's device adds once more
  sent,      ///< commanded by the expert's device
};

ReplayedForce parse_replayed_force(std::string_view name);  ///< throws Error(input) that names the known values
const char* to_string(ReplayedForce force) noexcept;

struct ExpertOptions {
  /// Absent: `task` if the recording has a measured force and the model of its device is known, else `sent`.
  std::optional<ReplayedForce> force;
  std::string profile;   ///< file with the profile of the expert's device; empty: it is searched, see open_expert
  bool negated = false;  ///< the sensor tells the force of the hand on the device
};

struct ExpertRecording {
  std::shared_ptr<const PathSource> path;  ///< its force is the chosen one
  ReplayedForce force = ReplayedForce::sent;
  std::vector<std::string> notes;     ///< the facts' notes are not among them
  std::vector<std::string> warnings;  ///< messages that matter more
};

/// Opens a path or recording like open_path, with the force that a trainee shall feel.
///
/// The model of the expert's device is, in this order, that of `options.profile`; of the recording (DeviceDynamics); of
/// profile.json beside the recording, as in the folder of a session; of `known`, a profile that the session uses; of
/// the one in the profile folder. The last three must have the backend, model and serial number that the recording
/// names.
///
/// A measured force that is not replayed, a sensor of the wrong sign and a task without any force cause warnings.
/// Throws Error(input) as open_path does; if a force was requested that the recording does not have; and if `task` was
/// requested without a profile. Reads the whole recording if its measured force is used. Threads: free function
/// without state.
ExpertRecording open_expert(const std::string& file, const ExpertOptions& options, const PathSelection& selection = {},
                            const RowsDone& progress = {}, const CsvOptions& csv = {},
                            const std::optional<DeviceProfile>& known = {});

}  // namespace haptrace
