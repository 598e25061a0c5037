// A recorded or generated path: where the hand was, when.
#pragma once

#include "base/types.h"

#include <cstdint>
#include <string>
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
  [[nodiscard]] Vec3 size() const { return max - min; }
  [[nodiscard]] Vec3 center() const { return 0.5 * (min + max); }
};

/// Samples of a movement over time stamps that need not be even. Columns have the same length or are empty.
struct Path {
  std::string name;                ///< for messages: usually the file
  std::vector<double> time;        ///< [s], strictly increasing
  std::vector<Vec3> position;      ///< p_WT [m]
  std::vector<Vec3> velocity;      ///< [m/s], or empty
  std::vector<Vec3> force;         ///< on the hand, [N], or empty
  std::vector<Quat> orientation;   ///< of the tool, unit quaternions, or empty
  std::vector<std::string> notes;  ///< what a reader noticed and a person should know

  [[nodiscard]] std::size_t size() const noexcept { return time.size(); }
  [[nodiscard]] double duration() const { return time.empty() ? 0 : time.back() - time.front(); }
  [[nodiscard]] Box bounds() const;
};

/// Throws Error(input) naming the row unless the path has a sample, equal columns, finite values, unit quaternions and
/// strictly increasing time; or when its size can only be a unit mistake (wider or farther than 50 m). Rows count from
/// 1, after the `rows_before` of a longer path.
void validate(const Path& path, std::uint64_t rows_before = 0);

/// Throws Error(input) when positions within `bounds` can only be a unit mistake.
void validate_size(const std::string& name, const Box& bounds);

/// How a path was moved into a workspace: p' = scale * p + offset.
struct Fit {
  double scale = 1;
  Vec3 offset = Vec3::Zero();
};

/// "scaled by 0.64, moved by 286.2, 206.8, -119.8 mm": for people.
std::string describe(const Fit& fit);

/// From a point to the nearest of a box [m]; 0 inside.
double distance_outside(const Vec3& point, const Box& box);

/// How far the path leaves the workspace [m]: the largest distance of a sample from the box; 0 when inside.
double distance_outside(const Path& path, const Box& workspace);

/// The gentlest change that puts a path of these bounds inside `workspace` shrunk by `margin` (a fraction of its size,
/// per side): moves it, and scales it down (never up) about its centre, equally in every axis, only as far as needed.
Fit fit_into(const Box& bounds, const Box& workspace, double margin = 0.05);
inline Fit fit_into(const Path& path, const Box& workspace, double margin = 0.05) {
  return fit_into(path.bounds(), workspace, margin);
}

/// Applies a fit to positions and velocities. Forces stay as they were felt, and the tool points as it did.
void apply(const Fit& fit, Path& path);

}  // namespace haptrace
