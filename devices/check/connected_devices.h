// Devices that are plugged in or offered by a running program, and changes in this list.
#pragma once

#include "devices/registry.h"

#include <string>
#include <vector>

namespace haptrace {

/// Returns the devices that `backends` find, and the force-feedback devices on USB that haptrace knows by their ids but
/// no backend finds. Reads USB below `root`. Opens no device; takes as long as the finders.
std::vector<FoundDevice> connected_devices(const std::vector<DeviceBackend>& backends = device_backends(),
                                           const std::string& root = "/");

struct DeviceChange {
  enum class Kind {
    found,
    changed,  ///< its spec, its obstacle or its remedy
    gone,
  };
  Kind kind = Kind::found;
  FoundDevice device;
};

const char* to_string(DeviceChange::Kind kind) noexcept;

/// Returns the changes between two lists: first the devices that are gone, then those that are found or changed, in the
/// order of the lists. Two entries are the same device if model, serial and place are equal.
std::vector<DeviceChange> device_changes(const std::vector<FoundDevice>& before, const std::vector<FoundDevice>& after);

}  // namespace haptrace
