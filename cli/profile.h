// The profile of a device, for the verbs that use one.
#pragma once

#include "cli/verb.h"
#include "control/design/tracking_design.h"
#include "formats/documents/device_profile.h"
#include "player/calibration/calibration.h"
#include "player/calibration/device_identity.h"

#include <optional>
#include <string>

namespace haptrace::cli {

/// What calibration found out about the device: from `file` if that is not empty, else from the profile folder, where
/// there may be none. A profile that does not hold here is an error when it was asked for, and told and left alone when
/// it was found: the warning then also goes into `warnings`, where there is such a list.
std::optional<DeviceProfile> profile_for(const DeviceInfo& info, const std::string& file, double rate_hz,
                                         const Output& output, std::vector<Warning>* warnings = nullptr);

/// What a calibration that succeeded found out about the device, at this servo rate.
DeviceProfile profile_of(const DeviceInfo& info, const CalibrationResult& result, double rate_hz);

/// --profile and --no-profile.
struct ProfileArguments {
  std::string file;
  bool none = false;

  /// `without`: what --no-profile means to the verb.
  void add_to(CLI::App& verb, const char* group, const char* without);

  /// Throws Error(input) when both were given.
  void check() const;

  /// profile_for() what was asked for. Throws what check() throws.
  [[nodiscard]] std::optional<DeviceProfile> find(const DeviceInfo& info, double rate_hz, const Output& output,
                                                  std::vector<Warning>* warnings = nullptr) const;

  /// The file in which find() looks.
  [[nodiscard]] std::string used(const DeviceInfo& info) const;
};

/// As a session is designed for it.
std::optional<IdentifiedDevice> identified(const std::optional<DeviceProfile>& profile);

}  // namespace haptrace::cli
