#include "scene/scene_file.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "scene/field_object.h"
#include "scene/scene.h"
#include "scene/scene_files.h"
#include "scene/shape/shape_kinds.h"
#include "scene/surface/detailed.h"

#include <array>
#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

constexpr double kFarthestPose = 100;  // [m]
constexpr double kLargestTool = 0.1;   // radius [m]
constexpr double kLeastQuaternion = 1e-6;

/// Reads {"position": [x, y, z], "rotation": [w, x, y, z]}.
Pose read_pose(JsonReader reader) {
  Pose pose;
  pose.position = reader.vector("position", pose.position, -kFarthestPose, kFarthestPose);
  const nlohmann::json value = reader.value("rotation");
  if (!value.is_null()) {
    const bool numbers = value.is_array() && value.size() == 4 &&
                         std::all_of(value.begin(), value.end(), [](const auto& entry) { return entry.is_number(); });
    const std::string where = reader.where() + ".rotation: ";
    if (!numbers) throw input_error(where + "expected a quaternion, an array of four numbers [w, x, y, z]");
    Eigen::Vector4d q(value[0], value[1], value[2], value[3]);
    if (!q.allFinite() || !(q.stableNorm() > kLeastQuaternion))
      throw input_error(where + "the quaternion has no direction");
    q.stableNormalize();
    pose.axes = Quat(q[0], q[1], q[2], q[3]).toRotationMatrix();
  }
  reader.finish();
  return pose;
}

/// Reads an object: either {"shape": {"kind", ...}, "surface": {...}}, or all keys of both in the object itself.
std::unique_ptr<Object> read_object(JsonReader& reader, SceneFiles& files) {
  std::optional<JsonReader> of_shape = reader.object("shape"), of_surface = reader.object("surface");
  const ShapeKind& kind = read_kind(of_shape ? *of_shape : reader);
  const std::string name = reader.text("name", kind.kind);
  if (name.empty()) throw input_error(reader.where() + ".name: the name is empty");
  std::unique_ptr<Shape> shape;
  std::unique_ptr<Surface> surface;
  std::optional<FieldSpec> field;
  std::optional<Pose> pose;
  if (std::optional<JsonReader> of_pose = reader.object("pose")) pose = read_pose(std::move(*of_pose));
  if (std::optional<JsonReader> body = reader.object("body")) {
    const std::array<std::string, 1> bodies{"fixed"};
    (void)body->require("kind").choice("kind", "", bodies);
    body->finish();
  }
  try {
    shape = kind.read(of_shape ? *of_shape : reader, files);
    JsonReader& felt = of_surface ? *of_surface : reader;
    if (std::optional<JsonReader> of_field = felt.object("field"))
      field = read_field(std::move(*of_field));
    else
      surface = read_surface(felt, files);
  } catch (const Error& error) {
    const std::string text = error.what();
    throw input_error(text.starts_with(reader.where()) ? text : reader.where() + ": " + text);
  }
  for (const std::optional<JsonReader>* part : {&of_shape, &of_surface})
    if (*part) (*part)->finish();
  reader.finish();
  if (field) {
    std::unique_ptr<Volume> volume(dynamic_cast<Volume*>(shape.get()));
    if (!volume) throw input_error(reader.where() + ".field: only a volume has a field");
    (void)shape.release();
    try {
      return make_field_object(name, kind.kind, std::move(volume), std::move(*field), pose);
    } catch (const Error& error) {
      throw input_error(reader.where() + "." + error.what());
    }
  }
  return make_fixed_object(name, kind.kind, std::move(shape), std::move(surface), pose);
}

PointTool read_tool(JsonReader reader) {
  const std::array<std::string, 1> kinds{"point"};
  (void)reader.choice("kind", "point", kinds);
  PointTool tool{.radius = reader.length("radius", 0, 0, kLargestTool)};
  reader.finish();
  return tool;
}

}  // namespace

std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where, SceneFiles& files) {
  JsonReader reader(json, where);
  (void)reader.text("$schema", "");
  SceneOptions options;
  if (std::optional<JsonReader> tool = reader.object("tool")) options.tool = read_tool(std::move(*tool));
  std::vector<std::unique_ptr<Object>> objects;
  for (JsonReader& object : reader.require("objects").objects("objects")) objects.push_back(read_object(object, files));
  options.passivity = reader.boolean("passivity", false);
  reader.finish();
  options.source = {.text = files.text().empty() ? json.dump(2) : files.text(),
                    .files = files.used(),
                    .folder = files.folder().string()};
  try {
    return std::make_shared<Scene>(std::move(objects), options);
  } catch (const Error& error) {
    throw input_error(where + ": " + error.what());
  }
}

std::shared_ptr<Scene> read_scene(const nlohmann::json& json, const std::string& where) {
  SceneFiles files;
  return read_scene(json, where, files);
}

std::shared_ptr<Scene> load_scene(const std::string& file) {
  SceneFiles files(std::filesystem::path(file).parent_path(), load_text(file));
  return read_scene(parse_json(files.text(), file), file, files);
}

}  // namespace haptrace
