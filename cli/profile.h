// The profile of a device, for the verbs that use one.
#pragma once

#include "cli/verb.h"
#include "control/tracking_design.h"
#include "formats/device_profile.h"
#include "player/device_identity.h"

#include <optional>
#include <string>

namespace haptrace::cli {

/// What calibration found out about the device: from `file` if that is not empty, else from the profile folder, where
/// there may be none. A profile that does not hold here is an error when it was asked for, and told and left alone when
/// it was found.
std::optional<DeviceProfile> profile_for(const DeviceInfo& info, const std::string& file, double rate_hz,
                                         const Output& output);

/// The same as what a session is designed for; nothing with `no_profile`. Throws Error(input) when a file is named
/// nevertheless.
std::optional<IdentifiedDevice> identified_device(const DeviceInfo& info, const std::string& file, bool no_profile,
                                                  double rate_hz, const Output& output);

}  // namespace haptrace::cli
