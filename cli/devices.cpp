#include "base/error.h"
#include "base/json_reader.h"
#include "base/printable.h"
#include "cli/device_check.h"
#include "cli/verb.h"
#include "devices/check/connected_devices.h"
#include "devices/sim/live_plant.h"

#include <chrono>
#include <cstdio>
#include <fmt/format.h>
#include <thread>

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
  std::string text = printable(info.name) + "\n";
  const auto line = [&](const char* key, const std::string& value) {
    text += fmt::format("  {:<20} {}\n", key, printable(value));
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

nlohmann::json to_json(const FoundDevice& found) {
  return {
      {"spec", found.spec},         {"model", found.model},   {"serial", found.serial},          {"where", found.where},
      {"obstacle", found.obstacle}, {"remedy", found.remedy}, {"usable", found.obstacle.empty()}};
}

/// Describes a device, and any obstacle to opening it.
std::string describe(const FoundDevice& found) {
  std::string text = fmt::format("{:<12} {}{}{} at {}\n", found.spec.empty() ? "-" : found.spec, printable(found.model),
                                 found.serial.empty() ? "" : " ", printable(found.serial), found.where);
  if (!found.obstacle.empty()) text += fmt::format("{:<12}   cannot be opened: {}\n", "", found.obstacle);
  if (!found.remedy.empty()) text += fmt::format("{:<12}   -> {}\n", "", found.remedy);
  return text;
}

std::string list_connected(const std::vector<FoundDevice>& connected) {
  if (connected.empty()) return "connected: no known device\n\n";
  std::string text = "connected:\n";
  for (const FoundDevice& found : connected) text += describe(found);
  return text + "\n";
}

/// Reports devices that come and go, until a stop is requested or standard output is closed.
int watch(const Output& output) {
  constexpr int kSlices = 10;
  constexpr std::chrono::milliseconds kSlice{50};
  const Signals signals;
  output.remark("watching for devices until Ctrl+C");
  std::vector<FoundDevice> before;
  while (signals.stop().count() == 0) {
    const std::vector<FoundDevice> after = connected_devices();
    for (const auto& [kind, device] : device_changes(before, after)) {
      nlohmann::json line = to_json(device);
      line["change"] = to_string(kind);
      const std::string text = output.json
                                   ? printable_json(line, -1) + "\n"
                                   : fmt::format("{:<8} {}", to_string(kind), printable_lines(describe(device)));
      if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) return kDone;
    }
    before = after;
    for (int k = 0; k < kSlices && signals.stop().count() == 0; ++k) std::this_thread::sleep_for(kSlice);
  }
  return kDone;
}

/// Returns the options of a backend; an emulated device also has those of `sim`, which are listed once.
std::vector<DeviceBackend::Option> own_options(const DeviceBackend& backend) {
  std::vector<DeviceBackend::Option> own = backend.options;
  if (std::none_of(own.begin(), own.end(), [](const auto& option) { return option.key == "emulated"; })) return own;
  for (const DeviceBackend::Option& shared : emulated_options())
    if (shared.key != "emulated") std::erase_if(own, [&](const auto& option) { return option.key == shared.key; });
  return own;
}

std::string list_backends() {
  std::string text = "--device:\n";
  for (const DeviceBackend& backend : device_backends()) {
    text += fmt::format("{:<10} {}\n", backend.name, backend.summary);
    if (!backend.presets.empty()) text += fmt::format("{:<10}   presets: {}\n", "", fmt::join(backend.presets, ", "));
    for (const auto& option : own_options(backend))
      text += fmt::format("{:<10}   {:<12} {}\n", "", option.key, option.help);
  }
  return text + "\nhaptrace devices NAME[:key=value,...] opens a device and describes it.\n";
}

nlohmann::json json_of_backends() {
  nlohmann::json list = nlohmann::json::array();
  for (const DeviceBackend& backend : device_backends()) {
    nlohmann::json options = nlohmann::json::object();
    for (const auto& option : backend.options) options[option.key] = option.help;
    list.push_back({{"name", backend.name},
                    {"summary", backend.summary},
                    {"presets", backend.presets},
                    {"options", std::move(options)}});
  }
  return list;
}

nlohmann::json json_of_connected(const std::vector<FoundDevice>& connected) {
  nlohmann::json list = nlohmann::json::array();
  for (const FoundDevice& found : connected) list.push_back(to_json(found));
  return list;
}

}  // namespace

Verb add_devices(CLI::App& app) {
  struct Arguments {
    std::string name;
    bool watch = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("devices", "list connected devices and every name that --device takes");
  verb->footer(
      "Without a name, lists the devices that are plugged in or offered by a program, with the reason and the\n"
      "remedy if one cannot be opened; then every kind of device with its options. --watch reports devices that\n"
      "come and go until Ctrl+C; with --json, one line for each.\n"
      "  haptrace devices\n"
      "  haptrace devices --watch\n"
      "  haptrace devices sim:preset=touch,hand=relaxed\n"
      "  haptrace devices --test falcon");
  CLI::Option* name = verb->add_option("name", arguments->name, "device to open and describe");
  name->type_name("[NAME[:...]]");
  verb->add_flag("--watch", arguments->watch, "report devices as they are connected and removed")->excludes(name);
  const DeviceCheck check(*verb);
  return {verb, [arguments, check](const Output& output) {
            if (check.wanted()) return check.run(arguments->name, output);
            if (arguments->watch) return watch(output);
            if (arguments->name.empty()) {
              const std::vector<FoundDevice> connected = connected_devices();
              output.tell({{"connected", json_of_connected(connected)}, {"devices", json_of_backends()}},
                          list_connected(connected) + list_backends());
            } else {
              const auto device = open_device(arguments->name);
              output.tell(to_json(device->info()), describe(device->info()));
            }
            return static_cast<int>(kDone);
          }};
}

}  // namespace haptrace::cli
