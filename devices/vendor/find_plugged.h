// Search for a vendor's plugged-in devices, and for obstacles to using them.
#pragma once

#include "devices/registry.h"
#include "devices/vendor/shared_library.h"

#include <string>
#include <vector>

namespace haptrace {

/// Returns the plugged-in known USB devices whose name begins with `name`, as `--device backend` would open them
/// through `library`. Obstacles are a missing library, with the places searched, and a device that this user may not
/// open. Reads below `root`. Loads the library only if there is a device for it, and neither calls its functions nor
/// opens a device. Does not throw.
std::vector<FoundDevice> find_plugged(const std::string& name, const std::string& backend, const WantedLibrary& library,
                                      const std::string& root = "/");

}  // namespace haptrace
