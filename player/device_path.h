// Fitting of a path to the axes and workspace of a device.
#pragma once

#include "devices/device.h"
#include "formats/path/path_source.h"

#include <memory>
#include <optional>
#include <string>

namespace haptrace {

/// Note of a session with a scene whose path was moved into the workspace.
inline constexpr const char* kFitMovesNoScene =
    "--fit moved the path, but not the scene: its objects are where their file places them";

struct DevicePath {
  std::shared_ptr<const PathSource> source;
  std::optional<Fit> fit;  ///< translation and scale, if the path was fitted
};

/// Returns the path as the device plays it. Along an axis without a motor the path lies at the middle of the workspace.
/// The rest stays unchanged if it lies within the workspace. Otherwise it is fitted into the workspace or, without
/// `fit`, Error(input) is thrown with the distance outside. Reads only the blocks of a long path whose bounds are not
/// conclusive.
DevicePath path_for(const DeviceInfo& device, std::shared_ptr<const PathSource> path, bool fit);

Box workspace_of(const DeviceInfo& device);

/// Throws Error(input) if the device has no motor along a direction, a unit vector; `what` needs it.
void check_motors(const DeviceInfo& device, const Vec3& direction, const std::string& what);

}  // namespace haptrace
