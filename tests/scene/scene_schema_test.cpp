// The scene's schema for editors and other programs agrees with haptrace's reader.
#include "base/error.h"
#include "base/json_reader.h"
#include "scene/scene.h"
#include "scene/scene_file.h"
#include "tests/support/temp_folder.h"

#include <cstdlib>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using nlohmann::json;
using test::TempFolder;

bool scene_is_read(const json& scene) {
  try {
    (void)read_scene(scene, "scene.json");
    return true;
  } catch (const Error&) {
    return false;
  }
}

/// Returns for each scene whether it is valid by the schema.
std::vector<bool> scenes_by_schema(const std::vector<json>& scenes) {
  const TempFolder folder;
  std::string lines;
  for (const json& scene : scenes) lines += scene.dump() + "\n";
  const std::string file = folder.write("scenes.jsonl", lines);
  const std::string script = folder.write("check.py", R"(
import json, sys, jsonschema
schema = json.load(open(sys.argv[1]))
jsonschema.Draft7Validator.check_schema(schema)
validator = jsonschema.Draft7Validator(schema)
print("".join("1" if validator.is_valid(json.loads(line)) else "0" for line in open(sys.argv[2])))
)");
  const std::string answer = folder / "answer.txt";
  EXPECT_EQ(
      std::system(fmt::format("python3 {} {}/scene.schema.json {} > {}", script, HAPTRACE_SCENE, file, answer).c_str()),
      0);
  std::vector<bool> valid;
  std::ifstream stream(answer);
  for (char c = 0; stream.get(c);)
    if (c == '0' || c == '1') valid.push_back(c == '1');
  return valid;
}

/// Appends copies of the scene with one change each: a missing key, an unknown key, a value of another type or range.
void change_scene(const json& whole, const json& part, const json::json_pointer& at, std::vector<json>& changed) {
  const auto with = [&](const json& value) {
    json copy = whole;
    copy[at] = value;
    changed.push_back(std::move(copy));
  };
  if (part.is_object()) {
    json more = part;
    more["zzz"] = 1;
    with(more);
    for (const auto& [key, value] : part.items()) {
      json less = part;
      less.erase(key);
      with(less);
      change_scene(whole, value, at / key, changed);
    }
  } else if (part.is_array()) {
    with(json::object());
    for (std::size_t i = 0; i < part.size(); ++i) change_scene(whole, part[i], at / i, changed);
  } else if (part.is_number()) {
    for (const double value : {-1e12, 1e12}) with(value);
    with("text");
  } else {
    with("other");
    with(5);
  }
}

