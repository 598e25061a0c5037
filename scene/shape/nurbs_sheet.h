// Patches that are joined at their edges, and their tessellation.
#pragma once

#include "base/triangle_mesh.h"
#include "scene/shape/nurbs_patch.h"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace haptrace {

/// A place on a sheet.
struct SheetPlace {
  std::uint32_t patch = 0;
  Vec2 at = Vec2::Zero();  ///< (u, v)
};

/// Triangles of a sheet, each on one patch.
struct SheetMesh {
  TriangleMesh mesh;
  std::vector<SheetPlace> places;  ///< of the vertices
};

/// The neighbour beyond a part of a patch's edge.
struct SheetJoin {
  static constexpr std::uint32_t kOpen = 0xffffffff;
  std::uint32_t patch = kOpen;
  std::uint32_t part = 0;                       ///< of the other patch's edge, if it is trimmed; else the side
  Vec2 from = Vec2::Zero(), to = Vec2::Zero();  ///< (u, v) there of the ends of this part
};

/// One patch of a sheet.
struct SheetPatch {
  static constexpr std::size_t kParts = 32;  ///< of each side of an untrimmed patch

  explicit SheetPatch(const NurbsData& data) : surface(data), trim(data) {}

  /// Returns the place at a share of a side: 0: least u, 1: most u, 2: least v, 3: most v.
  [[nodiscard]] Vec2 on_side(std::size_t side, double share) const noexcept;
  [[nodiscard]] Vec2 clamped(const Vec2& at) const noexcept {
    return at.cwiseMax(surface.least()).cwiseMin(surface.most());
  }
  /// Returns the unit normal out of the surface. Where du x dv vanishes, the limit from inside the patch.
  [[nodiscard]] Vec3 normal(const Vec2& at, const SurfaceJet& jet) const noexcept;

  /// Returns the jet at a place, or a little inside the patch where du or dv vanishes.
  [[nodiscard]] SurfaceJet regular(const Vec2& at) const noexcept;

  NurbsPatch surface;
  NurbsTrim trim;
  double sign = 1;                    ///< -1: the outside is dv x du
  double length_u = 0, length_v = 0;  ///< typical |du|, |dv|
  std::array<bool, 4> pole{};         ///< all points of a side are the same
  std::vector<SheetJoin> joins;  ///< of the parts of the four sides, one after the other, or of the trimming's parts
};

/// Patches that know their neighbours. A part of an edge is joined to the edge that runs through the same points,
/// whatever its parameters and its patch's size. All that is joined has its outside on the same side.
class NurbsSheet {
 public:
  /// Throws Error(input) naming a patch that is no surface, or a sheet with only one side. `flip`: the outside is
  /// dv x du of the first patch of each part of the sheet.
  NurbsSheet(const std::vector<NurbsData>& patches, bool flip, const std::string& name);

  [[nodiscard]] const std::vector<SheetPatch>& patches() const noexcept { return patches_; }
  [[nodiscard]] double size() const noexcept { return size_; }
  [[nodiscard]] bool closed() const noexcept { return open_ == 0; }
  [[nodiscard]] const std::vector<std::string>& remarks() const noexcept { return remarks_; }

  /// Sharpest concave edge: sine of the angle between its sides, and a place [m].
  struct Valley {
    double sine = 0;
    Vec3 place = Vec3::Zero();
  };
  [[nodiscard]] const Valley& valley() const noexcept { return valley_; }

  /// Returns triangles within `tolerance` [m] of the surface. Joined edges with the same parameters leave no gap.
  [[nodiscard]] SheetMesh tessellate(double tolerance) const;

 private:
  void check_patch(SheetPatch& patch, const std::string& where) const;
  void join_edges();
  void orient(bool flip, const std::string& name);
  void find_valleys();

  std::vector<SheetPatch> patches_;
  double size_ = 0;  ///< diagonal of the box around the points [m]
  std::size_t open_ = 0;
  Vec3 open_at_ = Vec3::Zero();
  Valley valley_;
  std::vector<std::string> remarks_;
};

/// Returns the largest curvature towards the outside [1/m], 0 if there is none.
double concave_curvature(const SurfaceJet& jet, const Vec3& normal) noexcept;

}  // namespace haptrace
