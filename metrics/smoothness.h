// Smoothness of a movement, from its speed.
#pragma once

#include "base/types.h"

#include <optional>
#include <span>

namespace haptrace {

/// The defaults are those of Balasubramanian and others (2015).
struct SparcOptions {
  int pad_level = 4;        ///< zero padding makes the transform 2^pad_level times as long, from 0 to 16
  double cutoff_hz = 10;    ///< frequencies above it are ignored; at most half the rate is used
  double threshold = 0.05;  ///< the spectrum ends at the last line with at least this fraction of the largest
};

/// Computes the spectral arc length (SPARC) of a speed: the negative length of the curve of its spectrum V(f), divided
/// by V(0), from 0 to f_c. f_c is the last line up to the cut-off that is not below the threshold:
///
///     SPARC = - integral over [0, f_c] of sqrt((1 / f_c)^2 + (d(V / V(0)) / df)^2) df
///
/// as the sum over the lines k rate / n of the transform, n = 2^(ceil(log2 N) + pad_level). (Balasubramanian,
/// Melendez-Calderon, Roby-Brami, Burdet 2015, On the analysis of movement smoothness; a speed is nowhere negative, so
/// that its largest line is that at 0.) Dimensionless: -1.40 for a minimum-jerk movement; more negative is less smooth.
/// It does not depend on the amplitude, nor on the duration except through the spacing of the lines (1 %). The speed
/// must be that of the movement alone, without the rest before and after: see movement.h.
///
/// Returns nothing for fewer than 3 samples, for a sample that is not finite, for rest, and when only one line is left.
/// Throws Error(input) for a negative speed (which is a component of the velocity), a rate that is not positive and
/// invalid options.
///
/// Costs O(N log N) time, times 2^pad_level / 2, and O(N) memory. Threads: free functions without state.
std::optional<double> sparc(std::span<const double> speed, double rate_hz, const SparcOptions& options = {});

/// Computes the dimensionless jerk of a speed v sampled N times, dt apart (the speed form):
///
///     DLJ = - (N dt)^3 / v_peak^2 * sum of (second difference of v / dt^2)^2 dt
///
/// (Hogan and Sternad 2009, Sensitivity of smoothness measures to movement duration, amplitude, and arrests). It is
/// -204.8 for a minimum-jerk movement of any amplitude and duration. The weight of noise rises with the sixth power of
/// its frequency, so the speed must be low-passed. Undefined and invalid speeds are those of sparc().
///
/// Other normalisations of the same integral for a minimum-jerk movement of amplitude A, whose peak speed is 1.875 A /
/// T: T^5 / A^2 gives 720, half of it 360, its root 18.97 (Teulings and others 1997).
///
/// Rest before or after, and a crop, change it: at 5 % of the peak speed a minimum-jerk movement has -4.40 instead of
/// -5.32. Compare movements under one rule only.
std::optional<double> dimensionless_jerk(std::span<const double> speed, double rate_hz);

/// Computes -ln |DLJ|: -5.32 for a minimum-jerk movement. Also undefined without any jerk.
std::optional<double> log_dimensionless_jerk(std::span<const double> speed, double rate_hz);

/// Computes the same from the velocity as a vector (the vector form: |d3x / dt3| instead of the second derivative of
/// the speed; Balasubramanian and others 2015). Both forms are equal on a straight line. On one lap of a circle at
/// minimum-jerk speed the vector form is -8.99 and the speed form -5.32. Undefined and invalid velocities are as above.
std::optional<double> log_dimensionless_jerk(std::span<const Vec3> velocity, double rate_hz);

}  // namespace haptrace
