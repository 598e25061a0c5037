// The kinds of shapes that a scene file can name.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/shape/shape.h"

#include <memory>
#include <span>
#include <string>

namespace haptrace {

/// One kind of shape.
struct ShapeKind {
  const char* kind;
  /// Reads every key of the shape but `kind`. Throws Error(input) naming the key, or the file and the place in it.
  std::unique_ptr<Shape> (*read)(JsonReader& reader, SceneFiles& files);
};

/// Returns all kinds. A new kind needs only an entry there.
std::span<const ShapeKind> shape_kinds() noexcept;

/// Returns the kind that the key `kind` names. Throws Error(input) if it is missing or not known.
const ShapeKind& read_kind(JsonReader& reader);

}  // namespace haptrace
