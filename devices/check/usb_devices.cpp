#include "devices/check/usb_devices.h"

#include "base/number.h"
#include "base/system_files.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <string_view>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

// The ids of devices with open protocols come from their drivers. An Arduino Due is the board of a Haply 2DIY.
constexpr std::array kKnownUsbDevices{
    KnownUsbDevice{"0403", "cb48", "Novint Falcon", "usb"},
    KnownUsbDevice{"1451", "", "Force Dimension", "usb"},
    KnownUsbDevice{"2988", "", "3D Systems Touch", "tty|hidraw"},
    KnownUsbDevice{"0301", "2988", "3D Systems Touch, an older one", "tty"},
    KnownUsbDevice{"16c0", "0486", "WoodenHaptics or Polhem (Teensy RawHID)", "hidraw"},
    KnownUsbDevice{"2341", "003e", "Haply 2DIY (Arduino Due)", "tty"},
};

constexpr const char* kMakeUsbNodes = "sudo udevadm trigger   # or plug it in again";

/// Returns the files below /dev that open the device in the folder `sys`.
std::vector<std::string> usb_node_paths(const KnownUsbDevice& known, const fs::path& sys) {
  using system_files::read_text;
  std::vector<std::string> nodes;
  if (known.subsystem == std::string_view("usb")) {
    const auto bus = number_of<int>(read_text(sys / "busnum").value_or("")),
               address = number_of<int>(read_text(sys / "devnum").value_or(""));
    if (bus && address) nodes.push_back(fmt::format("/dev/bus/usb/{:03}/{:03}", *bus, *address));
    return nodes;
  }
  // .../1-1:1.0/0003:16C0:0486.0001/hidraw/hidraw0, .../1-1:1.0/tty/ttyACM0
  std::error_code error;
  for (fs::recursive_directory_iterator entry(sys, error), end; !error && entry != end; entry.increment(error)) {
    const fs::path parent = entry->path().parent_path().filename();
    if (parent == "hidraw" || parent == "tty") {
      nodes.push_back("/dev/" + entry->path().filename().string());
      entry.disable_recursion_pending();
    }
  }
  std::sort(nodes.begin(), nodes.end());
  return nodes;
}

PluggedUsbDevice plugged_usb_device(const KnownUsbDevice& known, const fs::path& sys, const fs::path& root) {
  PluggedUsbDevice device{.known = &known, .port = sys.filename().string()};
  device.where = "usb " + device.port;
  device.serial = system_files::read_text(sys / "serial").value_or("");
  for (const std::string& path : usb_node_paths(known, sys)) {
    UsbNode node{.path = path};
    // Test access as the process has it: with its effective user and the access control lists that udev's uaccess sets.
    if (faccessat(AT_FDCWD, (root / path.substr(1)).c_str(), R_OK | W_OK, AT_EACCESS) != 0) {
      const int refused = errno;
      node.obstacle = std::strerror(refused);
      node.remedy = refused == EACCES ? known.install_rule() : kMakeUsbNodes;
      if (device.obstacle.empty()) device.obstacle = path + ": " + node.obstacle;
      if (device.remedy.empty()) device.remedy = node.remedy;
    }
    device.nodes.push_back(std::move(node));
  }
  if (device.nodes.empty()) {
    device.obstacle = "no driver has created a device file for it";
    device.remedy = kMakeUsbNodes;
  }
  return device;
}

}  // namespace

std::string KnownUsbDevice::udev_rule() const {
  const bool usb = subsystem == std::string_view("usb");
  // A serial port or HID node asks its USB parent (ATTRS) for the ids.
  const char* attribute = usb ? "ATTR" : "ATTRS";
  std::string rule = fmt::format("SUBSYSTEM==\"{}\", {}{{idVendor}}==\"{}\"", subsystem, attribute, vendor);
  if (*product != '\0') rule += fmt::format(", {}{{idProduct}}==\"{}\"", attribute, product);
  const bool serial = std::string_view(subsystem).find("tty") != std::string_view::npos;
  rule += fmt::format(", MODE=\"0660\", GROUP=\"{}\", TAG+=\"uaccess\"", serial ? "dialout" : "plugdev");
  if (usb) rule += ", ATTR{power/control}=\"on\"";
  return rule;
}

std::string KnownUsbDevice::install_rule() const {
  return fmt::format("echo '{}' | sudo tee -a {} && {}", udev_rule(), kUdevRulesFile, kReloadUdevRules);
}

std::span<const KnownUsbDevice> known_usb_devices() {
  return kKnownUsbDevices;
}

std::string udev_rules_file() {
  std::string text;
  for (const KnownUsbDevice& device : kKnownUsbDevices)
    text += fmt::format("# {}\n{}\n", device.name, device.udev_rule());
  return text;
}

std::vector<PluggedUsbDevice> plugged_usb_devices(const std::string& root) {
  std::vector<PluggedUsbDevice> plugged;
  for (const fs::path& sys : system_files::entries(fs::path(root) / "sys/bus/usb/devices")) {
    const auto vendor = system_files::read_text(sys / "idVendor"), product = system_files::read_text(sys / "idProduct");
    if (!vendor || !product) continue;
    for (const KnownUsbDevice& known : kKnownUsbDevices)
      if (*vendor == known.vendor && (*known.product == '\0' || *product == known.product)) {
        plugged.push_back(plugged_usb_device(known, sys, root));
        plugged.back().ids = *vendor + ":" + *product;
      }
  }
  return plugged;
}

}  // namespace haptrace
