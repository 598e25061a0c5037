// A torus.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/solid.h"

#include <memory>

namespace haptrace {

struct TorusSpec {
  Vec3 centre = Vec3::Zero();  ///< [m]
  double radius = 0.03;        ///< of the circle in the middle of the tube [m], 1e-6 to 100
  double tube = 0.01;          ///< radius of the tube [m], at least 1e-6 and less than `radius`
};

/// A ring around z.
///
/// A tool has one surface point at which the distance is least, except in three places, where the last normal applies:
/// the middle of the tube, the axis, and a hole that is too narrow for the ball. Such a hole is closed: the ball rests
/// in its mouth, on the side from which it came.
class Torus final : public Solid {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Torus(const TorusSpec& spec);

  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;

 private:
  [[nodiscard]] SurfacePoint closest(const Vec3& place) const noexcept override;
  [[nodiscard]] Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept override;
  [[nodiscard]] Box extent() const noexcept override;
  [[nodiscard]] bool overlaps(const Box& box) const noexcept override;
  [[nodiscard]] TriangleMesh mesh(double tolerance) const override;

  [[nodiscard]] SurfacePoint foot(const Vec3& place, const Vec3& normal) const noexcept;
  /// Lets a ball that the hole is too narrow for rest in its mouth; false: it does not lie there.
  bool rest(const ToolStep& step, Proxy& proxy) const noexcept;

  double radius_, tube_;
};

/// Reads the keys `radius`, `tube` and `centre`.
std::unique_ptr<Shape> read_torus(JsonReader& reader);

}  // namespace haptrace
