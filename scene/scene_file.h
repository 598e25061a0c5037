// Scenes in JSON.
#pragma once

#include "scene/scene.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Reads {"objects": [{"kind": "sphere", ...}, ...], "passivity": false}; docs/scene.md lists the keys of every kind.
/// The default name of an object is its kind. Throws Error(input) naming `where` and the key when a key is unknown,
/// missing or out of range.
std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where);

/// Reads a scene from a file.
std::shared_ptr<Scene> load_scene(const std::string& file);

}  // namespace haptrace
