// A cylinder.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/solid.h"

#include <memory>

namespace haptrace {

struct CylinderSpec {
  Vec3 centre = Vec3::Zero();  ///< [m]
  double radius = 0.03;        ///< [m], 1e-6 to 100
  double height = 0.06;        ///< along z [m], 1e-6 to 100
};

/// A cylinder around z, closed at both ends. See Convex for its contact. A tool that is pushed through the axis leaves
/// on the other side; on the axis itself, the last normal applies.
class Cylinder final : public Convex {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Cylinder(const CylinderSpec& spec);

 private:
  [[nodiscard]] Face entered(const Vec3& from, const Vec3& to) const noexcept override;
  [[nodiscard]] Face face_at(const Vec3& place) const noexcept override;
  bool held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept override;
  [[nodiscard]] SurfacePoint outside(const Vec3& place) const noexcept override;
  [[nodiscard]] Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept override;
  [[nodiscard]] Box extent() const noexcept override;
  [[nodiscard]] bool overlaps(const Box& box) const noexcept override;
  [[nodiscard]] TriangleMesh mesh(double tolerance) const override;

  double radius_, half_;  ///< half the height [m]
};

/// Reads the keys `radius`, `height` and `centre`.
std::unique_ptr<Shape> read_cylinder(JsonReader& reader);

}  // namespace haptrace
