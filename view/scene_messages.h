// Messages that describe a virtual scene to a page (docs/view-protocol.md). Private to view.
#pragma once

#include "formats/recording/recording.h"
#include "view/frames.h"
#include "view/shown_scene.h"

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// Returns the message `scene`.
nlohmann::json scene_message(const std::vector<ShownObject>& objects, std::uint32_t id);

/// Returns the meshes of the objects that have one, for the scene with this id.
std::vector<Frame> mesh_frames(const std::vector<ShownObject>& objects, std::uint32_t id);

/// Returns the objects of a recorded scene. Its files are sought beside the recording, and then in the folder of the
/// scene file. If one is in neither, or has changed, the objects have no mesh.
std::vector<ShownObject> shown_objects(const RecordedScene& scene, const std::string& recording);

}  // namespace haptrace
