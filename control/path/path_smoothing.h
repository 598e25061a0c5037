// Smoothing a recorded path: what is noise in its positions must not become force.
#pragma once

#include "control/path/path.h"

#include <span>
#include <vector>

namespace haptrace {

/// How the ends of a path are taken.
struct PathEnds {
  bool begins_at_rest = true;
  bool ends_at_rest = true;
};

/// The positions of the cubic smoothing spline at the samples of a path [m]: of all curves x, the one that makes least
/// of
///
///     integral of |x - p|^2 dt  +  tau^4  integral of |x''|^2 dt
///
/// over the samples p, the first integral by the trapezoidal rule (Reinsch 1967; de Boor, A Practical Guide to Splines,
/// ch. XIV). It is a zero-phase low pass with gain 1 / (1 + (omega tau)^4): nothing is late, and with tau = 0 it is the
/// C2 cubic spline through the samples. At distance t, a sample weighs exp(-t / (sqrt(2) tau)) of what it weighs in its
/// own place.
///
/// Why: a device that counts in steps of q leaves noise of q / sqrt(12) in every position. 1 kHz makes of 50 um some
/// 35 m/s^2 of noise in the second difference, several newtons when it is fed forward.
///
/// Threads: free functions without state. Real-time: no; they allocate.
std::vector<Vec3> smooth_positions(const Path& path, double time_constant, const PathEnds& ends = {});

/// Time from a sample within which others matter to it, to 1e-9 of what they are off by [s].
constexpr double smoothing_reach(double time_constant) {
  return 30 * time_constant;
}

/// Standard deviation of the noise in each axis of the positions [m], 0 when there is none that can be told from
/// movement: the larger of
/// - what samples miss the cubic polynomial through their four neighbours by, scaled to one sample (the difference
///   estimate of Gasser, Sroka and Jennen-Steinmetz 1986, for uneven steps). A quantile of it rather than its mean
///   square, since a corner is no noise;
/// - q / sqrt(12) where every step of an axis is a multiple of q.
/// Samples more than 10 ms apart are waypoints that somebody meant, and more than 1 mm is movement: both hold no noise.
Vec3 position_noise(std::span<const Path> stretches);

/// The time constant tau [s], at most 50 ms, with which the smoothing spline leaves as much of the positions aside as
/// is noise in them (Reinsch's choice, the discrepancy principle). 0 when there is none, and when the curve through the
/// samples bends no more than 2.5 times what the smoothed one does: then it does no harm.
/// Judged by stretches of a path that stand for the whole.
double smoothing_time(std::span<const Path> stretches);

}  // namespace haptrace
