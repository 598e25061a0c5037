// A recorded or generated path: hand positions over time.
#pragma once

#include "base/types.h"

#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// An axis-aligned box in W [m].
struct Box {
  Vec3 min = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 max = Vec3::Constant(-std::numeric_limits<double>::infinity());

  void include(const Vec3& p) {
    min = min.cwiseMin(p);
    max = max.cwiseMax(p);
  }
  void include(const Box& other) {
    min = min.cwiseMin(other.min);
    max = max.cwiseMax(other.max);
  }
  [[nodiscard]] Vec3 size() const { return max - min; }
  [[nodiscard]] Vec3 center() const { return 0.5 * (min + max); }
};

/// Samples of a movement; the time steps may vary. Columns have the same length or are empty.
struct Path {
  std::string name;                ///< used in messages; usually the file name
  std::vector<double> time;        ///< [s], strictly increasing
  std::vector<Vec3> position;      ///< p_WT [m]
  std::vector<Vec3> velocity;      ///< [m/s], or empty
  std::vector<Vec3> force;         ///< on the hand [N], or empty
  std::vector<Quat> orientation;   ///< tool orientation as unit quaternions, or empty
  std::vector<std::string> notes;  ///< notes from the file reader for the user

  [[nodiscard]] std::size_t size() const noexcept { return time.size(); }
  [[nodiscard]] double duration() const { return time.empty() ? 0 : time.back() - time.front(); }
  [[nodiscard]] Box bounds() const;
};

/// Interpolation between samples. Every method passes through every sample at its stamp; cubic and quintic pass through
/// the smoothed samples when smoothing is requested.
enum class Interpolation {
  hold,     ///< the position of the last sample, at rest (C^-1)
  linear,   ///< straight lines (C0)
  cubic,    ///< cubic Hermite on the path's velocities if these add little bending (C1), else the C2 cubic spline
  quintic,  ///< quintic Hermite (C2): velocities as for cubic, accelerations from the spline through them
};

Interpolation parse_interpolation(std::string_view name);  ///< throws Error(input) naming the known ones
const char* to_string(Interpolation interpolation) noexcept;

/// Throws Error(input) naming the row unless the path has a sample, columns of equal length, finite values, unit
/// quaternions and strictly increasing time. Also throws when the path is so large that its unit must be wrong (wider
/// than 50 m or farther than 50 m from the origin). Rows count from 1, after the `rows_before` rows of a longer path.
void validate(const Path& path, std::uint64_t rows_before = 0);

/// Throws Error(input) when positions within `bounds` are so large that their unit must be wrong.
void validate_size(const std::string& name, const Box& bounds);

/// Maps a path into a workspace: p' = scale * p + offset.
struct Fit {
  double scale = 1;
  Vec3 offset = Vec3::Zero();
};

/// Returns a text for users: "scaled by 0.64, moved by 286.2, 206.8, -119.8 mm".
std::string describe(const Fit& fit);

/// Returns the distance from a point to the box [m]; 0 inside.
double distance_outside(const Vec3& point, const Box& box);

/// Returns the largest distance of a sample from the workspace [m]; 0 when all are inside.
double distance_outside(const Path& path, const Box& workspace);

/// Computes the smallest change that puts a path with these bounds inside `workspace` shrunk by `margin` (a fraction of
/// its size, per side). It moves the path, and scales it down (never up) about its centre, equally in every axis, only
/// as far as needed.
Fit fit_into(const Box& bounds, const Box& workspace, double margin = 0.05);
inline Fit fit_into(const Path& path, const Box& workspace, double margin = 0.05) {
  return fit_into(path.bounds(), workspace, margin);
}

/// Applies a fit to positions and velocities. Forces and orientations stay unchanged.
void apply(const Fit& fit, Path& path);

}  // namespace haptrace
