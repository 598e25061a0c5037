// Average of several recordings of one movement: one path with its spread, whatever the speed of each recording.
#pragma once

#include "control/path/arc_path.h"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// One recording of a movement.
struct PathCopy {
  std::string name;  ///< for messages: usually the file
  std::shared_ptr<const ArcPath> path;
};

/// The average of several copies at places that are evenly spaced along it. Columns have the same length.
struct AveragedPath {
  /// A place where at least half of the copies rested.
  struct Pause {
    double arc = 0;          ///< [m]
    double duration = 0;     ///< median over all copies [s]
    std::size_t copies = 0;  ///< number of copies that rested there
  };
  /// Agreement of one copy with the average.
  struct Agreement {
    double distance = 0;      ///< rms distance of its matched points [m]
    double length_ratio = 1;  ///< its length divided by that of the average
  };

  std::vector<double> time;          ///< of the movement without its pauses, from 0 [s]
  std::vector<double> arc;           ///< arc length [m]
  std::vector<Vec3> position;        ///< p_WT [m]
  std::vector<Vec3> force;           ///< mean force of the copies; zero where they have none [N]
  std::vector<double> spread;        ///< standard deviation of the copies across the path [m]
  double overall_spread = 0;         ///< its rms over the path [m]
  double directions = 1;             ///< across the path in which the copies differ: 1 for drawings in a plane, up to 2
  std::vector<Pause> pauses;         ///< in the order of the movement, without the rest at its ends
  std::vector<Agreement> agreement;  ///< of each copy
  std::size_t medoid = 0;            ///< the copy that is nearest to the others
};

/// Averages copies of one movement. The result depends neither on their speeds nor on their pauses.
///
/// Method: dynamic time warping barycentre averaging (Petitjean, Ketterlin and Gancarski 2011, A global averaging
/// method for dynamic time warping) over arc length instead of time. Every copy is sampled evenly along its length. The
/// average starts as the medoid. Noise that makes a copy much longer is removed first, by a Gaussian low-pass along its
/// length: the narrowest one after which wider ones, up to 3 % of the box, hardly shorten it. In each of 8
/// rounds, every copy is warped onto the average, and the average becomes the mean of the matched points, sampled
/// evenly again. A warp goes in steps (1, 1), (1, 2) and (2, 1), weighted by their mean length, and stays within 15 %
/// of the length. Its cost at a pair of points is
///
///     |p - q|^2 + w (1 - cos angle of the tangents),   w = 4 mm^2 (diagonal of the box / 110 mm)^2.
///
/// Over the matches of the last warp:
/// - the time along the average is the integral of the median over the copies of dt/ds. In a pause, in which it is
/// slower
///   than 5 % of its median speed for at least 0.1 s, a copy counts as moving at these 5 %;
/// - the force is the mean over the copies;
/// - the spread is sqrt(n / (n - 1)) times the rms distance of the copies, perpendicular to the average. It is pooled
///   over 5 % of the length, because a few copies determine a standard deviation only roughly;
/// - the directions are (tr S)^2 / tr S^2 with the covariance S of the copies in the two directions across the path,
///   which follow it without turning about it (the effective number of dimensions).
///
/// The mean of n copies with noise sigma keeps sigma / sqrt(n) of it, which would make it longer. If d_k' is the slope
/// of copy k against the mean, across it, the mean is longer by the mean of sqrt(1 + sum_k |d_k'|^2 / (n (n - 1))) - 1.
/// The narrowest Gaussian low-pass along the mean that takes away this length does so, at most 5 % of the box wide. The
/// mean also rounds a corner by about sigma.
///
/// Throws Error(input) naming the copy when there are fewer than two, when one has no length, and when one shows
/// another movement, see require_same_movement(). Also throws when a path is more than 360 times as long as its box is
/// wide.
///
/// O(copies^2) warps of 400 points, and O(copies) warps of as many points as the path is long in 1/110 of its box, at
/// most 8000. A warp of N points takes O(0.3 N^2) time and memory. Threads: free function without state. Real-time: no.
AveragedPath average_paths(std::span<const PathCopy> copies);

/// Returns the ratio of a radius that holds the next repetition of the same movement with 95 % probability to the
/// standard deviation of `copies` repetitions across the path, over all d = `directions` in which they differ:
/// sqrt((1 + 1 / n) F(0.95; d, d (n - 1))), the prediction region of a normal distribution that is alike in these
/// directions; for d = 1 it is t(0.975; n - 1) sqrt(1 + 1 / n). It is 15.6 for 2 copies in 1 direction, 5.0 for 3 and
/// 2.8 for 6; in 2 directions 5.3, 3.0 and 2.2. Throws Error(input) for fewer than 2 copies.
double prediction_factor(std::size_t copies, double directions);

/// Throws Error(input) naming the copy that shows another movement than `reference`: another direction, another number
/// of laps, or another path. Such a copy
/// - is shorter than 0.7 or longer than 1.4 times the reference, both after a low-pass of 7 % of the box along their
///   length, so that noise and tremor below that scale do not count, or
/// - costs more than 3 times the median of the others' warps and lies farther away (rms) than 8 % of the reference's
///   box, or
/// - lies farther away (rms) than 12 % of that box, or mostly runs in another direction, whatever the others are like.
///
/// O(0.3 400^2) per copy. Threads: free function without state. Real-time: no.
void require_same_movement(const PathCopy& reference, std::span<const PathCopy> copies);

}  // namespace haptrace
