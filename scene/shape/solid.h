// Closed solids around a centre.
#pragma once

#include "scene/shape/shape.h"

#include <algorithm>
#include <limits>
#include <span>
#include <utility>

namespace haptrace {

/// Range of lengths and of coordinates of centres in scene files [m].
inline constexpr double kMinLength = 1e-6, kMaxLength = 100, kFarthestCentre = 100;

/// Curvature of the surface on which a proxy moves [1/m]: positive where the surface curves away from the tool.
struct Curvature {
  Vec3 along = Vec3::UnitX();  ///< a principal direction, tangential, of unit length
  double of_along = 0;         ///< curvature along it
  double of_across = 0;        ///< curvature across it
};

/// A closed solid around a centre. Functions with `local` in their comment use the frame whose origin is the centre.
class Solid : public Shape {
 public:
  [[nodiscard]] SurfacePoint nearest(const Vec3& place) const noexcept final;
  [[nodiscard]] Eigen::Matrix3d slide(const Proxy& proxy) const noexcept final;
  [[nodiscard]] Box bounds() const noexcept final;
  [[nodiscard]] bool meets(const Box& space) const noexcept final;
  [[nodiscard]] TriangleMesh tessellated(double tolerance, const Box& space) const final;

 protected:
  /// Throws Error(input) naming a coordinate that is out of range.
  explicit Solid(const Vec3& centre);

  /// Returns the closest point of the surface; local.
  [[nodiscard]] virtual SurfacePoint closest(const Vec3& place) const noexcept = 0;
  /// Returns the curvature of the surface at the tool's radius from this one; local.
  [[nodiscard]] virtual Curvature curvature(const Vec3& proxy, const Vec3& normal) const noexcept = 0;
  /// Returns the smallest box around the solid; local.
  [[nodiscard]] virtual Box extent() const noexcept = 0;
  /// Returns whether the solid and a box overlap; local.
  [[nodiscard]] virtual bool overlaps(const Box& box) const noexcept = 0;
  /// Returns a closed mesh within `tolerance` of the surface; local.
  [[nodiscard]] virtual TriangleMesh mesh(double tolerance) const = 0;

  /// Sets a proxy from the surface point that holds the tool; local.
  void stand(const SurfacePoint& foot, const ToolStep& step, Proxy& proxy) const noexcept;

  Vec3 centre_;
};

/// A convex solid.
///
/// A tool outside the solid has one closest surface point, which needs no history. A tool that enters the solid does so
/// through a face. From then on, this face holds it: the proxy is the closest point of the face, also when the tool
/// has passed the far side of a thin plate. When the closest point leaves the face over its edge, the tool is outside
/// the solid again. A face is entered where the step of the tool crosses it, so that a fast tool does not miss it.
///
/// The surface at the tool's radius from a convex solid has the same normals. So a ball is held by the same point as
/// the tool's tip, and rolls over rounded edges while its tip is outside.
class Convex : public Solid {
 public:
  void follow(const ToolStep& step, Proxy& proxy) const noexcept final;

 protected:
  using Solid::Solid;
  using Face = std::uint32_t;  ///< numbered from 1; 0: none

  /// Returns the face through which a step from outside enters the solid; local.
  [[nodiscard]] virtual Face entered(const Vec3& from, const Vec3& to) const noexcept = 0;
  /// Returns the face that is nearest to a place inside the solid; 0 if the place is not inside; local.
  [[nodiscard]] virtual Face face_at(const Vec3& place) const noexcept = 0;
  /// Returns whether a face still holds a tool that entered through it, and the closest point of this face. May pass
  /// the tool on to another face. `normal` is the last one, which applies where the face has none; local.
  virtual bool held(Face& face, const Vec3& place, const Vec3& normal, SurfacePoint& foot) const noexcept = 0;
  /// Returns the closest surface point of a place outside the solid; local.
  [[nodiscard]] virtual SurfacePoint outside(const Vec3& place) const noexcept = 0;

  [[nodiscard]] SurfacePoint closest(const Vec3& place) const noexcept final;
};

/// The part of a straight line that is inside a convex solid: an intersection of convex sets, each with its face.
class Chord {
 public:
  /// Keeps the part from `in` to `out`, in lengths of the step.
  void keep(double in, double out, std::uint32_t face) noexcept {
    if (in > in_) {
      in_ = in;
      face_ = face;
    }
    out_ = std::min(out_, out);
  }
  /// Keeps the part between two parallel planes, whose normal is an axis: least < place + t step < most.
  void keep_slab(double place, double step, double least, double most, std::uint32_t face_least,
                 std::uint32_t face_most) noexcept;
  /// Keeps the part with a t^2 + 2 b t + c < 0, of which there is one: a > 0, or a = b = 0.
  void keep_quadric(double a, double b, double c, std::uint32_t face) noexcept;
  void keep_nothing() noexcept { out_ = -std::numeric_limits<double>::infinity(); }

  /// Returns where the step from t = 0 to 1, which begins outside, enters the solid. Rounding may put a step that
  /// begins on the surface slightly inside, so the middle of the chord decides whether it lies ahead.
  [[nodiscard]] bool entered() const noexcept { return in_ < out_ && in_ <= 1 && in_ + out_ > 0; }
  [[nodiscard]] double in() const noexcept { return in_; }
  [[nodiscard]] std::uint32_t face() const noexcept { return entered() ? face_ : 0; }

 private:
  double in_ = -std::numeric_limits<double>::infinity(), out_ = std::numeric_limits<double>::infinity();
  std::uint32_t face_ = 0;
};

/// A place seen from the axis z of a surface of revolution.
struct Meridian {
  /// `normal` is the last one: it gives the direction on the axis itself, where the place has none. `size` of the solid
  /// [m].
  Meridian(const Vec3& place, const Vec3& normal, double size) noexcept;

  double rho = 0;  ///< distance from the axis [m]
  double z = 0;    ///< height [m]
  Vec3 out;        ///< unit vector from the axis to the place, without z

  /// Returns the vector with these components.
  [[nodiscard]] Vec3 vector(double along_rho, double along_z) const noexcept {
    return along_rho * out + Vec3(0, 0, along_z);
  }
};

/// Returns the curvature around the axis of a surface of revolution [1/m].
double curvature_around(const Vec3& place, const Vec3& normal) noexcept;
/// Returns the principal direction around the axis.
Vec3 direction_around(const Vec3& place) noexcept;
/// Returns the range of distances from the axis in a box; local.
std::pair<double, double> range_of_rho(const Box& box) noexcept;
/// Returns the number of chords round a circle that stay within `tolerance` of it.
int chords_of_circle(double radius, double tolerance);
/// Returns the closed surface that a profile, from one end of the axis z to the other, sweeps around it.
TriangleMesh revolved(std::span<const Vec3> profile, int chords);

}  // namespace haptrace
