#include "base/error.h"
#include "base/json_reader.h"
#include "devices/falcon/driver.h"
#include "devices/falcon/emulated_falcon.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/usb_link.h"
#include "devices/sim/live_plant.h"

#include <fmt/format.h>

namespace haptrace {
namespace {

/// Returns whether `spec` asks for an emulated Falcon. Throws Error(input) if it has options of the other kind.
bool is_emulated_falcon(const DeviceSpec& spec) {
  const bool emulated = is_emulated(spec);
  const std::vector<std::string> others =
      emulated ? std::vector<std::string>{"serial", "port"} : std::vector<std::string>{"fault"};
  for (const std::string& key : others)
    if (spec.options.contains(key))
      throw input_error(fmt::format(
          "--device '{}': {}: this option is for {}", spec.text, key,
          emulated ? "a real device; leave it out" : "an emulated device; add emulated=true, or leave it out"));
  return emulated;
}

std::unique_ptr<Device> open_falcon(const DeviceSpec& spec) {
  const bool emulated = is_emulated_falcon(spec);
  FalconCalibration calibration;
  if (const std::string file = spec.option("calibration"); !file.empty())
    calibration = read_falcon_calibration(load_json(file), file);
  std::optional<FalconFirmware> firmware;
  if (const std::string file = spec.option("firmware"); !file.empty()) firmware = read_falcon_firmware(file);

  DeviceInfo info = falcon_info(calibration);
  info.name = spec.text;
  if (emulated) info.model += ", emulated";
  const auto open_link = [&] {
    if (emulated) return open_emulated_falcon_link(spec, calibration);
    const FalconPort port = choose_falcon_port(find_falcon_ports(), spec.option("serial"), spec.option("port"));
    info.serial = port.serial;
    return open_usb_falcon_link(port);
  };
  std::unique_ptr<FalconLink> link = start_falcon(open_link, firmware);
  if (!emulated && !link->guarded_port())
    info.notes.emplace_back(
        "no guardian watches this program, because libusb does not show the device's file: if the program is killed, "
        "the motors keep its last force");
  return std::make_unique<ThreadedDevice>(std::make_unique<FalconDriver>(std::move(link), calibration, info));
}

}  // namespace

DeviceBackend falcon_backend() {
  DeviceBackend backend{.name = "falcon",
                        .summary = "a Novint Falcon on USB (docs/devices/falcon.md)",
                        .options = {{"serial", "serial number of the device, if several are plugged in"},
                                    {"port", "USB port of the device, if several are plugged in, for example 1-1.2"},
                                    {"firmware", "file with Novint's firmware, loaded if none runs"},
                                    {"calibration", "JSON file with the calibration of this device"}},
                        .presets = {},
                        .open = open_falcon,
                        .find = [] { return found_falcons(find_falcon_ports()); },
                        .opens_still = true};
  const auto emulated = emulated_options();
  backend.options.insert(backend.options.end(), emulated.begin(), emulated.end());
  backend.options.push_back({"fault", FalconFaults::help()});
  return backend;
}

}  // namespace haptrace
