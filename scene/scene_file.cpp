#include "scene/scene_file.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "scene/sphere.h"
#include "scene/wall.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// One kind of object. A new kind only needs an entry in the list below.
struct SceneKind {
  const char* kind;
  /// Reads every key but `kind` and `name`.
  std::unique_ptr<SceneObject> (*read)(JsonReader& reader, const std::string& name);
};

constexpr std::array kSceneKinds{
    SceneKind{"sphere", read_sphere},
    SceneKind{"wall", read_wall},
};

std::unique_ptr<SceneObject> read_object(JsonReader& reader) {
  std::vector<std::string> known;
  for (const SceneKind& kind : kSceneKinds) known.emplace_back(kind.kind);
  const std::string word = reader.require("kind").choice("kind", "", known);
  const auto kind = std::find_if(kSceneKinds.begin(), kSceneKinds.end(), [&](const auto& k) { return k.kind == word; });
  const std::string name = reader.text("name", word);
  if (name.empty()) throw input_error(reader.where() + ".name: the name is empty");
  auto object = kind->read(reader, name);
  reader.finish();
  return object;
}

}  // namespace

std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where) {
  JsonReader reader(json, where);
  std::vector<std::unique_ptr<SceneObject>> objects;
  for (JsonReader& object : reader.require("objects").objects("objects")) objects.push_back(read_object(object));
  const bool passivity = reader.boolean("passivity", false);
  reader.finish();
  try {
    return std::make_shared<Scene>(std::move(objects), passivity);
  } catch (const Error& error) {
    throw input_error(where + ": " + error.what());
  }
}

std::shared_ptr<Scene> load_scene(const std::string& file) {
  return read_scene(load_json(file), file);
}

}  // namespace haptrace
