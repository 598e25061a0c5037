// Identity and data of a device, in the form that profiles and sessions store.
#pragma once

#include "devices/device.h"
#include "formats/documents/device_profile.h"

namespace haptrace {

inline DeviceIdentity identity_of(const DeviceInfo& info) {
  return {info.backend, info.model, info.serial};
}

inline DeviceFacts facts_of(const DeviceInfo& info) {
  return {info.max_force, info.position_resolution, {info.workspace_min, info.workspace_max}};
}

}  // namespace haptrace
