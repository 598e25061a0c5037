// What is plugged in or offered by a program that runs here, and what comes and goes.
#pragma once

#include "devices/registry.h"

#include <string>
#include <vector>

namespace haptrace {

/// What `backends` find, and the force-feedback devices on USB that haptrace knows by their ids and none of them finds.
/// Reads USB below `root`. Opens no device; lasts as long as the finders do.
std::vector<FoundDevice> connected_devices(const std::vector<DeviceBackend>& backends = device_backends(),
                                           const std::string& root = "/");

struct DeviceChange {
  enum class Kind {
    found,
    changed,  ///< what is in its way, or how it is named
    gone,
  };
  Kind kind = Kind::found;
  FoundDevice device;
};

const char* to_string(DeviceChange::Kind kind) noexcept;

/// What happened between two looks: first what is gone, then what is found or changed, in the order of the lists. A
/// device is the same when model, serial and place are.
std::vector<DeviceChange> device_changes(const std::vector<FoundDevice>& before, const std::vector<FoundDevice>& after);

}  // namespace haptrace
