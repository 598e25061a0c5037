// A path as a device can play it.
#pragma once

#include "devices/device.h"
#include "formats/path/path_source.h"

#include <memory>
#include <optional>

namespace haptrace {

struct DevicePath {
  std::shared_ptr<const PathSource> source;
  std::optional<Fit> fit;  ///< how it was moved and scaled, if it was
};

/// Where there is no motor the path has no say and lies in the middle of what the device can do. The rest is as it is
/// when that lies within the workspace, or fitted into it. Throws Error(input) with the distance when it leaves the
/// workspace and must not be fitted. Reads no more of a long path than its figures leave open.
DevicePath path_for(const DeviceInfo& device, std::shared_ptr<const PathSource> path, bool fit);

Box workspace_of(const DeviceInfo& device);

}  // namespace haptrace
