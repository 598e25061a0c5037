// What a calibration found out about one device, kept for the sessions after it.
#pragma once

#include "control/design/plant_model.h"
#include "control/design/tracking_design.h"
#include "control/path/path.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace haptrace {

/// Which device it is.
struct DeviceIdentity {
  std::string backend, model, serial;

  bool operator==(const DeviceIdentity&) const = default;
};

/// What a device said of itself when it was calibrated.
struct DeviceFacts {
  double max_force = 0;            ///< [N]
  double position_resolution = 0;  ///< [m]
  Box workspace;                   ///< [m]
};

struct DeviceProfile {
  DeviceIdentity device;
  DeviceFacts facts;
  std::string created;   ///< RFC 3339, UTC
  std::string software;  ///< name and version
  double rate_hz = 1000;
  PlantModel plant;
  PlantModel half_width;      ///< of the 95 % intervals
  double line_residual = 0;   ///< see Identification
  double sweep_residual = 0;  ///< [N]
  bool fits = true;
  bool coarse = false;  ///< see Identification; the design was tried out. A file says it when it is so
  std::string reason;   ///< why it does not fit, or only a coarse one does
  TrackingDesign design;
};

inline constexpr double kProfileLifetime = 180 * 86400.0;  ///< after which a profile is stale [s]
inline constexpr double kProfileRateTolerance = 0.1;       ///< share of the servo rate

nlohmann::json to_json(const DeviceProfile& profile);

/// Throws Error(input) naming `where` and the key: unknown, missing, of another type, out of its range; another format
/// or another major version of it.
DeviceProfile profile_from_json(const nlohmann::json& json, const std::string& where);

/// Throws Error(input) naming the file.
DeviceProfile load_profile(const std::string& file);

/// Whole or not at all: what stood there before stays until the new profile is complete. Makes the profile folder if
/// the file lies in it. Throws Error(input): the folder is missing, the file exists (unless `overwrite`), the disk
/// refuses.
void save_profile(const DeviceProfile& profile, const std::string& file, bool overwrite);

/// Before the work whose result the profile is. Throws what save_profile() would, as far as that shows beforehand.
void check_profile_output(const std::string& file, bool overwrite);

/// Returns $HAPTRACE_PROFILES, else $XDG_DATA_HOME/haptrace/profiles, else ~/.local/share/haptrace/profiles, where the
/// home is $HOME or, without that, what the system's list of users names. Throws Error(input) when there is none: the
/// folder a process happens to run in is no place for profiles.
std::string profile_folder();

/// Returns the name of a device's profile, which is made of what every file system takes; devices of like names have
/// names of their own.
std::string profile_name(const DeviceIdentity& device);

/// The file in the profile folder that belongs to a device, whether it exists or not. Throws what profile_folder()
/// throws.
std::string profile_file(const DeviceIdentity& device);

/// The device's profile in the profile folder, if there is one. Throws what load_profile throws.
std::optional<DeviceProfile> find_profile(const DeviceIdentity& device);

/// Why `profile` must not be used for this device and rate at this time, in words; empty when it may.
std::string check_profile(const DeviceProfile& profile, const DeviceIdentity& device, const DeviceFacts& facts,
                          double rate_hz, std::chrono::system_clock::time_point now = std::chrono::system_clock::now());

}  // namespace haptrace
