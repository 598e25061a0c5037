// Simulated devices named after real ones, and hands to hold them.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// The same JSON as a user's own file (read_sim_spec). Throws Error(input) that begins with `where` and ends with the
/// nearest name.
nlohmann::json device_preset(const std::string& name, const std::string& where);
std::vector<std::string> device_preset_names();

/// The JSON of a spec's `hand`. Throws likewise.
nlohmann::json hand_preset(const std::string& name, const std::string& where);
std::vector<std::string> hand_preset_names();

}  // namespace haptrace
