#include "devices/sim/hand_steering.h"

#include "devices/device.h"
#include "devices/device_spec.h"
#include "devices/sim/sim_device.h"

namespace haptrace {

HandSteering& view_steering() noexcept {
  static HandSteering steering;
  return steering;
}

HandSteering* steering_of(const Device& device) {
  // The text of the description is the same for a device, its wrapper and the device that it emulates.
  const DeviceInfo& info = device.info();
  if (info.name.empty() || info.virtual_time) return nullptr;
  const DeviceSpec spec = DeviceSpec::parse(info.name);
  return spec.option("intent") == kIntentOfView ? &view_steering() : nullptr;
}

}  // namespace haptrace
