// How a tool points at any instant of a path with arbitrary time stamps.
#pragma once

#include "control/path/path.h"
#include "control/path/trajectory.h"
#include "control/rotation.h"

#include <vector>

namespace haptrace {

/// The orientations of a path, as Trajectory is its positions: through every sample at its stamp, at rest before the
/// first and after the last.
///
/// hold keeps the last sample's; linear turns from sample to sample by the shortest rotation at a constant rate; cubic
/// and quintic blend rotation vectors from each sample to the next by Hermite's cubic (C1). The rates at the samples
/// are those of the parabola through three of them, at most three times the slower of the two beside them, so that the
/// tool turns no farther than the samples say; zero at the ends of the path.
///
/// In the segment from q_i to q_{i+1} the tool points to exp(r(u)) q_i with r(0) = 0 and exp(r(1)) = q_{i+1} q_i^-1; it
/// turns at w = J(r) r' with J the left Jacobian of SO(3) (Chirikjian, Stochastic Models, Information Theory, and Lie
/// Groups 2, 10.6), whose inverse gives r' at the far end from the rate there.
///
/// Threads: const and safe to share. Real-time: sample() only.
class OrientationTrajectory {
 public:
  /// None: sample() answers NaN.
  OrientationTrajectory() = default;

  /// Of a piece of a path that begins and ends at the stamps `begin` and `end` [s]; the path was validated and has
  /// orientations. Two rows around what is asked for are all that it depends on.
  OrientationTrajectory(const Path& piece, Interpolation interpolation, double begin, double end);

  [[nodiscard]] bool empty() const noexcept { return time_.empty(); }

  /// At `t` [s] since the path's first stamp. Costs O(1) for questions in order, as Trajectory.
  [[nodiscard]] OrientationReference sample(double t, Trajectory::Cursor& cursor) const noexcept;

 private:
  Interpolation interpolation_ = Interpolation::linear;
  std::vector<double> time_;       ///< [s]
  std::vector<Quat> orientation_;  ///< neighbours on the same hemisphere
  std::vector<Vec3> rate_;         ///< cubic and quintic: w at the samples [rad/s]
};

}  // namespace haptrace
