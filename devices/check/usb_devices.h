// Force-feedback devices on USB: the known devices, those that are plugged in, and this user's access to them.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// A force-feedback device that is identified by its USB ids, and the subsystem of its device nodes.
struct KnownUsbDevice {
  const char* vendor;   ///< four hexadecimal digits
  const char* product;  ///< the same; empty: every product of this vendor
  const char* name;
  const char* subsystem;  ///< udev subsystem: "usb", "hidraw", "tty" or several, as in "tty|hidraw"

  /// Returns the line of a udev rules file that gives access to the user at the machine and to the members of the
  /// group.
  [[nodiscard]] std::string udev_rule() const;
  /// Returns the command that installs the rule.
  [[nodiscard]] std::string install_rule() const;
};

std::span<const KnownUsbDevice> known_usb_devices();

/// Returns the rules of all known devices, as a file for udev.
std::string udev_rules_file();

inline constexpr const char* kUdevRulesFile =
    "/etc/udev/rules.d/70-haptrace.rules";  ///< before 73-seat-late, which reads the tags
inline constexpr const char* kReloadUdevRules = "sudo udevadm control --reload && sudo udevadm trigger";

/// A file below /dev that opens a device.
struct UsbNode {
  std::string path;
  std::string obstacle;  ///< why this process cannot open it; empty if it can
  std::string remedy;
};

/// A known device that is plugged in.
struct PluggedUsbDevice {
  const KnownUsbDevice* known;
  std::string where;     ///< for example "usb 1-1.2"
  std::string obstacle;  ///< why this user cannot open it; empty if no obstacle is known
  std::string remedy;    ///< command that removes the obstacle
  std::string port;      ///< "1-1.2", below /sys/bus/usb/devices
  std::string ids;       ///< "0403:cb48"
  std::string serial;    ///< empty if it has none
  std::vector<UsbNode> nodes;
};

/// Returns the plugged-in devices by port. Reads kernel information below `root`, and opens nothing; omits what cannot
/// be read.
std::vector<PluggedUsbDevice> plugged_usb_devices(const std::string& root = "/");

}  // namespace haptrace
