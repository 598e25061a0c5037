// The contents of a scene and their costs.
#pragma once

#include "scene/scene.h"

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// One object of a scene.
struct ObjectReport {
  std::string name, kind;
  Box bounds;                 ///< in W [m]; infinite where the object is
  std::size_t triangles = 0;  ///< of its picture
  std::vector<Knob> knobs;    ///< accuracy settings
  double touched_s = 0;       ///< CPU time of a tick of the scene with the tool in this object, median [s]; NaN: no
                              ///< place to touch it was found
};

struct SceneReport {
  std::vector<ObjectReport> objects;
  std::vector<std::string> notes;  ///< see Scene::notes()
  double free_s = 0;               ///< CPU time of a tick with the tool far from every object, median [s]
  double tool_radius = 0;          ///< [m]
};

/// Size of the box around the origin within which infinite objects are drawn and touched [m].
inline constexpr double kSceneSpace = 0.2;

/// Returns the box in which a scene is drawn: around its finite objects, or of kSceneSpace.
Box space_of(const Scene& scene);

/// Reports a scene, which it prepares for this rate and touches. Takes milliseconds for an object, and seconds for
/// thousands.
SceneReport report_scene(Scene& scene, double rate_hz);

nlohmann::json to_json(const SceneReport& report);
/// Returns the report for a terminal. If there are more than 40 objects, it lists the 40 that cost most.
std::string text_of(const SceneReport& report);

}  // namespace haptrace
