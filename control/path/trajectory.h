// Trajectories: position, velocity and acceleration at any instant of a path with arbitrary time stamps.
#pragma once

#include "control/controller.h"
#include "control/path/path.h"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Evaluates a path at any time. Immutable after construction; time 0 is the path's first stamp. Before its start and
/// after its end the trajectory rests at the first and last position, with zero velocity and acceleration.
///
/// Velocities at the samples. The trajectory uses the path's own velocities when they agree with its positions: when
/// the integral of |x''|^2 of the cubic Hermite curve on them is at most kBendingTolerance times that of the cubic
/// spline with the same end velocities, which is the smallest possible (Holladay 1957; de Boor, A Practical Guide to
/// Splines, ch. V). Sparse samples with true velocities agree (ratio near 1), and so do smooth velocities over
/// quantised positions (1.5 to 2), where the spline would follow every count. Four kinds of velocities do not: noise
/// that is small beside the speed but large beside its change from sample to sample, estimates that lag over exact
/// positions, columns of zeros, and wrong units. For these, and without velocities, the trajectory uses those of the C2
/// cubic spline at rest at both ends. (In a test with a robot's velocity column, thinned and compared with the samples
/// left out, the spline is nearer from a ratio of 2 upwards.)
///
/// Smoothing. Where positions are noisy from sample to sample, as encoder counts are, the second derivative of any
/// curve through them is mostly noise. Feedforward therefore needs smoothed positions (Whole::smoothing, cubic and
/// quintic only). The velocities are then always those of the spline.
///
/// Accelerations at the samples (quintic) are the slopes of the C2 cubic spline through those velocities. At both ends
/// they are those of the cubic curve, or zero when the path has no usable velocities and starts and ends at rest.
///
/// Between two samples `h` apart, velocities are limited to 3 L / h and accelerations to 6 L / h^2, where L is the
/// diagonal of the path's box: the values that t^3 needs to cross it once. No sampled movement comes near these limits.
/// A pause of minutes in a log does, and would otherwise throw the curve metres off. With the limits, the curve leaves
/// the straight line between the samples by at most 3/4 L (cubic) or 9/8 L (quintic).
///
/// Order of the error for smooth movements sampled every h, with velocities: cubic h^4 in position, h^3 in velocity;
/// quintic h^6 and h^5, but h^4 and h^3 in the few segments next to the ends.
///
/// A piece of a longer path makes a piece of its trajectory. A piece needs extra rows on both sides of the requested
/// range. The influence of a row on a slope falls to at most 1/2 with every row of distance (2 - sqrt(3) for even
/// steps), so that beyond kOverlap rows it is below the precision of a double.
///
/// Threads: const and safe to share; each follower has a Cursor. Real-time: sample() only.
class Trajectory {
 public:
  static constexpr double kBendingTolerance = 2.5;
  static constexpr std::uint64_t kOverlap = 128;  ///< rows

  /// Properties of the whole path that a piece needs.
  struct Whole {
    double begin = 0, end = 0;      ///< first and last stamp [s]; the first is the trajectory's time 0
    double extent = 0;              ///< diagonal of its box [m]
    bool own_velocities = false;    ///< see agree()
    double smoothing = 0;           ///< time constant [s], see smooth_positions(); 0: no smoothing
    std::uint64_t rows_before = 0;  ///< rows before this piece, for messages
  };

  /// Returns whether the path's own velocities are used. `stretches` are parts of the path that represent the whole.
  static bool agree(std::span<const Path> stretches);

  /// Remembers the segment of the last query, so that queries in order cost O(1) whatever the path's length.
  struct Cursor {
    std::size_t segment = 0;
  };

  /// Holds no path: sample() returns a reference of NaN ("none").
  Trajectory() = default;

  /// Throws what validate(path) throws. Also throws Error(input) naming the row when two stamps are less than 1 ns
  /// apart, or when the path lasts longer than 1e9 s: in both cases the unit must be wrong. A single sample makes a
  /// trajectory that rests there. Costs O(n) time, and 32 bytes per sample (cubic 56, quintic 80).
  Trajectory(const Path& path, Interpolation interpolation);

  /// Builds the trajectory of a piece of a path, on the time of the whole. Before and after the piece it rests at its
  /// ends.
  Trajectory(const Path& piece, Interpolation interpolation, const Whole& whole);

  /// Returns the reference at `t` [s]. Queries may come in any order; a jump costs O(log n). NaN gives the start.
  [[nodiscard]] Reference sample(double t, Cursor& cursor) const noexcept;
  [[nodiscard]] Reference sample(double t) const noexcept {
    Cursor cursor;
    return sample(t, cursor);
  }

  /// Returns the time of the last sample [s]. The time of the first is 0, except in a piece.
  [[nodiscard]] double duration() const noexcept { return time_.empty() ? 0 : time_.back(); }
  [[nodiscard]] std::size_t size() const noexcept { return time_.size(); }

 private:
  static Whole whole(const Path& path, Interpolation interpolation);
  [[nodiscard]] std::size_t segment_at(double t, std::size_t guess) const noexcept;

  Interpolation interpolation_ = Interpolation::linear;
  std::vector<double> time_;  ///< [s] from the path's first stamp
  std::vector<Vec3> position_;
  std::vector<Vec3> velocity_;      ///< cubic and quintic
  std::vector<Vec3> acceleration_;  ///< quintic
};

}  // namespace haptrace