TEST(SceneSchema, TakesWhatTheReaderTakesAndNothingElse) {
  const std::vector<json> whole{
      json::parse(R"({"tool": {"kind": "point", "radius": 0.002}, "passivity": true, "objects": [
        {"name": "a", "shape": {"kind": "sphere", "centre": [0, 0, 0], "radius": 0.03, "renew": 0.001},
         "surface": {"stiffness": 500, "damping": 1, "lead": 0.5, "shading": {"crease": 30},
           "friction": {"static": 0.5, "dynamic": 0.3, "bristle": 1000, "damping": 1, "viscous": 1,
             "periodic": {"period": 0.002, "amplitude": 0.5, "axis": [1, 0, 0]},
             "sandpaper": {"sigma": 0.3, "grain": 0.001, "seed": 3}},
           "texture": {"kind": "perlin", "amplitude": 0.0001, "wavelength": 0.002, "seed": 1, "law": "bump"},
           "adhesion": {"force": 0.5, "stiffness": 500}},
         "pose": {"position": [0, 0, 0.1], "rotation": [1, 0, 0, 0]}, "body": {"kind": "fixed"}}]})"),
      json::parse(R"({"objects": [
        {"shape": {"kind": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]},
         "surface": {"hertz": {"modulus": 100000, "radius": 0.01},
           "texture": {"kind": "fourier", "waves": [{"wavelength": 0.002, "amplitude": 0.0001, "direction": [1, 0, 0], "phase": 1}]}}},
        {"shape": {"kind": "box", "centre": [0, 0, 0], "size": [0.1, 0.1, 0.02]}, "surface": {"stiffness": 500}},
        {"shape": {"kind": "torus", "radius": 0.03, "tube": 0.01}, "surface": {"stiffness": 500}},
        {"shape": {"kind": "cone", "radius": 0.03, "height": 0.01}, "surface": {"stiffness": 500}},
        {"shape": {"kind": "cylinder", "radius": 0.03, "height": 0.01}, "surface": {"stiffness": 500}},
        {"shape": {"kind": "ellipsoid", "radii": [0.03, 0.02, 0.01]}, "surface": {"stiffness": 500}},
        {"name": "b", "shape": {"kind": "wall", "point": [0, 0, 0], "normal": [0, 0, 1]},
         "surface": {"table": [[0, 0], [0.001, 1]], "texture": {"kind": "reaction-diffusion", "amplitude": 0.0001,
           "side": 16, "steps": 5, "feed": 0.03, "kill": 0.06, "seed": 1,
           "mapping": {"kind": "cube", "origin": [0, 0, 0], "size": 0.05, "repeat": 2}}}}]})"),
      json::parse(R"({"tool": {"kind": "point", "radius": "1mm"}, "objects": [
        {"shape": {"kind": "sphere", "radius": "30 mm"}, "surface": {"stiffness": 500}},
        {"shape": {"kind": "cylinder", "radius": "3e1mm", "height": "1.5cm"}, "surface": {"stiffness": 500}}]})"),
      json::parse(R"({"objects": [
        {"shape": {"kind": "implicit", "expression": "x^2 + y^2 + z^2 - 1e-4", "steps": 2,
                   "box": {"min": [-0.02, -0.02, -0.02], "max": [0.02, 0.02, 0.02]}},
         "surface": {"stiffness": 500, "texture": {"kind": "expression", "height": "1e-4*sin(2000*u) + 0", "wavelength": 0.003,
           "mapping": {"kind": "plane"}}}},
        {"shape": {"kind": "metaballs", "threshold": 0.2, "steps": 2,
                   "balls": [{"centre": [0, 0, 0], "radius": 0.02, "weight": 1}, {"centre": [0, 0, 0.02], "radius": 0.02}]},
         "surface": {"stiffness": 500}},
        {"shape": {"kind": "csg", "operation": "difference", "blend": 0.001, "steps": 2, "parts": [
           {"kind": "sphere", "radius": 0.02},
           {"kind": "csg", "operation": "union", "parts": [{"kind": "box", "size": [0.01, 0.01, 0.01]},
              {"kind": "implicit", "expression": "z", "box": {"min": -0.01, "max": 0.01}}]},
           {"kind": "plane", "point": [0, 0, 0.01], "normal": [0, 0, -1]}]},
         "surface": {"stiffness": 500}}]})"),
  };
  std::vector<json> scenes = whole;
  for (const json& scene : whole) change_scene(scene, scene, json::json_pointer(), scenes);
  ASSERT_GT(scenes.size(), 250U);
  const std::vector<bool> valid = scenes_by_schema(scenes);
  ASSERT_EQ(valid.size(), scenes.size());
  for (std::size_t i = 0; i < valid.size(); ++i)
    EXPECT_EQ(scene_is_read(scenes[i]), valid[i])
        << (valid[i] ? "only the schema takes " : "only the reader takes ") << scenes[i].dump();
}

