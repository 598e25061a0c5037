#include "cli/verb.h"
#include "control/error.h"
#include "formats/json_reader.h"

#include <fmt/format.h>

namespace haptrace::cli {
namespace {

nlohmann::json to_json(const DeviceInfo& info) {
  return {{"name", info.name},
          {"backend", info.backend},
          {"model", info.model},
          {"serial", info.serial},
          {"virtual_time", info.virtual_time},
          {"force_axes", info.force_axes},
          {"torque_axes", info.torque_axes},
          {"measures_velocity", info.measures_velocity},
          {"measures_orientation", info.measures_orientation},
          {"measures_force", info.measures_force},
          {"workspace_min_m", json_of(info.workspace_min)},
          {"workspace_max_m", json_of(info.workspace_max)},
          {"position_resolution_m", info.position_resolution},
          {"max_force_n", info.max_force},
          {"max_continuous_force_n", info.max_continuous_force},
          {"max_torque_n_m", info.max_torque},
          {"nominal_rate_hz", info.nominal_rate},
          {"natural_duration_s", info.natural_duration},
          {"notes", info.notes}};
}

std::string axes(const std::array<bool, 3>& which) {
  std::string text;
  for (std::size_t i = 0; i < 3; ++i)
    if (which[i]) text += "xyz"[i];
  return text.empty() ? "none" : text;
}

std::string known(double value, double factor, const char* unit) {
  return value > 0 ? fmt::format("{:.4g} {}", factor * value, unit) : "unknown";
}

std::string describe(const DeviceInfo& info) {
  const Vec3 size = 1e3 * (info.workspace_max - info.workspace_min);
  std::string text = fmt::format("{}\n", info.name);
  const auto line = [&](const char* key, const std::string& value) {
    text += fmt::format("  {:<20} {}\n", key, value);
  };
  line("model", info.model);
  if (!info.serial.empty()) line("serial", info.serial);
  line("time", info.virtual_time ? "virtual (simulated: runs on either clock)" : "real");
  line("force axes", axes(info.force_axes));
  line("torque axes", axes(info.torque_axes));
  line("workspace", fmt::format("{:.4g} x {:.4g} x {:.4g} mm", size.x(), size.y(), size.z()));
  line("position resolution", known(info.position_resolution, 1e3, "mm"));
  line("force", known(info.max_force, 1, "N"));
  line("continuous force", known(info.max_continuous_force, 1, "N"));
  if (info.takes_torque()) line("torque", known(info.max_torque, 1, "N m"));
  line("rate", known(info.nominal_rate, 1, "Hz"));
  line("measures", fmt::format("position{}{}{}", info.measures_velocity ? ", velocity" : "",
                               info.measures_orientation ? ", orientation" : "", info.measures_force ? ", force" : ""));
  for (const std::string& note : info.notes) line("note", note);
  return text;
}

std::string list_backends() {
  std::string text;
  for (const DeviceBackend& backend : device_backends()) {
    text += fmt::format("{:<10} {}\n", backend.name, backend.summary);
    if (!backend.presets.empty()) text += fmt::format("{:<10}   presets: {}\n", "", fmt::join(backend.presets, ", "));
    for (const auto& option : backend.options) text += fmt::format("{:<10}   {:<10} {}\n", "", option.key, option.help);
  }
  return text + "\nhaptrace devices NAME[:key=value,...] opens one and says what it can do.\n";
}

nlohmann::json list_backends_json() {
  nlohmann::json list = nlohmann::json::array();
  for (const DeviceBackend& backend : device_backends()) {
    nlohmann::json options = nlohmann::json::object();
    for (const auto& option : backend.options) options[option.key] = option.help;
    list.push_back({{"name", backend.name},
                    {"summary", backend.summary},
                    {"presets", backend.presets},
                    {"options", std::move(options)}});
  }
  return {{"devices", std::move(list)}};
}

}  // namespace

Verb add_devices(CLI::App& app) {
  const auto name = std::make_shared<std::string>();
  CLI::App* verb = app.add_subcommand("devices", "list the devices, or say what one can do");
  verb->footer("  haptrace devices\n  haptrace devices sim:preset=touch,hand=relaxed");
  verb->add_option("name", *name, "open this device and describe it")->type_name("NAME[:...]");
  return {verb, [name](const Output& output) {
            if (name->empty()) {
              output.tell(list_backends_json(), list_backends());
            } else {
              const auto device = open_device(*name);
              output.tell(to_json(device->info()), describe(device->info()));
            }
            return kDone;
          }};
}

}  // namespace haptrace::cli
