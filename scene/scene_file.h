// Scenes in JSON.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace haptrace {

class Scene;
class SceneFiles;

/// Reads {"objects": [{"kind": "sphere", ...}, ...], "tool": {...}, "passivity": false}; docs/scene.md lists the keys.
/// The default name of an object is its kind. Throws Error(input) naming `where` and the key when a key is unknown,
/// missing or out of range, or a file that the scene names and the place in it.
std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where, SceneFiles& files);
std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where);

/// Reads a scene from a file. The files that it names are found beside it.
std::shared_ptr<Scene> load_scene(const std::string& file);

}  // namespace haptrace
