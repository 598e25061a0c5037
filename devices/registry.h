// The devices that --device can name.
#pragma once

#include "devices/device.h"
#include "devices/device_spec.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A device that is plugged in, or offered by a program that runs here.
struct FoundDevice {
  std::string spec;      ///< what to say after --device to have it
  std::string model;     ///< as far as it can be known without opening it
  std::string serial;    ///< empty when unknown
  std::string where;     ///< for example "usb 1-1.2"
  std::string obstacle;  ///< why it cannot be opened; empty when nothing is known to be in the way
  std::string remedy;    ///< the command that mends it, or what to do
};

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

  /// What is there to be opened, without opening it; null when there is nothing to look for. Does not throw: what
  /// prevents it from looking is an obstacle of its own.
  std::vector<FoundDevice> (*find)() = nullptr;

  /// Opening it moves nothing, needs no homing and sends zero force first: one that was lost with a force in its motors
  /// can be opened for that alone. Not said of its option initialise=true.
  bool opens_still = false;
};

const std::vector<DeviceBackend>& device_backends();

/// Adds a way to reach devices, unless its name is taken. Before the first device is opened; not thread-safe.
void add_device_backend(DeviceBackend backend);

/// Opens what `spec` names. Errors suggest the nearest name or key.
std::unique_ptr<Device> open_device(const DeviceSpec& spec);
std::unique_ptr<Device> open_device(std::string_view spec);

inline constexpr double kZeroingWindow = 2;  ///< how long a lost device is looked for, to take its force away [s]

/// Whether a device that was lost may be opened again for nothing but zero force.
bool can_be_zeroed_again(const DeviceInfo& lost);

/// Looks for it for kZeroingWindow; when it is back, opens it, which sends zero force, and closes it. Waits for an
/// opening that hangs twice as long. The one that was lost must have been closed.
ZeroForce zero_when_back(const DeviceInfo& lost);

}  // namespace haptrace
