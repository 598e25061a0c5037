// Registry of the devices that --device can name.
#pragma once

#include "devices/device.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

struct DeviceSpec;

/// A device that is plugged in, or offered by a program on this machine.
struct FoundDevice {
  std::string spec;      ///< text after --device that selects it
  std::string model;     ///< as far as known without opening the device
  std::string serial;    ///< empty when unknown
  std::string where;     ///< for example "usb 1-1.2"
  std::string obstacle;  ///< why it cannot be opened; empty if no reason is known
  std::string remedy;    ///< command or instruction that removes the obstacle
};

/// A backend, which opens one kind of device. To add one, list it in all_backends() in registry.cpp or call
/// add_device_backend().
struct DeviceBackend {
  struct Option {
    std::string key;
    std::string help;
  };

  std::string name;
  std::string summary;          ///< one line
  std::vector<Option> options;  ///< every key that the backend accepts; other keys are rejected before `open` is called
  std::vector<std::string> presets;

  /// Opens a device. Throws Error(device) if the device is missing or refuses, Error(input) if an option is invalid.
  std::unique_ptr<Device> (*open)(const DeviceSpec& spec);

  /// Lists the devices that could be opened, without opening them; null if there is nothing to search for. Does not
  /// throw: a failure of the search itself is reported as an obstacle.
  std::vector<FoundDevice> (*find)() = nullptr;

  /// True if opening the device moves nothing, needs no homing and sends zero force first. A device that was lost with
  /// a force in its motors can then be reopened to remove that force. Does not cover the option initialise=true.
  bool opens_still = false;
};

const std::vector<DeviceBackend>& device_backends();

/// Adds a backend, unless its name is taken. Call it before the first device is opened; not thread-safe.
void add_device_backend(DeviceBackend backend);

/// Opens the device that `spec` names. Errors suggest the nearest name or key.
std::unique_ptr<Device> open_device(const DeviceSpec& spec);
std::unique_ptr<Device> open_device(std::string_view spec);

inline constexpr double kZeroingWindow = 2;  ///< search time for a lost device, to remove its force [s]

/// Returns whether a lost device may be reopened just to send zero force.
bool can_be_zeroed_again(const DeviceInfo& lost);

/// Searches for the lost device for kZeroingWindow. When it is back, opens it, which sends zero force, and closes it.
/// Returns after twice that time even if opening hangs. The lost device must have been closed.
ZeroForce zero_when_back(const DeviceInfo& lost);

}  // namespace haptrace
