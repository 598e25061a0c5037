// The profile of a device, for the verbs that use one.
#pragma once

#include "cli/verb.h"
#include "control/design/identified_device.h"
#include "formats/documents/device_profile.h"
#include "player/calibration/calibration.h"
#include "player/calibration/device_identity.h"

#include <optional>
#include <string>

namespace haptrace::cli {

/// Returns the profile of a device from `calibrate`: from `file` if it is not empty, else from the profile folder,
/// which may have none. A requested profile that does not fit the device is an error. A stored profile that does not
/// fit is ignored with a warning, which is also added to `warnings` if given.
std::optional<DeviceProfile> profile_for(const DeviceInfo& info, const std::string& file, double rate_hz,
                                         const Output& output, std::vector<Warning>* warnings = nullptr);

/// Bounds the force of a session by what the motors of a calibrated device give (bound_by_motors), and prints the
/// warning.
void take_motor_limit(const DeviceProfile& profile, const DeviceInfo& info, const Output& output,
                      SessionOptions& session);

/// Returns the profile from a successful calibration of the device at this servo rate.
DeviceProfile profile_of(const DeviceInfo& info, const CalibrationResult& result, double rate_hz);

/// Stores the dynamics of a device that measures force in the recording of a session, for guidance with that force.
/// Does nothing without a recording, a sensor or a profile.
void keep_dynamics(SessionOptions& session, const DeviceInfo& info, const std::optional<DeviceProfile>& profile);

/// The options --profile and --no-profile.
struct ProfileArguments {
  std::string file;
  bool none = false;

  /// `without` is the help text of --no-profile.
  void add_to(CLI::App& verb, const char* group, const char* without);

  /// Throws Error(input) if both options were given.
  void check() const;

  /// Returns the requested profile, as profile_for() does. Throws what check() throws.
  [[nodiscard]] std::optional<DeviceProfile> find(const DeviceInfo& info, double rate_hz, const Output& output,
                                                  std::vector<Warning>* warnings = nullptr) const;

  /// Returns the file that find() reads.
  [[nodiscard]] std::string used(const DeviceInfo& info) const;
};

}  // namespace haptrace::cli
