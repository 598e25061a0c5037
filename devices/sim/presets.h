// Presets: simulated devices named after real ones, and simulated hands.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// Returns the JSON of a device preset, in the format of a user's own file (read_sim_spec). If the name is unknown,
/// throws Error(input) that starts with `where` and ends with the most similar name.
nlohmann::json device_preset(const std::string& name, const std::string& where);
std::vector<std::string> device_preset_names();

/// Returns the JSON of a spec's `hand`. Throws like device_preset.
nlohmann::json hand_preset(const std::string& name, const std::string& where);
std::vector<std::string> hand_preset_names();

}  // namespace haptrace
