// Response of a device at the lines of an excitation signal.
#pragma once

#include <Eigen/Core>

#include <complex>
#include <numbers>
#include <vector>

namespace haptrace {

inline constexpr double kTwoPi = 2 * std::numbers::pi;

/// Amplitudes of position [m] and force [N] at one spectral line, averaged coherently over all windows.
struct LineResponse {
  double w = 0;  ///< [rad/s]
  Eigen::Vector3cd position = Eigen::Vector3cd::Zero(), force = Eigen::Vector3cd::Zero();
};

struct LineSpectrum {
  std::vector<LineResponse> lines;  ///< in the order of frequency
  double noise = 0;                 ///< standard deviation of the real and imaginary part of a position amplitude [m]
};

}  // namespace haptrace
