#include "devices/falcon/usb_port.h"

#include "base/error.h"
#include "base/number.h"
#include "base/system_files.h"
#include "devices/check/usb_devices.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace haptrace {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFalconVendor = "0403";
constexpr const char* kFalconProduct = "cb48";
constexpr const char* kUserDriver = "usbfs";  // another program, through libusb

std::string falcon_attribute(const fs::path& file) {
  return system_files::read_text(file).value_or("");
}

int falcon_number(const fs::path& file) {
  return number_of<int>(falcon_attribute(file)).value_or(0);
}

std::string falcon_driver(const fs::path& device) {
  std::error_code none;
  const fs::path driver = fs::read_symlink(device / (device.filename().string() + ":1.0") / "driver", none);
  return driver.filename();
}

FalconPort falcon_port(const fs::path& device, const fs::path& root) {
  FalconPort port{.port = device.filename(), .serial = falcon_attribute(device / "serial")};
  port.bus = falcon_number(device / "busnum");
  port.address = falcon_number(device / "devnum");
  port.node = fmt::format("/dev/bus/usb/{:03}/{:03}", port.bus, port.address);
  port.driver = falcon_driver(device);
  if (access((root / port.node.substr(1)).c_str(), R_OK | W_OK) != 0) port.refused = errno;
  return port;
}

/// Returns the text after --device that selects `port` among `ports`.
std::string falcon_spec(const FalconPort& port, const std::vector<FalconPort>& ports) {
  if (ports.size() == 1) return "falcon";
  const auto namesakes =
      std::count_if(ports.begin(), ports.end(), [&](const FalconPort& other) { return other.serial == port.serial; });
  if (!port.serial.empty() && namesakes == 1) return "falcon:serial=" + port.serial;
  return "falcon:port=" + port.port;
}

std::string falcon_specs(const std::vector<FalconPort>& ports) {
  std::vector<std::string> specs;
  for (const FalconPort& port : ports) specs.push_back(falcon_spec(port, ports));
  return fmt::format("{}", fmt::join(specs, ", "));
}

struct FalconObstacle {
  std::string what, remedy;
};

FalconObstacle falcon_obstacle(const FalconPort& port) {
  if (port.refused == EACCES || port.refused == EPERM) {
    const auto known = known_usb_devices();
    const auto falcon = std::find_if(known.begin(), known.end(), [](const KnownUsbDevice& device) {
      return std::string_view(device.vendor) == kFalconVendor && std::string_view(device.product) == kFalconProduct;
    });
    return {fmt::format("{} cannot be opened by this user", port.node), falcon->install_rule()};
  }
  if (port.refused != 0)
    return {fmt::format("{} cannot be opened: {}", port.node, std::strerror(port.refused)),
            "sudo udevadm trigger   # or plug it in again"};
  if (!port.driver.empty() && port.driver != kFtdiDriver && port.driver != kUserDriver)
    return {fmt::format("the kernel's driver {} uses it", port.driver),
            fmt::format("echo '{}:1.0' | sudo tee /sys/bus/usb/drivers/{}/unbind", port.port, port.driver)};
  return {};
}

}  // namespace

std::vector<FalconPort> find_falcon_ports(const std::string& root) {
  std::vector<FalconPort> ports;
  std::error_code error;
  for (fs::directory_iterator entry(fs::path(root) / "sys/bus/usb/devices", error), end; !error && entry != end;
       entry.increment(error))
    if (falcon_attribute(entry->path() / "idVendor") == kFalconVendor &&
        falcon_attribute(entry->path() / "idProduct") == kFalconProduct)
      ports.push_back(falcon_port(entry->path(), root));
  std::sort(ports.begin(), ports.end(),
            [](const FalconPort& one, const FalconPort& other) { return one.port < other.port; });
  return ports;
}

FalconPort choose_falcon_port(const std::vector<FalconPort>& ports, std::string_view serial, std::string_view port) {
  if (ports.empty())
    throw device_error("no Novint Falcon (USB 0403:cb48) is plugged in; check its USB cable and its power supply");
  std::vector<FalconPort> chosen;
  std::copy_if(ports.begin(), ports.end(), std::back_inserter(chosen), [&](const FalconPort& one) {
    return (serial.empty() || one.serial == serial) && (port.empty() || one.port == port);
  });
  if (chosen.size() == 1) return chosen.front();
  if (chosen.empty())
    throw device_error(fmt::format("no Novint Falcon with{}{} is plugged in. Use one that is: {}",
                                   serial.empty() ? "" : fmt::format(" serial={}", serial),
                                   port.empty() ? "" : fmt::format(" port={}", port), falcon_specs(ports)));
  throw device_error(
      fmt::format("{} Novint Falcons are plugged in; select one: {}", chosen.size(), falcon_specs(ports)));
}

std::vector<FoundDevice> found_falcons(const std::vector<FalconPort>& ports) {
  std::vector<FoundDevice> found;
  for (const FalconPort& port : ports) {
    const auto [what, remedy] = falcon_obstacle(port);
    found.push_back({.spec = falcon_spec(port, ports),
                     .model = "Novint Falcon",
                     .serial = port.serial,
                     .where = "usb " + port.port,
                     .obstacle = what,
                     .remedy = remedy});
  }
  return found;
}

void expect_open_falcon_port(const FalconPort& port) {
  if (const auto [what, remedy] = falcon_obstacle(port); !what.empty())
    throw device_error(fmt::format("Novint Falcon at usb {}: {}: {}", port.port, what, remedy));
}

}  // namespace haptrace
