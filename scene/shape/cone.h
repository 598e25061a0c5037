// A cone.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/solid.h"

#include <memory>

namespace haptrace {

struct ConeSpec {
  Vec3 centre = Vec3::Zero();  ///< of the base [m]
  double radius = 0.03;        ///< of the base [m], 1e-6 to 100
  double height = 0.06;        ///< of the apex over the base, along z [m], 1e-6 to 100
};

/// A cone around z, closed by its base. See Convex for its contact. On the axis, the last normal applies.
class Cone final : public Convex {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Cone(const ConeSpec& spec);

 private:
  [[nodiscard]] Face entered(const Vec3& from, const Vec3& to) const noexcept override;
  [[nodiscard]] Face face_at(const Vec3& place) const noexcept override;
  bool held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept override;
  [[nodiscard]] SurfacePoint outside(const Vec3& place) const noexcept override;
  [[nodiscard]] Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept override;
  [[nodiscard]] Box extent() const noexcept override;
  [[nodiscard]] bool overlaps(const Box& box) const noexcept override;
  [[nodiscard]] TriangleMesh mesh(double tolerance) const override;

  /// Returns the height over the flank, negative inside [m].
  [[nodiscard]] double over(const Meridian& seen) const noexcept;
  /// Returns the distance along the flank from the rim to the foot of a place [m].
  [[nodiscard]] double along(const Meridian& seen) const noexcept;

  double radius_, height_;
  double length_;    ///< of the flank, from the rim to the apex [m]
  double out_, up_;  ///< normal of the flank: away from the axis, and along z
};

/// Reads the keys `radius`, `height` and `centre`.
std::unique_ptr<Shape> read_cone(JsonReader& reader);

}  // namespace haptrace
