// A plane: the half space behind it.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/shape.h"

#include <memory>

namespace haptrace {

struct PlaneSpec {
  Vec3 point = Vec3::Zero();    ///< any point of it [m]
  Vec3 normal = Vec3::UnitZ();  ///< out of the half space, of any length above 1e-6
};

/// A half space: everything behind the plane through a point. Has no memory.
class Plane final : public Shape {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Plane(const PlaneSpec& spec);

  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Box bounds() const noexcept override;
  [[nodiscard]] bool meets(const Box& space) const noexcept override;
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;

 private:
  Vec3 normal_;    ///< unit normal
  double height_;  ///< height of the surface along the normal [m]
};

/// Reads the keys `point` and `normal`.
std::unique_ptr<Shape> read_plane(JsonReader& reader);

}  // namespace haptrace
