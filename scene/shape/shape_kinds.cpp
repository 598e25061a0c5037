#include "scene/shape/shape_kinds.h"

#include "scene/shape/box.h"
#include "scene/shape/cone.h"
#include "scene/shape/cylinder.h"
#include "scene/shape/ellipsoid.h"
#include "scene/shape/implicit_kinds.h"
#include "scene/shape/mesh.h"
#include "scene/shape/nurbs.h"
#include "scene/shape/plane.h"
#include "scene/shape/sphere.h"
#include "scene/shape/torus.h"
#include "scene/shape/volume.h"

#include <algorithm>
#include <array>
#include <vector>

namespace haptrace {
namespace {

using Made = std::unique_ptr<Shape>;

constexpr std::array kShapeKinds{
    ShapeKind{"box", [](JsonReader& reader, SceneFiles&) -> Made { return read_box(reader); }},
    ShapeKind{"cone", [](JsonReader& reader, SceneFiles&) -> Made { return read_cone(reader); }},
    ShapeKind{"csg", [](JsonReader& reader, SceneFiles&) -> Made { return read_csg(reader); }},
    ShapeKind{"cylinder", [](JsonReader& reader, SceneFiles&) -> Made { return read_cylinder(reader); }},
    ShapeKind{"ellipsoid", [](JsonReader& reader, SceneFiles&) -> Made { return read_ellipsoid(reader); }},
    ShapeKind{"implicit", [](JsonReader& reader, SceneFiles&) -> Made { return read_implicit(reader); }},
    ShapeKind{"mesh", read_mesh},
    ShapeKind{"metaballs", [](JsonReader& reader, SceneFiles&) -> Made { return read_metaballs(reader); }},
    ShapeKind{"nurbs", read_nurbs},
    ShapeKind{"sphere", [](JsonReader& reader, SceneFiles&) -> Made { return read_sphere(reader); }},
    ShapeKind{"torus", [](JsonReader& reader, SceneFiles&) -> Made { return read_torus(reader); }},
    ShapeKind{"volume", read_volume},
    ShapeKind{"wall", [](JsonReader& reader, SceneFiles&) -> Made { return read_plane(reader); }},
    ShapeKind{"plane", [](JsonReader& reader, SceneFiles&) -> Made { return read_plane(reader); }},
};

}  // namespace

std::span<const ShapeKind> shape_kinds() noexcept {
  return kShapeKinds;
}

const ShapeKind& read_kind(JsonReader& reader) {
  std::vector<std::string> known;
  for (const ShapeKind& kind : kShapeKinds) known.emplace_back(kind.kind);
  const std::string word = reader.require("kind").choice("kind", "", known);
  return *std::find_if(kShapeKinds.begin(), kShapeKinds.end(),
                       [&](const ShapeKind& kind) { return kind.kind == word; });
}

}  // namespace haptrace
