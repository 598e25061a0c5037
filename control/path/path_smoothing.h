// Smoothing of recorded paths, so that position noise does not become force.
#pragma once

#include "control/path/path.h"

#include <span>
#include <vector>

namespace haptrace {

/// Boundary conditions at the ends of a path.
struct PathEnds {
  bool begins_at_rest = true;
  bool ends_at_rest = true;
};

/// Returns the positions of the cubic smoothing spline at the samples p of a path [m]. The spline is the curve x that
/// minimises
///
///     integral of |x - p|^2 dt  +  tau^4  integral of |x''|^2 dt
///
/// with the first integral by the trapezoidal rule (Reinsch 1967; de Boor, A Practical Guide to Splines, ch. XIV). It
/// is a zero-phase low pass with gain 1 / (1 + (omega tau)^4), so it causes no delay. With tau = 0 it is the C2 cubic
/// spline through the samples. The weight of a sample falls with the distance t in time as exp(-t / (sqrt(2) tau)).
///
/// Reason: a device with an encoder resolution q has noise of q / sqrt(12) in every position. At 1 kHz and 50 um, the
/// second difference has about 35 m/s^2 of noise, which becomes several newtons when it is fed forward.
///
/// Threads: free functions without state. Real-time: no; they allocate.
std::vector<Vec3> smooth_positions(const Path& path, double time_constant, const PathEnds& ends = {});

/// Returns the time span [s] beyond which neighbours influence a sample by less than 1e-9 of their error.
constexpr double smoothing_reach(double time_constant) {
  return 30 * time_constant;
}

/// Returns the standard deviation of the position noise in each axis [m]; 0 when noise and movement cannot be
/// separated. It is the larger of two estimates:
/// - the distance of samples from the cubic polynomial through their four neighbours, scaled to one sample (the
///   difference estimate of Gasser, Sroka and Jennen-Steinmetz 1986, for uneven steps). It is a quantile rather than a
///   mean square, because a corner is not noise;
/// - q / sqrt(12), if every step of an axis is a multiple of q.
///
/// Samples more than 10 ms apart are deliberate waypoints, and differences of more than 1 mm are movement. Neither
/// counts as noise.
Vec3 position_noise(std::span<const Path> stretches);

/// Returns the time constant tau [s], at most 50 ms, with which the smoothing spline removes as much from the positions
/// as is noise in them (Reinsch's choice, the discrepancy principle). Returns 0 when there is no noise, and when the
/// curve through the samples bends at most 2.5 times as much as the smoothed one: then the noise does no harm.
/// `stretches` are parts of a path that represent the whole.
double smoothing_time(std::span<const Path> stretches);

}  // namespace haptrace
