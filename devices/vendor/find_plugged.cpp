#include "devices/vendor/find_plugged.h"

#include "base/error.h"
#include "devices/check/usb_devices.h"

namespace haptrace {

std::vector<FoundDevice> find_plugged(const std::string& name, const std::string& backend, const WantedLibrary& library,
                                      const std::string& root) {
  std::vector<FoundDevice> found;
  for (const PluggedUsbDevice& plugged : plugged_usb_devices(root))
    if (std::string_view(plugged.known->name).starts_with(name))
      found.push_back({.spec = backend,
                       .model = plugged.known->name,
                       .serial = "",
                       .where = plugged.where,
                       .obstacle = plugged.obstacle,
                       .remedy = plugged.remedy});
  if (found.empty()) return found;
  try {
    const SharedLibrary is_there(library, SharedLibrary::Unload::never);
  } catch (const Error& error) {
    for (FoundDevice& device : found) {
      device.obstacle = error.what();
      device.remedy = library.remedy;
    }
  }
  return found;
}

}  // namespace haptrace
