// Calibration results of one device, stored for later sessions.
#pragma once

#include "control/design/identified_device.h"
#include "control/path/path.h"

#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace haptrace {

struct DeviceIdentity {
  std::string backend, model, serial;

  bool operator==(const DeviceIdentity&) const = default;
};

/// Returns the model and the serial number of a device for users, as far as they are known: "a device without a name"
/// if it has no model.
std::string device_in_words(const DeviceIdentity& device);

/// Properties that a device reported when it was calibrated.
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
  PlantModel half_width;      ///< of the 95 % confidence intervals
  double line_residual = 0;   ///< see Identification
  double sweep_residual = 0;  ///< [N]
  bool fits = true;
  bool coarse = false;  ///< see Identification; the design was tested on the device. Stored only if true
  std::string reason;   ///< why the model does not fit, or is only coarse
  TrackingDesign design;
  /// Absent in older profiles, and for a coarse model that was not tried over the workspace.
  std::optional<HeldDevice> held;

  /// Returns what a session's law is designed from.
  [[nodiscard]] IdentifiedDevice identified() const { return {plant, design, held}; }
};

/// What is subtracted from a force that was measured at the handle: the part of a profile that a recording holds.
struct DeviceDynamics {
  std::string created;  ///< of the profile: RFC 3339, UTC
  PlantModel plant;
  std::optional<InertiaMap> inertia;  ///< if the mass varies over the workspace
  bool in_a_hand = false;             ///< a hand held the device as it was calibrated: its drag and pull are in `plant`

  static DeviceDynamics of(const DeviceProfile& profile);
};

/// Key in a recording's metadata, with the device's dynamics as JSON (docs/file-format.md).
inline constexpr const char* kDynamicsKey = "device_dynamics";

nlohmann::json to_json(const DeviceDynamics& dynamics);

/// Throws Error(input) like profile_from_json().
DeviceDynamics dynamics_from_json(const nlohmann::json& json, const std::string& where);

inline constexpr double kProfileLifetime = 180 * 86400.0;  ///< age from which a profile is stale [s]
inline constexpr double kProfileRateTolerance = 0.1;       ///< relative to the servo rate

nlohmann::json to_json(const DeviceProfile& profile);

/// Reads a profile. Throws Error(input) naming `where` and the key if a key is unknown, missing, of the wrong type or
/// out of range, or if the format or its version differs.
DeviceProfile profile_from_json(const nlohmann::json& json, const std::string& where);

/// Reads a profile from a file. Throws Error(input) naming the file.
DeviceProfile load_profile(const std::string& file);

/// Writes the whole profile or nothing: a file of this name stays until the new profile is complete. Creates the
/// profile folder if the file lies in it. Throws Error(input) if the folder is missing, the file exists (unless
/// `overwrite`), or a write to the disk fails.
void save_profile(const DeviceProfile& profile, const std::string& file, bool overwrite);

/// Checks that a profile can be saved, before the calibration starts. Throws like save_profile(), as far as it can
/// know.
void check_profile_output(const std::string& file, bool overwrite);

/// Returns $HAPTRACE_PROFILES, else $XDG_DATA_HOME/haptrace/profiles, else ~/.local/share/haptrace/profiles, where the
/// home is $HOME or, without that, the one in the system's list of users. Throws Error(input) if there is none: the
/// working folder is no place for profiles.
std::string profile_folder();

/// Returns the file name of a device's profile. It only has characters that every file system accepts, and differs for
/// devices of similar names.
std::string profile_name(const DeviceIdentity& device);

/// Returns a device's file in the profile folder, which need not exist. Throws like profile_folder().
std::string profile_file(const DeviceIdentity& device);

/// Returns the device's profile from the profile folder, if there is one. Throws like load_profile().
std::optional<DeviceProfile> find_profile(const DeviceIdentity& device);

/// Returns why `profile` must not be used for this device and rate at this time; empty if it may.
std::string check_profile(const DeviceProfile& profile, const DeviceIdentity& device, const DeviceFacts& facts,
                          double rate_hz, std::chrono::system_clock::time_point now = std::chrono::system_clock::now());

}  // namespace haptrace
