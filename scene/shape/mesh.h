// A surface of triangles.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/shape/bvh.h"
#include "scene/shape/constraint_planes.h"
#include "scene/shape/mesh_topology.h"
#include "scene/shape/shape.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A mesh that is touched by a point or a ball.
///
/// Point: the first contact is found by a sweep through a tree of boxes. Then the proxy walks over faces, edges and
/// vertices, always downhill towards the tool and only through parts that hold the present place (Ho, Basdogan and
/// Srinivasan 1999), so it cannot jump through a thin part. Where the tool is in front of the face, or of the sum of
/// the normals around an edge or a vertex, the proxy leaves the surface and goes straight to the tool: to the next
/// surface in the way, such as the other flank of a crease, or all the way, which ends the contact. On a closed mesh
/// the contact ends only if the mesh does not wind around the tool.
///
/// Ball: its centre moves on the level set of the distance, as a god object does on planes (Zilles and Salisbury 1995;
/// Ruspini, Kolarov and Khatib 1997): straight on until it touches, then along the planes that it touches, and so on.
/// The distance of a moving ball from a triangle is a convex function of the way, so Newton's method finds the first
/// touch from the free side. The ball overlaps the mesh by at most 1e-7 of its radius.
///
/// Settings: `triangles` is the number to which the mesh is simplified at the next preparation, if it has more: the
/// error falls with its square root. `verify` 1 lets a sweep look at every step of a point's proxy, which then also
/// stops at parts that the walk does not know, such as another mesh in the same file; `rounds` is the number of planes
/// that a ball's proxy meets in a tick at most.
class Mesh final : public Shape {
 public:
  /// `mesh` must be welded, without triangles of zero area, and wound so that normals point outwards: see load_mesh().
  Mesh(TriangleMesh mesh, std::vector<std::string> remarks);

  void prepare(double radius) override;
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  void approach(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] Vec3 smooth(const Proxy& proxy, double crease) const noexcept override;
  [[nodiscard]] bool smooths() const noexcept override { return !(radius_ > 0); }
  [[nodiscard]] std::vector<std::string> remarks() const override;
  [[nodiscard]] Box bounds() const noexcept override { return bounds_; }
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

  /// Returns the triangles that are touched: those of the last preparation.
  [[nodiscard]] const TriangleMesh& triangles() const noexcept { return mesh_; }

 private:
  /// Part of the surface on which a point's proxy stands.
  struct Foot {
    std::uint32_t triangle = 0;
    TrianglePoint point;
  };
  /// Where a verified step of a point's proxy ends.
  struct Step {
    Foot foot;
    bool held = false;  ///< between the face and a part in the way
  };
  /// The surroundings of a ball.
  class Ball;

  void build(TriangleMesh mesh);
  void simplify();
  void follow_point(const ToolStep& step, Proxy& proxy) const noexcept;
  void follow_ball(const ToolStep& step, Proxy& proxy) const noexcept;
  void leave(const ToolStep& step, Proxy& proxy) const noexcept;
  [[nodiscard]] bool place_ball(const Vec3& to, Ball& ball) const noexcept;
  void begin_inside(const ToolStep& step, Proxy& proxy) const noexcept;
  [[nodiscard]] bool is_closed() const noexcept { return topology_.open_edges == 0; }
  [[nodiscard]] Foot foot_on(std::uint32_t triangle, const Vec3& place) const noexcept {
    return {triangle, closest_on(tree_.face(triangle), place)};
  }
  [[nodiscard]] Foot downhill(const Foot& foot, const Vec3& to) const noexcept;
  [[nodiscard]] Foot walk(Foot foot, const Vec3& to) const noexcept;
  [[nodiscard]] Step verified_walk(Foot foot, const Vec3& to) const noexcept;
  [[nodiscard]] TriangleTree::Hit obstacle(std::uint32_t triangle, std::uint32_t other, const Vec3& from,
                                           const Vec3& to) const noexcept;
  [[nodiscard]] TriangleTree::Hit ahead(const Foot& foot, const Vec3& to) const noexcept;
  [[nodiscard]] Vec3 pseudo_normal(const Foot& foot) const noexcept;
  [[nodiscard]] bool beyond_open_edge(const Foot& foot, const Vec3& to) const noexcept;
  enum class Side : std::uint8_t { behind, in_front, in_crease };
  void stand(const Foot& foot, const Vec3& to, Side side, Proxy& proxy) const noexcept;
  [[nodiscard]] Foot foot_of(const Proxy& proxy) const noexcept;

  TriangleMesh mesh_;
  TriangleTree tree_;
  MeshTopology topology_;
  Box bounds_;
  double rounding_ = 0;  // of a place on the mesh [m]
  std::vector<std::string> remarks_;
  TriangleMesh whole_;            // as it was given; empty while mesh_ is this
  std::size_t given_ = 0;         // number of its triangles
  std::size_t wanted_ = 0;        // number of triangles, at most
  std::size_t prepared_for_ = 0;  // wanted_ of mesh_
  std::string simplified_;        // note on it; empty: mesh_ is as it was given
  double radius_ = 0;
  bool verify_ = false;
  int rounds_ = 4;
};

/// Reads the keys `file` and `unit`, and the settings.
std::unique_ptr<Shape> read_mesh(JsonReader& reader, SceneFiles& files);

}  // namespace haptrace
