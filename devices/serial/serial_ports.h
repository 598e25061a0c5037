// The serial ports that are plugged in.
#pragma once

#include "devices/registry.h"

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// A port on USB. What the system does not tell is empty.
struct UsbSerialPort {
  std::string path;             ///< "/dev/ttyACM0"
  std::string vendor, product;  ///< four hexadecimal digits
  std::string name;             ///< what it calls itself
  std::string serial;
  std::string where;     ///< "usb 1-1.2"
  std::string obstacle;  ///< why it cannot be opened; empty when nothing is known to be in the way
};

/// What gives a user the serial ports.
inline constexpr const char* kSerialPermission =
    "sudo usermod -aG dialout $USER   # and log in again; haptrace doctor shows a udev rule for known devices";

/// By path. Reads below `root`; what cannot be read is left out.
std::vector<UsbSerialPort> usb_serial_ports(const std::string& root = "/");

/// "the serial ports on USB are /dev/ttyACM0 (Arduino Due), ..." or "there are none on USB".
std::string describe(const std::vector<UsbSerialPort>& ports);

/// Those that `is_ours` knows, as `NAME:port=...`.
std::vector<FoundDevice> found_on_serial_ports(const std::string& name, const std::string& model,
                                               const std::function<bool(const UsbSerialPort&)>& is_ours,
                                               const std::string& root = "/");

/// The port of the device's option port=, or the only one of `found`. Throws Error(device) when there is none, or there
/// are several.
std::string chosen_port(const DeviceSpec& device, const std::vector<FoundDevice>& found);

/// Throws Error(input) when an emulated device is given a port of its own.
void refuse_port_of_emulated(const DeviceSpec& device);

}  // namespace haptrace
