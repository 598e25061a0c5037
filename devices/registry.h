// The devices that --device can name.
#pragma once

#include "devices/device.h"
#include "devices/device_spec.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// One way to reach devices. A new one joins by being listed in device_backends().
struct DeviceBackend {
  struct Option {
    std::string key;
    std::string help;
  };

  std::string name;
  std::string summary;          ///< one line
  std::vector<Option> options;  ///< every key it understands; others are refused before `open` is called
  std::vector<std::string> presets;

  /// Throws Error(device) when the device is missing or refuses, Error(input) when an option is wrong.
  std::unique_ptr<Device> (*open)(const DeviceSpec& spec);
};

const std::vector<DeviceBackend>& device_backends();

/// Opens what `spec` names. Errors suggest the nearest name or key.
std::unique_ptr<Device> open_device(const DeviceSpec& spec);
std::unique_ptr<Device> open_device(std::string_view spec);

}  // namespace haptrace
