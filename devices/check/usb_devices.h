// Force-feedback devices on USB: how they are known, which are plugged in, and whether this user may open them.
#pragma once

#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// A force-feedback device that can be told by its USB ids, and by which nodes it is opened.
struct KnownUsbDevice {
  const char* vendor;     ///< four hexadecimal digits
  const char* product;    ///< the same; empty: every product of this vendor
  const char* name;       ///<
  const char* subsystem;  ///< of udev: "usb", "hidraw", "tty" or several, as in "tty|hidraw"

  /// The line of a udev rules file that lets whoever sits at the machine, or is in the group, open it.
  [[nodiscard]] std::string udev_rule() const;
  /// The command that installs the rule.
  [[nodiscard]] std::string install_rule() const;
};

std::span<const KnownUsbDevice> known_usb_devices();

/// The rules of all of them, as a file for udev.
std::string udev_rules_file();

inline constexpr const char* kUdevRulesFile =
    "/etc/udev/rules.d/70-haptrace.rules";  ///< before 73-seat-late, which reads the tags
inline constexpr const char* kReloadUdevRules = "sudo udevadm control --reload && sudo udevadm trigger";

/// A file below /dev by which a device is opened.
struct UsbNode {
  std::string path;
  std::string obstacle;  ///< why this process cannot open it; empty when it can
  std::string remedy;
};

/// One of the known devices that is plugged in.
struct PluggedUsbDevice {
  const KnownUsbDevice* known;
  std::string where;     ///< for example "usb 1-1.2"
  std::string obstacle;  ///< why this user cannot open it; empty when nothing is known to be in the way
  std::string remedy;    ///< the command that mends it
  std::string port;      ///< "1-1.2", below /sys/bus/usb/devices
  std::string ids;       ///< "0403:cb48"
  std::string serial;    ///< empty when it has none
  std::vector<UsbNode> nodes;
};

/// By port. Reads below `root` what the kernel says, and opens nothing; what cannot be read is left out.
std::vector<PluggedUsbDevice> plugged_usb_devices(const std::string& root = "/");

}  // namespace haptrace
