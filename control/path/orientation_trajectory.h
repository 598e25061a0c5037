// Orientation of the tool at any instant of a path with arbitrary time stamps.
#pragma once

#include "control/path/path.h"
#include "control/path/trajectory.h"
#include "control/rotation.h"

#include <vector>

namespace haptrace {

/// Interpolates the orientations of a path, as Trajectory interpolates its positions. It passes through every sample at
/// its stamp and is at rest before the first and after the last.
///
/// hold keeps the orientation of the last sample. linear turns from sample to sample by the shortest rotation at a
/// constant rate. cubic and quintic blend the rotation vectors from each sample to the next by a Hermite cubic (C1).
/// The rate at a sample is that of the parabola through it and its two neighbours, limited to three times the slower of
/// the two adjacent mean rates, so that the tool does not overshoot the samples. The rates at the ends of the path are
/// zero.
///
/// In the segment from q_i to q_{i+1} the orientation is exp(r(u)) q_i with r(0) = 0 and exp(r(1)) = q_{i+1} q_i^-1.
/// Its angular velocity is w = J(r) r' with J the left Jacobian of SO(3) (Chirikjian, Stochastic Models, Information
/// Theory, and Lie Groups 2, 10.6). The inverse of J gives r' at the far end from the rate there.
///
/// Threads: const and safe to share. Real-time: sample() only.
class OrientationTrajectory {
 public:
  /// Holds no orientation: sample() returns NaN.
  OrientationTrajectory() = default;

  /// Interpolates a piece of a path whose first and last stamps are `begin` and `end` [s]. The path is validated and
  /// has orientations. A sample depends only on the two rows before and the two rows after it.
  OrientationTrajectory(const Path& piece, Interpolation interpolation, double begin, double end);

  [[nodiscard]] bool empty() const noexcept { return time_.empty(); }

  /// Returns the orientation at `t` [s] since the path's first stamp. Costs O(1) for queries in order, like Trajectory.
  [[nodiscard]] OrientationReference sample(double t, Trajectory::Cursor& cursor) const noexcept;

 private:
  Interpolation interpolation_ = Interpolation::linear;
  std::vector<double> time_;       ///< [s]
  std::vector<Quat> orientation_;  ///< neighbours are on the same hemisphere
  std::vector<Vec3> rate_;         ///< cubic and quintic: angular velocities w at the samples [rad/s]
};

}  // namespace haptrace
