#include "devices/registry.h"

#include "control/error.h"
#include "devices/falcon/driver.h"
#include "devices/hapkit/hapkit.h"
#include "devices/haply/inverse3.h"
#include "devices/haply/two_diy.h"
#include "devices/plugin_device.h"
#include "devices/replay_device.h"
#include "devices/sim/sim_device.h"
#include "devices/vendor/force_dimension.h"
#include "devices/vendor/open_haptics.h"
#include "formats/suggest.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

template <typename Items, typename Name>
std::vector<std::string> names_of(const Items& items, Name name) {
  std::vector<std::string> names;
  for (const auto& item : items) names.push_back(item.*name);
  return names;
}

}  // namespace

const std::vector<DeviceBackend>& device_backends() {
  static const std::vector<DeviceBackend> backends{
      sim_backend(),          replay_backend(),   plugin_backend(),  falcon_backend(), force_dimension_backend(),
      open_haptics_backend(), inverse3_backend(), two_diy_backend(), hapkit_backend()};
  return backends;
}

std::unique_ptr<Device> open_device(const DeviceSpec& spec) {
  const auto& backends = device_backends();
  const auto backend =
      std::find_if(backends.begin(), backends.end(), [&](const DeviceBackend& b) { return b.name == spec.name; });
  if (backend == backends.end())
    throw input_error(fmt::format("--device '{}': there is no device '{}'{}", spec.text, spec.name,
                                  suggestion(spec.name, names_of(backends, &DeviceBackend::name))));

  const auto keys = names_of(backend->options, &DeviceBackend::Option::key);
  for (const auto& [key, value] : spec.options)
    if (std::find(keys.begin(), keys.end(), key) == keys.end())
      throw input_error(
          fmt::format("--device '{}': '{}' has no option '{}'{}", spec.text, spec.name, key, suggestion(key, keys)));
  return backend->open(spec);
}

std::unique_ptr<Device> open_device(std::string_view spec) {
  return open_device(DeviceSpec::parse(spec));
}

}  // namespace haptrace
