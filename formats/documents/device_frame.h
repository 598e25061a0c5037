// Pose of a device in the world, as a file.
#pragma once

#include "control/path/path_change.h"

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace haptrace {

class JsonReader;

/// Reads {"rotation": ..., "translation": [x, y, z]}: the pose of the device's base W in the world,
/// p_world = rotation * p_W + translation, with the translation in m. The rotation is a unit quaternion [w, x, y, z] or
/// three rows of three numbers; it may be absent, as may the translation. Rounded numbers are accepted, and replaced by
/// the nearest rotation. device_frame.schema.json describes the file.
///
/// Throws Error(input) naming the key unless this is a rigid motion: a matrix that scales, shears or mirrors, and a
/// quaternion that is not of unit length.
DeviceFrame read_device_frame(JsonReader& reader);

/// Reads a file. Throws Error(input) like read_device_frame and load_json.
DeviceFrame load_device_frame(const std::string& file);

/// Returns JSON that read_device_frame reads.
nlohmann::json to_json(const DeviceFrame& frame);

}  // namespace haptrace
