// How smooth a movement was, from its speed.
#pragma once

#include <optional>
#include <span>

namespace haptrace {

/// The values that Balasubramanian and others (2015) use.
struct SparcOptions {
  int pad_level = 4;        ///< zeros make the transform 2^pad_level times as long, from 0 to 16
  double cutoff_hz = 10;    ///< above it nothing counts; at most half the rate does
  double threshold = 0.05;  ///< the spectrum ends at its last line of this share of the largest
};

/// The spectral arc length (SPARC) of a speed: the negative length of the curve of its spectrum V(f), divided by V(0),
/// from 0 to f_c, the last line up to the cut-off that is not below the threshold:
///
///     SPARC = - integral over [0, f_c] of sqrt((1 / f_c)^2 + (d(V / V(0)) / df)^2) df
///
/// as the sum over the lines k rate / n of the transform, n = 2^(ceil(log2 N) + pad_level). (Balasubramanian,
/// Melendez-Calderon, Roby-Brami, Burdet 2015, On the analysis of movement smoothness; a speed is nowhere negative, so
/// that its largest line is that at 0.) No unit: -1.40 for a minimum-jerk movement, the more negative the less smooth.
/// It is the same for every amplitude, and but for the distance of the lines (1 %) for every duration, as long as the
/// speed is that of the movement alone, without the rest before and after: see movement.h.
///
/// Undefined for fewer than 3 samples, for a sample that is not finite, for rest, and when only one line is left.
/// Throws Error(input) for a negative speed (that is a component of the velocity), a rate that is not positive and
/// options that mean nothing.
///
/// Costs O(N log N) time and O(N) memory, times 2^pad_level / 2 the time. Threads: free functions without state.
std::optional<double> sparc(std::span<const double> speed, double rate_hz, const SparcOptions& options = {});

/// The dimensionless jerk of a speed v sampled N times, dt apart:
///
///     DLJ = - (N dt)^3 / v_peak^2 * sum of (second difference of v / dt^2)^2 dt
///
/// (Hogan and Sternad 2009, Sensitivity of smoothness measures to movement duration, amplitude, and arrests). -204.8
/// for a minimum-jerk movement of any amplitude and duration. Noise counts with the sixth power of its frequency: the
/// speed has to be low-passed. Undefined and throwing as sparc().
std::optional<double> dimensionless_jerk(std::span<const double> speed, double rate_hz);

/// -ln |DLJ|: -5.32 for a minimum-jerk movement. Undefined also where there is no jerk at all.
std::optional<double> log_dimensionless_jerk(std::span<const double> speed, double rate_hz);

}  // namespace haptrace
