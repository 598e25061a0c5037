// A frictionless sphere: the first object of the chapter, Fig. 6.2.
#pragma once

#include "scene/penalty.h"

#include <memory>

namespace haptrace {

struct SphereSpec {
  Vec3 centre = Vec3::Zero();  ///< in W [m]
  double radius = 0.03;        ///< [m], 1e-6 to 100
  PenaltySpec surface;
  double renew = 0;  ///< see Sphere [m], 0 to the radius
};

/// Pushes the tool out along its radius; no force outside. At the centre, where the radius has no direction, the last
/// normal applies, or z if there is none. A tool pushed through the centre leaves on the other side.
///
/// The accuracy setting `renew` is the distance that the tool may move before the normal is computed again. Until then
/// the sphere is replaced by its tangent plane at that normal. With r the tool's distance from the centre at that
/// moment and e = min(renew, r / 2),
///
///     the plane is deeper than the sphere, by at most e^2 / (2 r),
///     and its normal is off by at most asin(e / r).
///
/// Renewing can only lower the energy in the spring, so a coarser setting is not less passive; it adds a slight drag.
///
/// Memory: that plane.
class Sphere final : public SceneObject {
 public:
  /// Throws Error(input) naming the value that is out of range.
  Sphere(std::string name, const SphereSpec& spec);

  [[nodiscard]] const std::string& name() const noexcept override { return name_; }
  void prepare(const SceneTiming& timing) override { surface_.prepare(timing); }
  void reset() noexcept override;
  [[nodiscard]] Contact answer(const Touch& touch) noexcept override;
  [[nodiscard]] bool meets(const Box& space) const noexcept override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  void renew(const Vec3& place) noexcept;

  std::string name_;
  SphereSpec spec_;
  Penalty surface_;
  Vec3 normal_ = Vec3::UnitZ();
  Vec3 from_ = nan3();  ///< tool position at which the normal was computed; NaN before the first time [m]
  double reach2_ = 0;   ///< squared distance from there within which the normal applies [m^2]
};

/// Reads {"kind": "sphere", "centre": [x, y, z], "radius": m, "stiffness": N/m, "damping", "lead", "renew"}
std::unique_ptr<SceneObject> read_sphere(JsonReader& reader, const std::string& name);

}  // namespace haptrace
