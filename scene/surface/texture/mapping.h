// Two-stage mapping of a flat texture onto a shape.
#pragma once

#include "base/json_reader.h"
#include "base/types.h"

#include <cstdint>

namespace haptrace {

/// The intermediate surface of a mapping (Bier and Sloan 1986).
enum class MappingKind : std::uint8_t { plane, cylinder, sphere, cube };

/// A place on the flat texture and how it moves with the place on the shape.
struct MappedPlace {
  double u = 0, v = 0;                        ///< in lengths of the texture's sides
  Vec3 du = Vec3::Zero(), dv = Vec3::Zero();  ///< gradients [1/m]
};

/// Maps a place in the shape's frame onto the texture, along the normal of the intermediate surface (from the centre
/// for the cube). The plane is xy, and a side of the texture `size` long. Around the cylinder (axis z), the sphere
/// (poles on z) and each face of the cube the texture fits `repeat` times; `size` is its length along the cylinder.
struct Mapping {
  MappingKind kind = MappingKind::plane;
  Vec3 origin = Vec3::Zero();  ///< in the shape's frame [m]
  double size = 0.05;          ///< [m]
  int repeat = 1;

  /// Real-time.
  [[nodiscard]] MappedPlace at(const Vec3& place) const noexcept;
};

/// Reads {"kind", "origin", "size", "repeat"}.
Mapping read_mapping(JsonReader reader);

}  // namespace haptrace
