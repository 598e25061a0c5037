// Scenes in JSON.
#pragma once

#include "scene/scene.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Reads {"objects": [{"kind": "sphere", ...}, ...], "passivity": false}; docs/scene.md has the keys of every kind. An
/// object without a name is called as its kind. Throws Error(input) naming `where` and the key: unknown, missing, or
/// out of its range.
std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where);

/// The same of a file.
std::shared_ptr<Scene> load_scene(const std::string& file);

}  // namespace haptrace
