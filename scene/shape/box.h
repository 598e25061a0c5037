// A box.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/solid.h"

#include <memory>

namespace haptrace {

struct BoxSpec {
  Vec3 centre = Vec3::Zero();        ///< [m]
  Vec3 size = Vec3::Constant(0.06);  ///< lengths of the edges along x, y, z [m], 1e-6 to 100
};

/// A box whose edges are parallel to the axes. See Convex for its contact.
class BoxShape final : public Convex {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit BoxShape(const BoxSpec& spec);

 private:
  [[nodiscard]] Face entered(const Vec3& from, const Vec3& to) const noexcept override;
  [[nodiscard]] Face face_at(const Vec3& place) const noexcept override;
  bool held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept override;
  [[nodiscard]] SurfacePoint outside(const Vec3& place) const noexcept override;
  [[nodiscard]] Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept override;
  [[nodiscard]] Box extent() const noexcept override;
  [[nodiscard]] bool overlaps(const Box& box) const noexcept override;
  [[nodiscard]] TriangleMesh mesh(double tolerance) const override;

  Vec3 half_;  ///< half the edges [m]
};

/// Reads the keys `size` and `centre`.
std::unique_ptr<Shape> read_box(JsonReader& reader);

}  // namespace haptrace
