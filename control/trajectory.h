// Trajectories: position, velocity and acceleration at any instant of a path with arbitrary time stamps.
#pragma once

#include "control/controller.h"
#include "control/path.h"

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// How a trajectory runs between samples.
enum class Interpolation {
  hold,     ///< the last sample's position, at rest (C^-1)
  linear,   ///< straight lines (C0)
  cubic,    ///< Hermite on the path's velocities where it has them, else the C2 cubic spline at rest at both ends
  quintic,  ///< quintic Hermite (C2): velocities as for cubic, accelerations from their spline
};

Interpolation parse_interpolation(std::string_view name);  ///< throws Error(input) with the nearest name
std::string to_string(Interpolation interpolation);

/// A path that can be asked at any time. Immutable after construction; time starts at 0 = the path's first stamp.
/// Before its start and after its end it rests at the first and last position with zero velocity and acceleration.
///
/// Threads: const and safe to share; each follower has a Cursor. Real-time: sample() only.
class Trajectory {
 public:
  /// Remembers the segment of the last question, so that questions in order cost O(1) whatever the path's length.
  struct Cursor {
    std::size_t segment = 0;
  };

  Trajectory() = default;

  /// Throws what validate(path) throws. One sample makes a trajectory that rests there.
  Trajectory(const Path& path, Interpolation interpolation);

  /// The reference at `t` [s]. Any order of questions is right; a jump costs O(log n). NaN asks for the start.
  [[nodiscard]] Reference sample(double t, Cursor& cursor) const noexcept;
  [[nodiscard]] Reference sample(double t) const noexcept {
    Cursor cursor;
    return sample(t, cursor);
  }

  [[nodiscard]] double duration() const noexcept { return time_.empty() ? 0 : time_.back(); }
  [[nodiscard]] std::size_t size() const noexcept { return time_.size(); }

 private:
  Interpolation interpolation_ = Interpolation::linear;
  std::vector<double> time_;  ///< [s] from 0
  std::vector<Vec3> position_;
  std::vector<Vec3> velocity_;      ///< cubic and quintic
  std::vector<Vec3> acceleration_;  ///< quintic
};

}  // namespace haptrace
