// An iso-surface of a volume.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/shape/scalar_field.h"
#include "scene/shape/shape.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

struct VolumeSpec {
  double iso = 0;               ///< value of the samples at the surface
  bool inside_above = true;     ///< inside, the values are above iso; else below
  int order = 3;                ///< of interpolation: 1 or 3
  int steps = 2;                ///< of the proxy in a tick, 1 to 10
  std::string name = "volume";  ///< stands for the file in errors
};

/// The surface at which the values of a volume pass a given one. Beyond the border of the grid there is nothing: a
/// surface that meets the border is closed within one sample of it.
///
/// The field g of the shape is the value minus iso, negative inside. The proxy x of a tool h is the surface point at
/// which their distance is least. Each step solves g = 0 and x - h parallel to grad g by Newton's method: along the
/// principal directions of the surface, with curvature k and depth d, the tangential error is divided by 1 - d k, and
/// the distance to the surface is removed up to the second order of the step. A step is no longer than half a sample,
/// turns the normal by less than 60 degrees and does not increase the distance, so that the proxy does not get to the
/// other side of a thin part. The first contact is where the tool's step enters the surface.
///
/// A ball touches at the surface point whose distance along its normal is the radius, which prepare() refuses where the
/// surface is too hollow for it.
///
/// Settings: `interpolation` 1 or 3, see ScalarField; `steps` in a tick at most, besides those that a fast tool needs.
class Volume final : public Shape {
 public:
  /// Throws Error(input) if no value lies on the one side of iso, or none on the other.
  Volume(std::shared_ptr<const VolumeData> data, const VolumeSpec& spec, std::vector<std::string> remarks = {});

  void prepare(double radius) override;
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  void approach(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override { return remarks_; }
  [[nodiscard]] Box bounds() const noexcept override { return bounds_; }
  /// By surface nets (Gibson 1998), whose vertices are then moved onto the surface.
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

  /// Shows the surface of an object without contact with it, whose bounds are given: a field.
  void only_show(const Box& bounds);

  /// Returns the values as they were read.
  [[nodiscard]] const std::shared_ptr<const VolumeData>& data() const noexcept { return data_; }
  [[nodiscard]] const ScalarField& field() const noexcept { return *field_; }

 private:
  struct Foot {
    Vec3 place, gradient;
  };

  [[nodiscard]] Foot moved(const Vec3& start, const Vec3& goal, int steps) const noexcept;
  [[nodiscard]] Vec3 first_contact(const ToolStep& step, bool outside) const noexcept;
  [[nodiscard]] bool inside(const Vec3& place) const noexcept;
  void build();
  void check_ball(double radius) const;

  std::shared_ptr<const VolumeData> data_;
  VolumeSpec spec_;
  std::vector<std::string> remarks_;
  std::unique_ptr<ScalarField> field_;
  double longest_ = 0;  ///< step of a proxy [m]
  Box bounds_;
  bool shown_only_ = false;
};

/// Reads the keys `file`, `unit`, `iso`, `inside`, `interpolation` and `steps`.
std::unique_ptr<Shape> read_volume(JsonReader& reader, SceneFiles& files);

}  // namespace haptrace
