#include "devices/falcon/driver.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/usb_link.h"
#include "formats/json_reader.h"

#include <fmt/format.h>

namespace haptrace {
namespace {

std::string falcon_option(const DeviceSpec& spec, const char* key) {
  const auto option = spec.options.find(key);
  return option != spec.options.end() ? option->second : "";
}

std::unique_ptr<Device> open_falcon(const DeviceSpec& spec) {
  FalconCalibration calibration;
  if (const std::string file = falcon_option(spec, "calibration"); !file.empty())
    calibration = read_falcon_calibration(load_json(file), file);
  std::optional<FalconFirmware> firmware;
  if (const std::string file = falcon_option(spec, "firmware"); !file.empty()) firmware = read_falcon_firmware(file);

  DeviceInfo info = falcon_info(calibration);
  info.name = spec.text;
  const auto open_link = [&] {
    const FalconPort port =
        choose_falcon_port(find_falcon_ports(), falcon_option(spec, "serial"), falcon_option(spec, "port"));
    info.serial = port.serial;
    return open_usb_falcon_link(port);
  };
  std::unique_ptr<FalconLink> link = start_falcon(open_link, firmware);
  return std::make_unique<ThreadedDevice>(std::make_unique<FalconDriver>(std::move(link), calibration, info));
}

}  // namespace

DeviceBackend falcon_backend() {
  return {.name = "falcon",
          .summary = "a Novint Falcon on USB (docs/devices/falcon.md)",
          .options = {{"serial", "of several, the one with this serial number"},
                      {"port", "of several, the one plugged in here, for example 1-1.2"},
                      {"firmware", "Novint's firmware, loaded when none runs: a file of yours"},
                      {"calibration", "what was measured of this device: a JSON file"}},
          .presets = {},
          .open = open_falcon,
          .find = [] { return found_falcons(find_falcon_ports()); }};
}

}  // namespace haptrace
