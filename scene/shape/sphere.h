// A sphere.
#pragma once

#include "base/json_reader.h"
#include "scene/shape/shape.h"

#include <memory>

namespace haptrace {

struct SphereSpec {
  Vec3 centre = Vec3::Zero();  ///< [m]
  double radius = 0.03;        ///< [m], 1e-6 to 100
  double renew = 0;            ///< see Sphere [m], 0 to the radius
};

/// A sphere (Basdogan and Srinivasan, Fig. 6.2). The proxy is always the nearest surface point: a tool pushed through
/// the centre leaves on the other side. At the centre, where the radius has no direction, the last normal applies, or z
/// if there is none.
///
/// The accuracy setting `renew` is the distance that the tool may move before the normal is computed again. Until then
/// the sphere is replaced by its tangent plane at that normal. With r the tool's distance from the centre at that
/// moment and e = min(renew, r / 2),
///
///     the plane is deeper than the sphere, by at most e^2 / (2 r),
///     and its normal is off by at most asin(e / r).
///
/// Renewing can only lower the energy in a linear spring, so a coarser setting is not less passive; it adds a slight
/// drag.
class Sphere final : public Shape {
 public:
  /// Throws Error(input) naming the value that is out of range.
  explicit Sphere(const SphereSpec& spec);

  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] Box bounds() const noexcept override;
  [[nodiscard]] bool meets(const Box& space) const noexcept override;
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  void renew(const Vec3& place, Proxy& proxy) const noexcept;

  SphereSpec spec_;
};

/// Reads the keys `centre`, `radius` and `renew`.
std::unique_ptr<Shape> read_sphere(JsonReader& reader);

}  // namespace haptrace
