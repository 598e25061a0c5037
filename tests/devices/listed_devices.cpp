#include "devices/loop/recovering_device.h"
#include "devices/plugin/plugin_device.h"
#include "devices/sim/presets.h"
#include "recorder/replay_device.h"
#include "tests/devices/device_laws.h"
#include "tests/devices/support.h"

namespace haptrace::test {
namespace {

std::unique_ptr<Device> open_replay() {
  ReplayDevice::Rows recording;
  for (int k = 0; k < 3000; ++k) {
    recording.time_ns.push_back(1'000'000LL * k);
    recording.position.emplace_back(0.05 * std::cos(0.002 * k), 0.05 * std::sin(0.002 * k), 0);
  }
  return std::make_unique<ReplayDevice>(DeviceInfo{.max_force = 5}, recording);
}

std::unique_ptr<Device> open_spec(const char* json) {
  return std::make_unique<SimDevice>(read_sim_spec(nlohmann::json::parse(json), "test"));
}

}  // namespace

std::vector<Listed> listed_devices() {
  std::vector<Listed> devices;
  for (const std::string& preset : device_preset_names()) {
    const bool rests = preset != "reference";
    devices.push_back({"sim_" + preset, [preset] { return open_device("sim:preset=" + preset); }, true, rests});
    devices.push_back(
        {"held_" + preset, [preset] { return open_device("sim:hand=firm,seed=3,preset=" + preset); }, true, false});
  }
  const auto spec = [&devices](const char* name, const char* json, bool rests = true) {
    devices.push_back({name, [json] { return open_spec(json); }, true, rests});
  };
  spec("spec_minimal", R"({"mass": 1, "max_force": 10})");
  spec("spec_rigid_friction", R"({"mass": 0.3, "max_force": 10, "coulomb": 1, "force_resolution": 0.1})");
  spec("spec_structure", R"({"mass": 0.3, "max_force": 10, "coulomb": 0.5, "backlash": 1e-4,
                             "structural_mode": {"frequency_hz": 40}, "hand": "tense"})",
       false);
  spec("spec_sensor", R"({"mass": 0.3, "max_force": 10, "force_sensor": true, "hand": "pinch",
                          "noise": {"position": 1e-5, "force": 0.01}})",
       false);
  constexpr double kFlies = 15;  // a free mass without stops, after 2 s
  devices.push_back({"plugin_mass", [] { return open_device("plugin:path=" MASS_PLUGIN); }, true, true, true, kFlies});
  devices.push_back({"replay", open_replay, false, false});
  devices.push_back(
      {"recovering",
       [] { return std::make_unique<RecoveringDevice>([] { return open_device("plugin:path=" MASS_PLUGIN); }); }, true,
       true, true, kFlies});
  return devices;
}

}  // namespace haptrace::test
