// A surface of triangles.
#pragma once

#include "base/json_reader.h"
#include "scene/scene_files.h"
#include "scene/shape/bvh.h"
#include "scene/shape/constraint_planes.h"
#include "scene/shape/shape.h"

#include <memory>
#include <string>
#include <vector>

namespace haptrace {

/// A mesh whose triangles know their neighbours.
struct MeshTopology {
  static constexpr std::uint32_t kNone = 0xffffffff;

  /// `mesh` must have consistent winding, and at most two triangles at an edge; a further one counts as not joined.
  explicit MeshTopology(const TriangleMesh& mesh);

  std::vector<std::array<std::uint32_t, 3>> neighbours;  ///< beyond the edge from corner i to i + 1; kNone: open
  std::vector<std::uint32_t> first_of;  ///< of a vertex's triangles in `around`; one more than there are vertices
  std::vector<std::uint32_t> around;
  std::vector<Vec3> face_normals;    ///< unit
  std::vector<Vec3> vertex_normals;  ///< weighted with the angles of the triangles (Thuermer and Wuethrich 1998), unit
  std::size_t open_edges = 0;
};

/// A mesh that is touched by a point or a ball.
///
/// Point: the first contact is found by a sweep through a tree of boxes. Then the proxy walks over faces, edges and
/// vertices, always downhill towards the tool and only through parts that hold the present place (Ho, Basdogan and
/// Srinivasan 1999), so it cannot jump through a thin part. The contact ends when the tool is in front of the face, or
/// of the sum of the normals around an edge or a vertex, or beyond an open edge.
///
/// Ball: its centre moves on the level set of the distance, as a god object does on planes (Zilles and Salisbury 1995;
/// Ruspini, Kolarov and Khatib 1997): straight on until it touches, then along the planes that it touches, and so on.
/// It overlaps the mesh by at most 1e-7 of its radius.
///
/// Settings: `verify` 1 lets a sweep look at every step of a point's proxy, which then also stops at parts that the
/// walk does not know, such as another mesh in the same file; `rounds` is the number of planes that a ball's proxy
/// meets in a tick at most.
class Mesh final : public Shape {
 public:
  /// `mesh` must be welded, without triangles of zero area, and wound so that normals point outwards: see load_mesh().
  Mesh(TriangleMesh mesh, std::vector<std::string> remarks);

  void prepare(double radius) override { radius_ = radius; }
  void follow(const ToolStep& step, Proxy& proxy) const noexcept override;
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept override;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept override;
  [[nodiscard]] Vec3 smooth(const Proxy& proxy, double crease) const noexcept override;
  [[nodiscard]] std::vector<std::string> remarks() const override { return remarks_; }
  [[nodiscard]] Box bounds() const noexcept override { return bounds_; }
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

  [[nodiscard]] const TriangleMesh& triangles() const noexcept { return mesh_; }
  [[nodiscard]] const MeshTopology& topology() const noexcept { return topology_; }

 private:
  /// Part of the surface on which a point's proxy stands.
  struct Foot {
    std::uint32_t triangle = 0;
    TrianglePoint point;
  };

  void follow_point(const ToolStep& step, Proxy& proxy) const noexcept;
  void follow_ball(const ToolStep& step, Proxy& proxy) const noexcept;
  void begin_inside(const ToolStep& step, Proxy& proxy) const noexcept;
  bool advance_ball(Vec3& centre, const Vec3& target, double radius) const noexcept;
  [[nodiscard]] ConstraintPlanes planes_of_ball(const Vec3& centre, const Vec3& goal, double radius) const noexcept;
  [[nodiscard]] Foot foot_on(std::uint32_t triangle, const Vec3& place) const noexcept;
  [[nodiscard]] Foot walk(Foot foot, const Vec3& to) const noexcept;
  [[nodiscard]] Vec3 pseudo_normal(const Foot& foot) const noexcept;
  [[nodiscard]] bool beyond_open_edge(const Foot& foot, const Vec3& to) const noexcept;
  void stand(const Foot& foot, const ToolStep& step, Proxy& proxy) const noexcept;
  [[nodiscard]] Vec3 held_back(const Vec3& from, Foot foot, const Vec3& to, Proxy& proxy) const noexcept;
  [[nodiscard]] Foot foot_of(const Proxy& proxy) const noexcept;

  TriangleMesh mesh_;
  MeshTopology topology_;
  TriangleTree tree_;
  Box bounds_;
  std::vector<std::string> remarks_;
  double radius_ = 0;
  bool verify_ = false;
  int rounds_ = 4;
};

/// Reads the keys `file`, `unit` and `verify`.
std::unique_ptr<Shape> read_mesh(JsonReader& reader, SceneFiles& files);

}  // namespace haptrace
