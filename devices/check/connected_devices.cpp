#include "devices/check/connected_devices.h"

#include "devices/check/usb_devices.h"

#include <algorithm>

namespace haptrace {
namespace {

bool is_same_device(const FoundDevice& a, const FoundDevice& b) {
  return a.model == b.model && a.serial == b.serial && a.where == b.where;
}

const FoundDevice* find_device(const std::vector<FoundDevice>& devices, const FoundDevice& wanted) {
  const auto found =
      std::find_if(devices.begin(), devices.end(), [&](const FoundDevice& one) { return is_same_device(one, wanted); });
  return found != devices.end() ? &*found : nullptr;
}

}  // namespace

std::vector<FoundDevice> connected_devices(const std::vector<DeviceBackend>& backends, const std::string& root) {
  std::vector<FoundDevice> connected;
  for (const DeviceBackend& backend : backends) {
    if (backend.find == nullptr) continue;
    for (FoundDevice& found : backend.find()) connected.push_back(std::move(found));
  }
  for (const PluggedUsbDevice& plugged : plugged_usb_devices(root)) {
    const bool is_found = std::any_of(connected.begin(), connected.end(),
                                      [&](const FoundDevice& found) { return found.where == plugged.where; });
    if (!is_found)
      connected.push_back({.spec = "",
                           .model = plugged.known->name,
                           .serial = plugged.serial,
                           .where = plugged.where,
                           .obstacle = "haptrace has no driver for it",
                           .remedy = "write a plug-in, one C file that implements devices/plugin.h (example: "
                                     "samples/plugins/mass.c), and use --device plugin:path=./libmine.so"});
  }
  return connected;
}

const char* to_string(DeviceChange::Kind kind) noexcept {
  switch (kind) {
    case DeviceChange::Kind::found:
      return "found";
    case DeviceChange::Kind::changed:
      return "changed";
    case DeviceChange::Kind::gone:
      break;
  }
  return "gone";
}

std::vector<DeviceChange> device_changes(const std::vector<FoundDevice>& before,
                                         const std::vector<FoundDevice>& after) {
  std::vector<DeviceChange> changes;
  for (const FoundDevice& device : before)
    if (find_device(after, device) == nullptr) changes.push_back({DeviceChange::Kind::gone, device});
  for (const FoundDevice& device : after) {
    const FoundDevice* earlier = find_device(before, device);
    if (earlier == nullptr)
      changes.push_back({DeviceChange::Kind::found, device});
    else if (earlier->spec != device.spec || earlier->obstacle != device.obstacle || earlier->remedy != device.remedy)
      changes.push_back({DeviceChange::Kind::changed, device});
  }
  return changes;
}

}  // namespace haptrace
