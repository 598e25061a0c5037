// Rational B-spline patches as a shape.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/shape/bvh.h"
#include "scene/shape/nurbs_sheet.h"
#include "scene/shape/shape.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A surface of rational B-spline patches, touched by a point or a ball.
///
/// The first contact is found by a sweep through a tessellation, and by the distance from it; then Newton's method
/// finds the place on the patch itself. In contact, the foot of the proxy follows the tool in (u, v): one step of
/// Gauss and Newton takes it along, (du, dv) = G^-1 (Su . dh, Sv . dh), and `steps` steps of Newton polish it. A step
/// that would take the foot farther from the tool is halved, so the foot moves downhill and jumps nowhere. Over the
/// edge of a patch it goes on in the patch that is joined there; at an open edge, or over the edge of a hole, the tool
/// comes off. At a pole, it goes on in the direction that leads down.
///
/// A ball is held by the surface at its radius from this one, which has the same feet and normals where the radius of
/// curvature is larger than the ball. It rolls over convex edges. A ball that does not fit a concave place is refused.
///
/// Settings: `steps` of Newton in a tick; `tessellation` is the tolerance of the triangles in which contacts begin [m].
class Nurbs final : public Shape {
 public:
  /// `name` stands for the patches in errors. Throws Error(input).
  Nurbs(const std::vector<NurbsData>& patches, bool flip, const std::string& name);

  void prepare(double radius) override;
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  void approach(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override { return sheet_.remarks(); }
  [[nodiscard]] Box bounds() const noexcept override { return bounds_; }
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

  [[nodiscard]] const NurbsSheet& sheet() const noexcept { return sheet_; }

 private:
  /// Where the proxy stands.
  struct Foot {
    SheetPlace place;
    std::uint32_t part = NurbsTrim::kNone;  ///< of the trimming, on whose edge it stands
    SurfaceJet jet;
    enum class Held : std::uint8_t { inside, edge, off } held = Held::inside;
    Vec3 other = Vec3::Zero();  ///< normal beyond the edge that holds it
    Vec3 along = Vec3::Zero();  ///< direction of this edge; zero at a corner
  };
  struct Candidate;
  class EdgeCrossing;
  class Descent;

  void set_down(Foot& foot, const SheetPlace& place) const noexcept;
  [[nodiscard]] Foot foot_at(const SheetPlace& place) const noexcept;
  [[nodiscard]] Foot foot_in(std::uint32_t triangle, const Vec3& place) const noexcept;
  void descend(Foot& foot, const Vec3& tool, int steps) const noexcept;
  bool move(Foot& foot, const Vec3& tool, const Vec2& step) const noexcept;
  [[nodiscard]] SheetJoin join_at(const SheetPlace& place, std::size_t side, double& share) const noexcept;
  [[nodiscard]] Vec3 normal_of(const Foot& foot) const noexcept;
  [[nodiscard]] SurfacePoint surface_point(const Foot& foot, const Vec3& tool) const noexcept;
  bool stand(const Foot& foot, const ToolStep& step, Proxy& proxy) const noexcept;
  void begin(const ToolStep& step, Proxy& proxy) const noexcept;

  NurbsSheet sheet_;
  SheetMesh start_;
  TriangleTree tree_;
  Box bounds_;
  double made_with_ = 0;  ///< tolerance of start_ [m]
  double tolerance_ = 1e-4;
  double least_radius_ = std::numeric_limits<double>::infinity();  ///< of concave curvature [m]
  Vec3 least_at_ = Vec3::Zero();
  int steps_ = 2;
};

/// Reads the keys `patches` or `file`, `unit`, `flip`, and the settings.
std::unique_ptr<Shape> read_nurbs(JsonReader& reader, SceneFiles& files);

}  // namespace haptrace
