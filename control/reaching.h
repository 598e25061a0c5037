// Trials with a cue, from a start in a direction: geometry, purposes, force fields, and a target that moves.
#pragma once

#include "base/types.h"
#include "control/path/path.h"

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

/// The task of the participant after the cue.
enum class ReachGoal : std::uint8_t {
  target,  ///< move to the target and hold there
  range,   ///< move as far as possible in the direction of the target, and hold
  press,   ///< press against a lock in the start, in the direction of the target, as hard as possible
  track,   ///< follow a target that moves on the line from the start through the target
  weigh,   ///< rest the arm on a lock in the start, which carries it; the target is straight below the start
};

const char* to_string(ReachGoal goal) noexcept;
ReachGoal parse_reach_goal(std::string_view name);  ///< throws Error(input) that names the known values

/// Returns whether a lock holds the hand in the start during the whole trial.
constexpr bool is_held(ReachGoal goal) noexcept {
  return goal == ReachGoal::press || goal == ReachGoal::weigh;
}

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

/// Movement of a target along a line: a sum of sines of equal size that fades in,
///
///     s(t) = w(t) / n sum_k sin(2 pi f_k t + phi_k),   w(t) = sin^2(pi t / (2 kFadeIn)) up to kFadeIn, then 1,
///
/// as a share of the distance from the start to the target: never beyond -1 and 1.
struct TrackSignal {
  static constexpr double kFadeIn = 2;  ///< [s]

  std::vector<double> frequency;  ///< [Hz]
  std::vector<double> phase;      ///< [rad], one for each frequency
  double discard = 5;             ///< time from the cue that no metric counts, at least kFadeIn [s]

  /// Returns s(t); `t` counts from the cue [s]. Real-time.
  [[nodiscard]] double at(double t) const noexcept;
};

/// One reach, as a recording and a session log describe it.
struct ReachTrial {
  ReachGeometry geometry;
  ReachGoal goal = ReachGoal::target;
  double hold = 0.5;   ///< range: time for which the hand must stay at its farthest place [s]
  double largest = 0;  ///< press, weigh: largest force that the lock has [N]; 0: the handle is locked, without a force
  TrackSignal track;   ///< track: movement of the target
  Box workspace;       ///< range: where the device ends [m]; not finite: unknown
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
