#include "devices/serial/serial_ports.h"

#include "base/error.h"
#include "devices/check/usb_devices.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

std::string first_line(const fs::path& file) {
  std::string line;
  std::getline(std::ifstream(file), line);
  return line;
}

/// Returns the folder of the USB device that a tty's folder belongs to: the nearest parent with ids.
fs::path usb_device_of(const fs::path& tty) {
  std::error_code error;
  for (fs::path folder = fs::canonical(tty / "device", error); !error && folder.has_relative_path();
       folder = folder.parent_path())
    if (fs::exists(folder / "idVendor", error)) return folder;
  return {};
}

/// Returns the command that lets this user open the port.
std::string permission_for(const UsbSerialPort& port) {
  for (const KnownUsbDevice& known : known_usb_devices())
    if (port.vendor == known.vendor && port.product == known.product)
      return fmt::format("{}; its rule: {}", kSerialPermission, known.udev_rule());
  return kSerialPermission;
}

}  // namespace

std::vector<UsbSerialPort> usb_serial_ports(const std::string& root) {
  std::vector<UsbSerialPort> ports;
  std::error_code error;
  for (fs::directory_iterator entry(fs::path(root) / "sys/class/tty", error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path usb = usb_device_of(entry->path());
    if (usb.empty()) continue;
    UsbSerialPort port{.path = "/dev/" + entry->path().filename().string(),
                       .vendor = first_line(usb / "idVendor"),
                       .product = first_line(usb / "idProduct"),
                       .name = first_line(usb / "product"),
                       .serial = first_line(usb / "serial"),
                       .where = "usb " + usb.filename().string(),
                       .obstacle = ""};
    // Checks access as the process would open the port: with its effective user and the access control lists that
    // udev's uaccess sets.
    if (faccessat(AT_FDCWD, (fs::path(root) / port.path.substr(1)).c_str(), R_OK | W_OK, AT_EACCESS) != 0)
      port.obstacle = std::strerror(errno);
    ports.push_back(std::move(port));
  }
  std::sort(ports.begin(), ports.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
  return ports;
}

std::string describe(const std::vector<UsbSerialPort>& ports) {
  if (ports.empty()) return "there are no serial ports on USB";
  std::vector<std::string> names;
  for (const UsbSerialPort& port : ports) names.push_back(fmt::format("{} ({})", port.path, port.name));
  return fmt::format("the serial ports on USB are {}", fmt::join(names, ", "));
}

std::vector<FoundDevice> found_on_serial_ports(const std::string& name, const std::string& model,
                                               const std::function<bool(const UsbSerialPort&)>& is_ours,
                                               const std::string& root) {
  std::vector<FoundDevice> found;
  for (const UsbSerialPort& port : usb_serial_ports(root)) {
    if (!is_ours(port)) continue;
    found.push_back({.spec = fmt::format("{}:port={}", name, port.path),
                     .model = port.name.empty() ? model : fmt::format("{} ({})", model, port.name),
                     .serial = port.serial,
                     .where = port.where,
                     .obstacle = port.obstacle.empty() ? "" : fmt::format("{}: {}", port.path, port.obstacle),
                     .remedy = port.obstacle.empty() ? "" : permission_for(port)});
  }
  return found;
}

ChosenPort chosen_port(const DeviceSpec& device, const std::vector<FoundDevice>& found) {
  const auto path_of = [](const FoundDevice& one) { return one.spec.substr(one.spec.find('=') + 1); };
  if (std::string path = device.option("port"); !path.empty()) {
    const auto same = std::find_if(found.begin(), found.end(), [&](const auto& one) { return path_of(one) == path; });
    return {std::move(path), same != found.end() ? same->serial : ""};
  }
  if (found.empty())
    throw device_error(
        fmt::format("--device '{}': no board of this kind is plugged in; {}. Name the port: {}:port=/dev/...",
                    device.text, describe(usb_serial_ports()), device.name));
  if (found.size() > 1) {
    std::vector<std::string> specs;
    for (const FoundDevice& one : found) specs.push_back(one.spec);
    throw device_error(fmt::format("--device '{}': several boards of this kind are plugged in; select one: {}",
                                   device.text, fmt::join(specs, " or ")));
  }
  return {path_of(found.front()), found.front().serial};
}

void refuse_port_of_emulated(const DeviceSpec& device) {
  if (device.options.contains("port"))
    throw input_error(fmt::format(
        "--device '{}': port: an emulated device uses no real port; leave out port or emulated", device.text));
}

}  // namespace haptrace
