// Devices of a vendor that are plugged in, and whether they can be used from here.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <string>
#include <vector>

namespace haptrace {

/// The known USB devices whose name begins with `name`, as `--device backend` would open them through `library`.
/// Obstacles are that the library is missing, with where it was looked for, and that this user may not open the device.
/// Reads below `root`. The library is loaded only when there is a device to be used with it; no function of it is
/// called and no device is opened. Does not throw.
std::vector<FoundDevice> find_plugged(const std::string& name, const std::string& backend, const WantedLibrary& library,
                                      const std::string& root = "/");

}  // namespace haptrace
