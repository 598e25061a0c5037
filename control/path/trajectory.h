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

/// How a trajectory runs between samples. Every degree passes through every sample at its stamp; cubic and quintic,
/// when asked to smooth, through the smoothed ones.
enum class Interpolation {
  hold,     ///< the last sample's position, at rest (C^-1)
  linear,   ///< straight lines (C0)
  cubic,    ///< cubic Hermite on the path's velocities where they bend it little (C1), else the C2 cubic spline
  quintic,  ///< quintic Hermite (C2): velocities as for cubic, accelerations from their spline
};

Interpolation parse_interpolation(std::string_view name);  ///< throws Error(input) naming the known ones
const char* to_string(Interpolation interpolation) noexcept;

/// A path that can be asked at any time. Immutable after construction; time starts at 0 = the path's first stamp.
/// Before its start and after its end it rests at the first and last position with zero velocity and acceleration.
///
/// Velocities at the samples. A path's own velocities are taken when they agree with its positions: when the integral
/// of |x''|^2 of the cubic Hermite curve on them is at most kBendingTolerance times that of the cubic spline with the
/// same end velocities, which is the smallest there is (Holladay 1957; de Boor, A Practical Guide to Splines, ch. V).
/// Sparse samples with true velocities pass (ratio near 1), and so do smooth velocities over quantised positions (1.5
/// to 2), where the spline would follow every count. Noise that is small beside the speed but large beside its change
/// from sample to sample, estimates that lag over exact positions, columns of zeros and wrong units do not: then, and
/// without velocities, they are those of the C2 cubic spline at rest at both ends. (A robot's velocity column, thinned
/// and compared with the samples left out: the spline is nearer from a ratio of 2 upwards.)
///
/// Smoothing. Where positions are noise from sample to sample, as the counts of a device are, the second derivative of
/// any curve through them is nothing else. Whoever feeds it forward asks for smoothed positions (Whole::smoothing,
/// cubic and quintic only); the velocities are then always those of the spline.
///
/// Accelerations at the samples (quintic) are the slopes of the C2 cubic spline through those velocities, at both ends
/// the cubic curve's own, or zero when the path starts and ends at rest for want of velocities.
///
/// Between two samples `h` apart, a velocity is scaled down to at most 3 L / h and an acceleration to 6 L / h^2, where
/// L is the diagonal of the path's box: what t^3 needs to cross it once. No sampled movement comes near; a pause of
/// minutes in a log does, and without this bound would throw the curve metres off. With it, the curve leaves the
/// straight line between the samples by at most 3/4 L (cubic) or 9/8 L (quintic).
///
/// Order of the error for smooth movements sampled every h, with velocities: cubic h^4 in position, h^3 in velocity;
/// quintic h^6 and h^5, but h^4 and h^3 in the few segments next to the ends.
///
/// A piece of a longer path makes a piece of its trajectory. Where it was cut, rows are needed on both sides of what is
/// asked for: what lies beyond them changes a slope by at most 1/2 per row (by 2 - sqrt(3) where steps are even), so
/// that kOverlap rows leave nothing of it in a double.
///
/// Threads: const and safe to share; each follower has a Cursor. Real-time: sample() only.
class Trajectory {
 public:
  static constexpr double kBendingTolerance = 2.5;
  static constexpr std::uint64_t kOverlap = 128;  ///< rows

  /// What a piece has to know of the path that it is of.
  struct Whole {
    double begin = 0, end = 0;      ///< first and last stamp [s]; the first is the trajectory's time 0
    double extent = 0;              ///< the diagonal of its box [m]
    bool own_velocities = false;    ///< see agree()
    double smoothing = 0;           ///< time constant [s], see smooth_positions(); 0: through every sample
    std::uint64_t rows_before = 0;  ///< before this piece, for messages
  };

  /// Whether the path's own velocities are taken, judged by stretches of it that stand for the whole.
  static bool agree(std::span<const Path> stretches);

  /// Remembers the segment of the last question, so that questions in order cost O(1) whatever the path's length.
  struct Cursor {
    std::size_t segment = 0;
  };

  /// No path: sample() answers with the reference "none", NaN.
  Trajectory() = default;

  /// Throws what validate(path) throws, and Error(input) naming the row when two stamps are less than 1 ns apart, or
  /// when the path lasts longer than 1e9 s: both can only be a unit mistake. One sample makes a trajectory that rests
  /// there. Costs O(n) time, and 32 bytes per sample (cubic 56, quintic 80).
  Trajectory(const Path& path, Interpolation interpolation);

  /// The same of a piece of a path. Time is that of the whole; before and after the piece it rests at its ends.
  Trajectory(const Path& piece, Interpolation interpolation, const Whole& whole);

  /// The reference at `t` [s]. Any order of questions is right; a jump costs O(log n). NaN asks for the start.
  [[nodiscard]] Reference sample(double t, Cursor& cursor) const noexcept;
  [[nodiscard]] Reference sample(double t) const noexcept {
    Cursor cursor;
    return sample(t, cursor);
  }

  /// Time of the last sample [s]; that of the first is 0 but for a piece.
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
