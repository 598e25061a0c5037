#include "scene/surface/texture/mapping.h"

#include "base/enum_names.h"

#include <array>
#include <cmath>
#include <numbers>
#include <string>

namespace haptrace {
namespace {

using std::numbers::pi;

constexpr EnumNames<MappingKind, 4> kMappings{"mapping", {"plane", "cylinder", "sphere", "cube"}};
constexpr double kAxis2 = 1e-18;  // squared distance from an axis or centre below which angles have no meaning [m^2]

}  // namespace

MappedPlace Mapping::at(const Vec3& place) const noexcept {
  const Vec3 p = place - origin;
  MappedPlace mapped;
  switch (kind) {
    case MappingKind::plane:
      return {p.x() / size, p.y() / size, Vec3(1 / size, 0, 0), Vec3(0, 1 / size, 0)};
    case MappingKind::cylinder:
    case MappingKind::sphere: {
      const double square = p.x() * p.x() + p.y() * p.y();
      if (!(square > kAxis2)) return mapped;
      const double turns = repeat / (2 * pi);
      mapped.u = turns * std::atan2(p.y(), p.x());
      mapped.du = turns / square * Vec3(-p.y(), p.x(), 0);
      if (kind == MappingKind::cylinder) {
        mapped.v = p.z() / size;
        mapped.dv = Vec3(0, 0, 1 / size);
      } else {
        const double axis = std::sqrt(square), radius2 = square + p.z() * p.z();
        mapped.v = repeat / pi * std::atan2(p.z(), axis);
        mapped.dv = repeat / pi / radius2 * Vec3(-p.x() * p.z() / axis, -p.y() * p.z() / axis, axis);
      }
      return mapped;
    }
    case MappingKind::cube: {
      int face = 0;
      p.cwiseAbs().maxCoeff(&face);
      const double depth = std::abs(p[face]);
      if (!(depth * depth > kAxis2)) return mapped;
      const int a = (face + 1) % 3, b = (face + 2) % 3;
      const double scale = 0.5 * repeat, sign = p[face] > 0 ? 1 : -1;
      mapped.u = scale * (p[a] / depth + 1);
      mapped.v = scale * (p[b] / depth + 1);
      mapped.du[a] = mapped.dv[b] = scale / depth;
      mapped.du[face] = -sign * scale * p[a] / (depth * depth);
      mapped.dv[face] = -sign * scale * p[b] / (depth * depth);
      return mapped;
    }
  }
  return mapped;
}

Mapping read_mapping(JsonReader reader) {
  Mapping mapping;
  const std::array<std::string, 4> known{"plane", "cylinder", "sphere", "cube"};
  mapping.kind = kMappings.parse(reader.choice("kind", "plane", known));
  mapping.origin = reader.vector("origin", mapping.origin, -100, 100);
  mapping.size = reader.number("size", mapping.size, 1e-5, 100);
  mapping.repeat = reader.integer("repeat", 1, 1, 10'000);
  reader.finish();
  return mapping;
}

}  // namespace haptrace
