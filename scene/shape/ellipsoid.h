// An ellipsoid.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/solid.h"

#include <memory>

namespace haptrace {

struct EllipsoidSpec {
  Vec3 centre = Vec3::Zero();         ///< [m]
  Vec3 radii = Vec3::Constant(0.03);  ///< half the axes along x, y, z [m], 1e-6 to 100
};

/// An ellipsoid whose axes are parallel to x, y and z. See Convex for its contact.
///
/// The closest surface point x of a place h solves x_i = a_i^2 h_i / (a_i^2 + l), |x / a| = 1. With c the shortest half
/// axis and b the next, the root l > -c^2 is the closest point. A second point at which the distance is least lies on
/// the other side of the plane of the two longer axes, at a root -b^2 < l < -c^2; there are no others (Martinez 1994).
/// So the side on which the tool entered is the whole history of a contact: a tool pressed beyond the far side of a
/// thin disc stays on the side on which it entered, as long as this point exists.
class Ellipsoid final : public Convex {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Ellipsoid(const EllipsoidSpec& spec);

 private:
  [[nodiscard]] Face entered(const Vec3& from, const Vec3& to) const noexcept override;
  [[nodiscard]] Face face_at(const Vec3& place) const noexcept override;
  bool held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept override;
  [[nodiscard]] SurfacePoint outside(const Vec3& place) const noexcept override;
  [[nodiscard]] Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept override;
  [[nodiscard]] Box extent() const noexcept override;
  [[nodiscard]] bool overlaps(const Box& box) const noexcept override;
  [[nodiscard]] TriangleMesh mesh(double tolerance) const override;

  /// Returns the closest surface point of a place. `normal` gives the direction where there is none.
  [[nodiscard]] SurfacePoint closest_to(const Vec3& place, const Vec3& normal, double side) const noexcept;
  /// Sets the least point on the side of the shortest axis on which the tool is not; false: there is none.
  bool beyond(const Vec3& place, SurfacePoint& foot) const noexcept;
  /// Returns the point of the surface, with its normal and the distance of a place along it.
  [[nodiscard]] SurfacePoint at(const Vec3& surface, const Vec3& place) const noexcept;
  /// Returns |x / a|^2 - 1 for l = shift - c^2, and its derivative.
  [[nodiscard]] std::pair<double, double> excess(const Vec3& place, double shift) const noexcept;

  Vec3 radii_;
  Vec3 gap_;          ///< a_i^2 - c^2 [m^2]
  int shortest_ = 0;  ///< axis of c
};

/// Reads the keys `radii` and `centre`.
std::unique_ptr<Shape> read_ellipsoid(JsonReader& reader);

}  // namespace haptrace