TEST(SceneSchema, TakesThePatchesThatTheReaderTakes) {
  const json good = json::parse(R"({"degree": [1, 1], "knots_u": [0, 0, 1, 1], "knots_v": [0, 0, 1, 1],
    "points": [[[0, 0, 0, 1], [0, 0.1, 0, 1]], [[0.1, 0, 0, 1], [0.1, 0.1, 0, 1]]],
    "trim": {"outer": [[[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]]],
             "holes": [[{"degree": 1, "knots": [0, 0, 1, 2, 2], "points": [[0.2, 0.2, 1], [0.4, 0.2], [0.2, 0.4]]}]]}})");
  std::vector<json> patches{good};
  const auto change = [&](const char* at, const json& value) {
    json patch = good;
    patch[json::json_pointer(at)] = value;
    patches.push_back(patch);
  };
  change("/degree", 1);
  for (const json& degree : {json(0), json(6), json(1.5), json("1"), json{1}, json{1, 1, 1}, json{1, 6}})
    change("/degree", degree);
  for (const char* key : {"/knots_u", "/knots_v", "/points", "/points/0", "/points/0/1", "/trim", "/trim/outer",
                          "/trim/holes", "/trim/holes/0", "/trim/holes/0/0/knots", "/trim/holes/0/0/points"}) {
    change(key, "text");
    change(key, 5);
    change(key, true);
  }
  for (const double weight : {0.0, -1.0, 1e-7, 1e7, 2.0}) change("/points/0/1/3", weight);
  for (const double weight : {0.0, -1.0, 1e-7, 1e7, 2.0}) change("/trim/holes/0/0/points/0/2", weight);
  change("/points/0/1", {0, 0.1, 0});
  change("/points/0/1", {0, 0.1});
  change("/points/0/1", {0, 0.1, 0, 1, 1});
  change("/trim/outer/0/0", {0.1, 0.1, 0.1});
  change("/trim/holes/0/0/degree", 6);
  change("/trim/holes/0/0/zzz", 6);
  change("/trim/zzz", 6);
  change("/zzz", 6);
  for (const char* key : {"degree", "knots_u", "knots_v", "points", "trim"}) {
    json patch = good;
    patch.erase(key);
    patches.push_back(patch);
  }
  std::vector<json> scenes;
  const auto scene_of = [](json shape) {
    shape["kind"] = "nurbs";
    return json{{"objects", {{{"shape", shape}, {"surface", {{"stiffness", 500}}}}}}};
  };
  for (const json& patch : patches) scenes.push_back(scene_of({{"patches", {patch}}}));
  scenes.push_back(scene_of({{"patches", {good}}, {"unit", "mm"}, {"flip", true}}));
  scenes.push_back(scene_of({{"patches", {good}}, {"unit", 5}}));
  scenes.push_back(scene_of({{"patches", {good}}, {"flip", 1}}));
  for (const json& steps : {json(1), json(6), json(0), json(7), json(1.5), json("1")})
    scenes.push_back(scene_of({{"patches", {good}}, {"steps", steps}}));
  for (const json& tolerance : {json(1e-6), json(1e-2), json(1e-7), json(2e-2), json("1")})
    scenes.push_back(scene_of({{"patches", {good}}, {"tessellation", tolerance}}));
  scenes.push_back(scene_of({{"patches", json::array()}}));
  scenes.push_back(scene_of({{"patches", {good}}, {"file", "a.json"}}));
  scenes.push_back(scene_of(json::object()));
  const std::vector<bool> valid = scenes_by_schema(scenes);
  ASSERT_EQ(valid.size(), scenes.size());
  EXPECT_TRUE(valid[0]);
  for (std::size_t i = 0; i < valid.size(); ++i)
    EXPECT_EQ(scene_is_read(scenes[i]), valid[i])
        << (valid[i] ? "only the schema takes " : "only the reader takes ") << scenes[i].dump();
}

TEST(SceneSchema, TakesTheSettingsOfAMeshThatTheReaderTakes) {
  std::vector<json> scenes;
  const auto add = [&](const char* key, const json& value) {
    json shape{{"kind", "mesh"}, {"file", std::string(HAPTRACE_SAMPLES) + "/scenes/hills.obj"}, {"unit", "mm"}};
    shape[key] = value;
    scenes.push_back({{"objects", {{{"shape", shape}, {"surface", {{"stiffness", 500}}}}}}});
  };
  add("unit", "m");
  for (const json& count : {json(4), json(1000.0), json(20'000'000), json(3), json(0), json(-1), json(20'000'001),
                            json(1000.5), json("1000"), json(true), json(nullptr)})
    add("triangles", count);
  for (const json& rounds : {json(1), json(16), json(0), json(17), json(1.5), json("1")}) add("rounds", rounds);
  for (const json& verify : {json(true), json(false), json(1), json("true")}) add("verify", verify);
  add("triangle", 1000);
  const std::vector<bool> valid = scenes_by_schema(scenes);
  ASSERT_EQ(valid.size(), scenes.size());
  EXPECT_TRUE(valid[0]);
  for (std::size_t i = 0; i < valid.size(); ++i)
    EXPECT_EQ(scene_is_read(scenes[i]), valid[i])
        << (valid[i] ? "only the schema takes " : "only the reader takes ") << scenes[i].dump();
}

TEST(SceneSchema, TakesTheSamples) {
  std::vector<json> scenes;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(HAPTRACE_SAMPLES) + "/scenes")) {
    if (entry.path().extension() != ".json") continue;
    scenes.push_back(load_json(entry.path().string()));
    EXPECT_NO_THROW((void)load_scene(entry.path().string())) << entry.path();
  }
  ASSERT_GE(scenes.size(), 7U);
  for (const bool valid : scenes_by_schema(scenes)) EXPECT_TRUE(valid);
}

}  // namespace
}  // namespace haptrace
