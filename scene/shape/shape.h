// Interface of shapes: geometry in a frame of its own, without forces, time and other objects.
#pragma once

#include "base/triangle_mesh.h"
#include "base/types.h"
#include "control/path/path.h"
#include "scene/knob.h"

#include <array>
#include <cstdint>
#include <limits>

namespace haptrace {

/// A step of the tool in the shape's frame. The tool is a ball around its tip; a point has no radius.
struct ToolStep {
  Vec3 from = nan3();      ///< place of the last query [m]; NaN: not known, so the tool may already be inside
  Vec3 to = Vec3::Zero();  ///< place now [m]
  double radius = 0;       ///< of the ball [m]
  double reach = 0;  ///< distance in front of the surface within which a contact lasts, for adhesion and textures [m]
};

/// A shape's part of a contact, its history included. It belongs to the contact, not to the shape: two tools can touch
/// the same shape.
struct Proxy {
  /// Centre of the ball where the surface holds it: at the tool's radius from the surface [m]. Unspecified unless
  /// `known`.
  Vec3 position = Vec3::Zero();
  Vec3 normal = Vec3::Zero();  ///< unit vector out of the surface, from the tool to the proxy if the tool is behind it
  double depth = 0;           ///< of the tool behind the proxy, along the normal [m]; in front of it minus the distance
  bool known = false;         ///< position, normal and depth are set
  bool touching = false;      ///< the surface holds the tool: depth > 0, or within the reach of a contact that lasts
  bool began_inside = false;  ///< this contact began without a crossing of the surface

  /// The shape's own memory: the face, edge or parameters where the proxy is. Only the shape reads it.
  struct Memory {
    Vec3 place = nan3();
    std::array<double, 2> value{};
    std::array<std::uint32_t, 2> index{};
  } memory;
};

/// The closest point of a surface.
struct SurfacePoint {
  Vec3 position = nan3();                                     ///< [m]
  Vec3 normal = Vec3::Zero();                                 ///< unit, outward
  double distance = std::numeric_limits<double>::infinity();  ///< of the query; negative inside [m]
};

/// Geometry in its own frame. It does not change after prepare(), and is shared by all contacts.
///
/// Order of calls: set() any number of times, prepare(), then all others. Real-time: follow, approach, nearest, slide
/// and smooth allocate nothing, lock nothing, throw nothing. Threads: any number, after prepare().
class Shape : public Adjustable {
 public:
  /// Does what follow() needs done beforehand for a tool of this radius [m]. Throws Error(input) when the shape cannot
  /// be touched with it.
  virtual void prepare(double radius) { (void)radius; }

  /// Takes the proxy along with a step of the tool.
  ///
  /// A contact begins where the step crosses the surface from outside, or at the nearest surface if the tool starts
  /// inside. The proxy then stays on the surface at the least distance from the tool that it can reach without leaving
  /// the surface; it does not jump to another part that happens to be nearer. The contact ends when the tool is in
  /// front of the surface by more than the reach. A step is finite; any other leaves the proxy as it is.
  virtual void follow(const ToolStep& step, Proxy& proxy) const noexcept = 0;

  /// Begins a contact with a tool in front of the surface, within the reach; only surfaces that a texture raises need
  /// it. Called after a follow() of the same step that left no contact. This function serves the shapes whose follow()
  /// states the nearest surface at any distance; the others look for it.
  virtual void approach(const ToolStep& step, Proxy& proxy) const noexcept {
    proxy.touching = proxy.known && proxy.depth > -step.reach;
  }

  /// Returns the surface point that is closest to `place`, without history. For loading, checks and predictions.
  [[nodiscard]] virtual SurfacePoint nearest(const Vec3& place) const noexcept = 0;

  /// Returns d proxy / d tool of a contact in follow(): the tangential projection, scaled by the curvature. It makes
  /// forces that depend on the proxy's place the exact gradient of their energy.
  [[nodiscard]] virtual Eigen::Matrix3d slide(const Proxy& proxy) const noexcept {
    return Eigen::Matrix3d::Identity() - proxy.normal * proxy.normal.transpose();
  }

  /// Returns the unit normal of the smooth surface that the shape stands for, for force shading. Differs from the
  /// proxy's own normal only where a shape approximates another, as a mesh does. Edges sharper than `crease` [rad]
  /// stay.
  [[nodiscard]] virtual Vec3 smooth(const Proxy& proxy, double crease) const noexcept {
    (void)crease;
    return proxy.normal;
  }

  /// Returns whether smooth() differs from the proxy's normal anywhere, once prepared.
  [[nodiscard]] virtual bool smooths() const noexcept { return false; }

  /// Returns notes for the user on the prepared shape: what was found and changed while it was loaded.
  [[nodiscard]] virtual std::vector<std::string> remarks() const { return {}; }

  /// Returns the smallest known box around the shape; infinite where the shape is [m].
  [[nodiscard]] virtual Box bounds() const noexcept = 0;

  /// Returns whether any part of the shape is inside `space`.
  [[nodiscard]] virtual bool meets(const Box& space) const noexcept {
    const Box own = bounds();
    return (own.min.array() <= space.max.array()).all() && (own.max.array() >= space.min.array()).all();
  }

  /// Returns triangles that stay within `tolerance` [m] of the surface, of the part inside `space`. For pictures and
  /// tests.
  [[nodiscard]] virtual TriangleMesh tessellated(double tolerance, const Box& space) const = 0;
};

/// Ends a contact and forgets its history.
inline void release(Proxy& proxy) noexcept {
  proxy = {};
}

}  // namespace haptrace
