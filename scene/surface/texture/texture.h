// The texture of a surface.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/surface/texture/height.h"

#include <memory>

namespace haptrace {

/// How a height changes the force.
enum class TextureLaw : std::uint8_t {
  /// The spring presses into the raised surface, and the force is the gradient of its energy: a closed loop of the tool
  /// takes and gives no work.
  potential,
  /// Basdogan and Srinivasan, after Blinn and Max and Becker: the force is turned along the normal of the raised
  /// surface
  /// and keeps its size. A closed loop can give work.
  bump,
};

struct Texture {
  std::unique_ptr<Height> height;
  TextureLaw law = TextureLaw::potential;
};

/// Reads {"kind": "perlin", ...}; docs/scene.md lists the keys of every kind. Throws Error(input) naming the key, or
/// the file and the place in it.
Texture read_texture(JsonReader reader, SceneFiles& files);

}  // namespace haptrace
