// Devices made from recordings and paths.
#pragma once

namespace haptrace {

/// Adds `replay` to device_backends(), and lets the option `intent` of `sim` name a path. Call it before the first
/// device is opened; not thread-safe. The second call changes nothing.
void use_recorded_devices();

}  // namespace haptrace
