#include "view/scene_messages.h"

#include "base/error.h"
#include "base/file_hash.h"
#include "base/json_reader.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "scene/scene_files.h"

#include <filesystem>
#include <nlohmann/json.hpp>

namespace haptrace {

nlohmann::json scene_message(const std::vector<ShownObject>& objects, std::uint32_t id) {
  nlohmann::json list = nlohmann::json::array();
  for (const ShownObject& object : objects) {
    const nlohmann::json sizes{{"vertices", object.mesh.vertices.size()}, {"triangles", object.mesh.triangles.size()}};
    list.push_back({{"name", object.name},
                    {"kind", object.kind},
                    {"position", {0, 0, 0}},
                    {"rotation", {1, 0, 0, 0}},
                    {"colour", nullptr},
                    {"mesh", object.mesh.triangles.empty() ? nlohmann::json() : sizes}});
  }
  return {{"type", "scene"}, {"id", id}, {"objects", std::move(list)}};
}

std::vector<Frame> mesh_frames(const std::vector<ShownObject>& objects, std::uint32_t id) {
  std::vector<Frame> frames;
  for (std::uint32_t i = 0; i < objects.size(); ++i) {
    if (objects[i].mesh.triangles.empty()) continue;
    frames.push_back(frame_of(objects[i].mesh, i));
    frames.back().request = id;
  }
  return frames;
}

namespace {

/// Returns the path of a file that has this hash, in the first folder that has one. An absolute name, as in early
/// recordings, is the path itself.
std::string found_file(const std::string& name, const std::string& hash,
                       const std::vector<std::filesystem::path>& folders) {
  for (const std::filesystem::path& folder : folders) {
    const std::filesystem::path path = folder / name;
    std::error_code error;
    if (std::filesystem::is_regular_file(path, error) && file_hash(path.string()) == hash) return path.string();
  }
  throw input_error(name + ": is missing or has changed since the recording");
}

}  // namespace

std::vector<ShownObject> shown_objects(const RecordedScene& scene, const std::string& recording) {
  try {
    const std::vector<std::filesystem::path> folders{std::filesystem::path(recording).parent_path(), scene.folder};
    SceneFiles files;
    for (const auto& [name, hash] : scene.files) files.expect(found_file(name, hash, folders));
    const nlohmann::json json = parse_json(scene.text, "the scene of the recording");
    return shown_objects(*read_scene(json, "the scene of the recording", files));
  } catch (const Error&) {
    // The touched object is in the recording; only its picture is not.
    std::vector<ShownObject> named;
    for (const std::string& name : scene.objects) named.push_back({name, "", {}});
    return named;
  }
}

}  // namespace haptrace
