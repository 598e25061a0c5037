// Implicit surfaces in scene files: expressions, metaballs, Boolean combinations.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/shape.h"

#include <memory>

namespace haptrace {

/// Reads the keys `expression`, `box` and `steps`.
std::unique_ptr<Shape> read_implicit(JsonReader& reader);
/// Reads the keys `balls`, `threshold` and `steps`.
std::unique_ptr<Shape> read_metaballs(JsonReader& reader);
/// Reads the keys `operation`, `parts`, `blend` and `steps`.
std::unique_ptr<Shape> read_csg(JsonReader& reader);

}  // namespace haptrace
