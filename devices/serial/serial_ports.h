// Search for serial ports on USB.
#pragma once

#include "devices/device_spec.h"
#include "devices/registry.h"

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A serial port on USB. Values that the system does not report are empty.
struct UsbSerialPort {
  std::string path;             ///< "/dev/ttyACM0"
  std::string vendor, product;  ///< four hexadecimal digits
  std::string name;             ///< product name
  std::string serial;
  std::string where;     ///< "usb 1-1.2"
  std::string obstacle;  ///< why it cannot be opened; empty if no reason is known
};

/// Remedy for a user who may not open serial ports.
inline constexpr const char* kSerialPermission =
    "sudo usermod -aG dialout $USER   # and log in again; haptrace doctor shows a udev rule for known devices";

/// Returns the serial ports on USB, sorted by path. Reads below `root`; leaves out what it cannot read.
std::vector<UsbSerialPort> usb_serial_ports(const std::string& root = "/");

/// Returns "the serial ports on USB are /dev/ttyACM0 (Arduino Due), ..." or "there are no serial ports on USB".
std::string describe(const std::vector<UsbSerialPort>& ports);

/// Returns the ports that `is_ours` accepts, as `NAME:port=...`.
std::vector<FoundDevice> found_on_serial_ports(const std::string& name, const std::string& model,
                                               const std::function<bool(const UsbSerialPort&)>& is_ours,
                                               const std::string& root = "/");

/// Serial port of a device.
struct ChosenPort {
  std::string path;
  std::string serial;  ///< serial number that USB reports; empty if unknown
};

/// Returns the port of the option port=, or else the only one of `found`. Throws Error(device) if there is none, or
/// there are several.
ChosenPort chosen_port(const DeviceSpec& device, const std::vector<FoundDevice>& found);

/// Throws Error(input) if an emulated device has the option port=.
void refuse_port_of_emulated(const DeviceSpec& device);

}  // namespace haptrace
