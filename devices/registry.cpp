#include "devices/registry.h"

#include "base/error.h"
#include "base/suggest.h"
#include "devices/falcon/driver.h"
#include "devices/hapkit/hapkit.h"
#include "devices/haply/inverse3.h"
#include "devices/haply/two_diy.h"
#include "devices/loop/loose_thread.h"
#include "devices/plugin/plugin_device.h"
#include "devices/sim/sim_device.h"
#include "devices/vendor/force_dimension.h"
#include "devices/vendor/open_haptics.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fmt/format.h>
#include <thread>

namespace haptrace {
namespace {

constexpr std::chrono::milliseconds kZeroingRetry{100};

template <typename Items, typename Name>
std::vector<std::string> names_of(const Items& items, Name name) {
  std::vector<std::string> names;
  for (const auto& item : items) names.push_back(item.*name);
  return names;
}

std::vector<DeviceBackend>& all_backends() {
  static std::vector<DeviceBackend> backends{
      sim_backend(),          plugin_backend(),   falcon_backend(),  force_dimension_backend(),
      open_haptics_backend(), inverse3_backend(), two_diy_backend(), hapkit_backend()};
  return backends;
}

const DeviceBackend* find_backend(const std::string& name) {
  const auto& backends = device_backends();
  const auto found = std::find_if(backends.begin(), backends.end(), [&](const auto& b) { return b.name == name; });
  return found != backends.end() ? &*found : nullptr;
}

}  // namespace

const std::vector<DeviceBackend>& device_backends() {
  return all_backends();
}

void add_device_backend(DeviceBackend backend) {
  if (find_backend(backend.name) == nullptr) all_backends().push_back(std::move(backend));
}

std::unique_ptr<Device> open_device(const DeviceSpec& spec) {
  const DeviceBackend* const backend = find_backend(spec.name);
  if (backend == nullptr)
    throw input_error(fmt::format("--device '{}': there is no device '{}'{}", spec.text, spec.name,
                                  suggestion(spec.name, names_of(device_backends(), &DeviceBackend::name))));

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

bool can_be_zeroed_again(const DeviceInfo& lost) {
  try {
    const DeviceSpec spec = DeviceSpec::parse(lost.name);
    const DeviceBackend* const backend = find_backend(spec.name);
    // An emulated device that is opened again is a different device.
    return backend != nullptr && backend->opens_still && !spec.flag("emulated") && !spec.flag("initialise");
  } catch (const Error&) {
    return false;  // not opened from a --device text
  }
}

ZeroForce zero_when_back(const DeviceInfo& lost) {
  const auto zero = std::make_shared<std::atomic<ZeroForce>>(ZeroForce::failed);
  (void)call_within(2 * kZeroingWindow, [zero, name = lost.name] {
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kZeroingWindow);
    do {
      try {
        const std::unique_ptr<Device> device = open_device(name);
        device->close();
        *zero = device->zero_force();
        return;
      } catch (const std::exception&) {
        std::this_thread::sleep_for(kZeroingRetry);  // the device is not back yet
      }
    } while (std::chrono::steady_clock::now() < until);
  });
  return *zero;
}

}  // namespace haptrace
