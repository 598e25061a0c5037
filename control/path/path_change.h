// Changes of a path's place: mirrored, rotated, scaled and moved.
#pragma once

#include "base/types.h"
#include "control/path/path.h"

#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// Pose of a device D in the world: p_world = rotation * p_D + translation.
struct DeviceFrame {
  Quat rotation = Quat::Identity();  ///< unit quaternion
  Vec3 translation = Vec3::Zero();   ///< [m]
};

/// A similarity of space: p' = scale * turn * p + offset. It is the result of a PathChange for one path.
///
/// `turn` is orthogonal, with determinant -1 if it mirrors. Forces turn and are not scaled. A torque is a pseudovector:
/// mirrored, it also changes its sign. A tool is mirrored in a plane of its own axes as well (`tool`), so that its
/// orientation stays a rotation: R' = turn * R * tool.
struct Similarity {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  double scale = 1;            ///< above 0
  Vec3 offset = Vec3::Zero();  ///< [m]
  Vec3 tool = Vec3::Ones();    ///< signs of the tool's axes; their product is the determinant of `turn`

  [[nodiscard]] Vec3 point(const Vec3& p) const { return scale * (turn * p) + offset; }
  [[nodiscard]] Vec3 velocity(const Vec3& v) const { return scale * (turn * v); }
  [[nodiscard]] Vec3 direction(const Vec3& v) const { return turn * v; }  ///< of forces and normals
  [[nodiscard]] Vec3 torque(const Vec3& t) const { return tool.prod() * (turn * t); }
  /// Returns the diagonal of changed gains, of which `k` is the diagonal: forces are not scaled, movements are.
  [[nodiscard]] Vec3 gain(const Vec3& k) const { return turn.cwiseAbs2() * k / scale; }
  /// Returns the changed orientation; NaN if `q` is not finite. Its sign is as continuous as that of `q`.
  [[nodiscard]] Quat orientation(const Quat& q) const;

  [[nodiscard]] bool is_identity() const;
  /// Returns true if every axis becomes an axis again, so that boxes stay boxes.
  [[nodiscard]] bool keeps_axes() const;
  [[nodiscard]] Box box(const Box& box) const;  ///< smallest box around a box after the change
  [[nodiscard]] Similarity inverse() const;

  /// Changes all columns of a path. Empty columns stay empty.
  void apply(Path& path) const;
};

/// Returns the similarity that applies `first` and then `second`.
Similarity operator*(const Similarity& second, const Similarity& first);

/// Returns the similarity from the world's coordinates to those of a device, without a scale.
Similarity to_device(const DeviceFrame& frame);

/// The fixed point of mirroring, rotating and scaling.
struct ChangeCentre {
  enum class Kind { origin, start, centre, point };
  Kind kind = Kind::origin;
  Vec3 point = Vec3::Zero();  ///< for Kind::point, in the device's coordinates [m]
};

/// Change of a path for a device or a participant. The order is always:
///
/// 1. `frame`: from the world's coordinates to the device's; all that follows happens in the device's coordinates W
/// 2. `mirror`: the sign of one axis changes
/// 3. `rotation`
/// 4. `scale`
/// 5. `offset`, or `start`: the path moves
///
/// Steps 2 to 4 keep the point `about` in its place. Times stay as they are, and so do the magnitudes of forces.
struct PathChange {
  std::optional<DeviceFrame> frame;  ///< present: the path is in the world's coordinates
  std::optional<int> mirror;         ///< axis that changes its sign
  Quat rotation = Quat::Identity();
  double scale = 1;
  ChangeCentre about;
  Vec3 offset = Vec3::Zero();  ///< [m]
  std::optional<Vec3> start;   ///< place of the path's first sample after the change [m]; replaces `offset`

  [[nodiscard]] bool is_identity() const;

  /// Returns the change of a path with this first sample and these bounds, in the coordinates of the path. Throws
  /// Error(input) like validate.
  [[nodiscard]] Similarity of(const Vec3& first, const Box& bounds) const;

  /// Changes a path. Does nothing to a path without samples.
  void apply(Path& path) const;
};

/// Throws Error(input) that names the value that is not finite or out of range: a scale from 0.01 to 100, a unit
/// quaternion, an offset up to 10 m.
void validate(const PathChange& change);

/// Returns what a change does, for users: "mirrored in x, rotated by 90 degrees about z, moved by 10, 0, 0 mm"; empty
/// for none.
std::string describe(const PathChange& change);

/// Reads "z=90deg" or "1,1,0=0.5": an axis x, y, z or X,Y,Z, and an angle [rad], by the right-hand rule. Throws
/// Error(input) naming the text.
Quat parse_rotation(std::string_view text);

/// Reads "none", "x", "y" or "z". Throws Error(input).
std::optional<int> parse_mirror(std::string_view text);

/// Reads "origin", "start", "centre" or a point X,Y,Z [m]. Throws Error(input).
ChangeCentre parse_change_centre(std::string_view text);

}  // namespace haptrace
