// Reaching from a start to a target: geometry, kinds of reaches, and force fields.
#pragma once

#include "base/types.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The purpose of a reach.
enum class ReachKind : std::uint8_t {
  plain,        ///< the force field of its block acts, if the block has one
  catch_trial,  ///< the field is off without a warning: the deviation shows what the participant expects
  clamp,        ///< a channel holds the hand on the straight line: the force on it shows what the participant expects
};

const char* to_string(ReachKind kind) noexcept;
ReachKind parse_reach_kind(std::string_view name);  ///< throws Error(input) that names the known values

/// Places of one reach, in W.
struct ReachGeometry {
  Vec3 start = Vec3::Zero(), target = Vec3::Zero();  ///< [m]
  Vec3 lateral = Vec3::UnitY();                      ///< unit vector across the reach, to its left
  double start_radius = 6e-3, target_radius = 8e-3;  ///< [m]

  [[nodiscard]] double distance() const noexcept { return (target - start).norm(); }  ///< [m]
  /// Returns the unit vector from start to target.
  [[nodiscard]] Vec3 along() const noexcept { return (target - start).normalized(); }
  /// Returns the signed lateral deviation of `p` from the line through start and target [m]: positive to the left.
  [[nodiscard]] double deviation(const Vec3& p) const noexcept { return (p - start).dot(lateral); }
  /// Returns the part of a vector that is perpendicular to the line.
  [[nodiscard]] Vec3 across(const Vec3& v) const noexcept { return v - along().dot(v) * along(); }
};

/// One reach, as a recording and a session log describe it.
struct ReachTrial {
  ReachGeometry geometry;
  ReachKind kind = ReachKind::plain;
  Eigen::Matrix3d field = Eigen::Matrix3d::Zero();  ///< B of the exercise's field F = B v, in W [N s/m]
  bool field_block = false;                         ///< the reach belongs to a block with the field

  /// Returns true if the field acts in this reach.
  [[nodiscard]] bool field_acts() const noexcept { return field_block && kind == ReachKind::plain; }
};

/// Returns the unit vector to the left of a reach from `start` to `target`, as seen from the side to which `normal`
/// points. `otherwise` is used for a reach along the normal.
Vec3 lateral_axis(const Vec3& start, const Vec3& target, const Vec3& normal, const Vec3& otherwise) noexcept;

/// Returns why start and target do not part a reach over `distance` [m] from a hold in the start: "is 9.0 mm from the
/// start, within ..." for a message about the target; "" if they do.
std::string too_near(double distance, double start_radius, double target_radius);

/// Returns `count` targets at `distance` [m] around `start`, at equal angles from `first_angle` [rad] on, in the plane
/// of the unit vectors `right` and `up`, counted from `right` towards `up`.
std::vector<Vec3> centre_out_targets(const Vec3& start, double distance, int count, double first_angle,
                                     const Vec3& right, const Vec3& up);

/// Returns B of a curl field F = B v = b v x n in the plane with unit normal `normal`; `b` [N s/m]. In the plane xy
/// this is b [0 1; -1 0] (Shadmehr and Mussa-Ivaldi, J. Neuroscience 14(5), 1994, has the general matrix): the force is
/// perpendicular to the velocity, and pushes a movement to its right for b > 0.
Eigen::Matrix3d curl_field(double b, const Vec3& normal);

/// Returns B of a field that is given in a plane: B = E M E^T, E = [right up].
Eigen::Matrix3d plane_field(const Eigen::Matrix2d& matrix, const Vec3& right, const Vec3& up);

}  // namespace haptrace
