#include "devices/sim/live_plant.h"

#include "base/error.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::int64_t kLongestLeap = 100'000'000;  // [ns]

}  // namespace

void LivePlant::advance_to(std::int64_t now_ns) noexcept {
  const std::int64_t step = now_ns_ < 0 ? 0 : std::clamp<std::int64_t>(now_ns - now_ns_, 0, kLongestLeap);
  now_ns_ = std::max(now_ns_, now_ns);
  DeviceState ignored;
  (void)plant_->exchange({force_, Vec3::Zero()}, 1e-9 * static_cast<double>(step), ignored);
}

bool is_emulated(const DeviceSpec& device) {
  if (device.flag("emulated")) return true;
  for (const auto& of_plant : sim_backend().options)
    if (device.options.contains(of_plant.key))
      throw input_error(
          fmt::format("--device '{}': {}: this option is for an emulated device; add emulated=true, or leave it out",
                      device.text, of_plant.key));
  return false;
}

LivePlant open_live_plant(const DeviceSpec& device, const std::string& preset) {
  DeviceSpec plant{.text = device.text, .name = "sim", .options = {}};
  for (const auto& option : sim_backend().options)
    if (const auto given = device.options.find(option.key); given != device.options.end()) plant.options.insert(*given);
  if (!plant.options.contains("spec")) plant.options.emplace("preset", preset);
  return LivePlant(open_sim_device(plant));
}

std::vector<DeviceBackend::Option> emulated_options() {
  std::vector<DeviceBackend::Option> options{
      {"emulated", "true: emulate the device with a simulated mechanism; accepts the options of sim as well"}};
  for (const auto& option : sim_backend().options) options.push_back(option);
  return options;
}

}  // namespace haptrace
