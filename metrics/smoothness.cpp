#include "metrics/smoothness.h"

#include "base/error.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <numbers>
#include <unsupported/Eigen/FFT>
#include <vector>

namespace haptrace {
namespace {

/// Returns whether this speed has smoothness metrics. Throws when the rate or the speed is invalid.
bool is_movement(std::span<const double> speed, double rate_hz) {
  if (!(rate_hz > 0) || !std::isfinite(rate_hz))
    throw input_error(fmt::format("the rate of the speed is {} Hz; it must be positive", rate_hz));
  if (speed.size() < 3 || !std::all_of(speed.begin(), speed.end(), [](double v) { return std::isfinite(v); }))
    return false;
  if (const auto negative = std::find_if(speed.begin(), speed.end(), [](double v) { return v < 0; });
      negative != speed.end())
    throw input_error(
        fmt::format("sample {} of the speed is {} m/s; a speed must not be negative; give the magnitude of the "
                    "velocity, not a component",
                    negative - speed.begin() + 1, *negative));
  return *std::max_element(speed.begin(), speed.end()) > 0;
}

/// Computes the magnitudes of the lines 0 to `last` of the transform of x, padded with zeros to 2^pad_level times
/// `length`.
///
/// Line R k + r of the padded transform, R = 2^pad_level, is line k of the transform of x[i] exp(-2 pi j r i / (R
/// length)). So R transforms of the unpadded length replace one that is mostly zeros and would take a gigabyte for an
/// hour at 1 kHz. x is real: lines n - k equal lines k, so that half of the r are enough.
std::vector<double> padded_spectrum(std::span<const double> x, std::size_t length, int pad_level, std::size_t last) {
  using Complex = std::complex<double>;
  const std::size_t repeats = std::size_t{1} << pad_level, lines = length * repeats;
  std::vector<double> magnitude(last + 1);
  std::vector<Complex> turned(length), spectrum(length);
  Eigen::FFT<double> fft;
  for (std::size_t r = 0; r <= repeats / 2; ++r) {
    const double turn = -2 * std::numbers::pi * static_cast<double>(r) / static_cast<double>(lines);
    for (std::size_t i = 0; i < x.size(); ++i) turned[i] = x[i] * std::polar(1.0, turn * static_cast<double>(i));
    fft.fwd(spectrum, turned);
    for (std::size_t k = 0; k < length; ++k)
      for (const std::size_t line : {repeats * k + r, lines - repeats * k - r})
        if (line <= last) magnitude[line] = std::abs(spectrum[k]);
  }
  return magnitude;
}

}  // namespace

std::optional<double> sparc(std::span<const double> speed, double rate_hz, const SparcOptions& options) {
  if (options.pad_level < 0 || options.pad_level > 16 || !(options.cutoff_hz > 0) || !(options.threshold >= 0))
    throw input_error(
        fmt::format("SPARC with pad level {}, cut-off {} Hz and threshold {}: the pad level must be from 0 to 16, the "
                    "cut-off must be positive and the threshold must not be negative",
                    options.pad_level, options.cutoff_hz, options.threshold));
  if (!is_movement(speed, rate_hz)) return std::nullopt;

  const std::size_t length = std::bit_ceil(speed.size());
  const double lines = std::ldexp(static_cast<double>(length), options.pad_level);
  const auto last = static_cast<std::size_t>(std::min(options.cutoff_hz / rate_hz, 0.5) * lines);
  std::vector<double> spectrum = padded_spectrum(speed, length, options.pad_level, last);
  const double largest = spectrum.front();
  for (double& line : spectrum) line /= largest;
  while (!spectrum.empty() && spectrum.back() < options.threshold) spectrum.pop_back();
  if (spectrum.size() < 2) return std::nullopt;

  const double step = 1 / static_cast<double>(spectrum.size() - 1);
  double arc = 0;
  for (std::size_t k = 1; k < spectrum.size(); ++k) arc += std::hypot(step, spectrum[k] - spectrum[k - 1]);
  return -arc;
}

namespace {

/// Computes the dimensionless jerk of speeds or velocities, whose largest magnitude is `peak`. With durations in
/// samples and speeds relative to the peak, the rate and the peak cancel out.
template <class Value>
double dimensionless(std::span<const Value> velocity, double peak) {
  double sum = 0;
  for (std::size_t i = 2; i < velocity.size(); ++i) {
    const Value bend = velocity[i] / peak - 2 * (velocity[i - 1] / peak) + velocity[i - 2] / peak;
    if constexpr (std::is_same_v<Value, double>)
      sum += bend * bend;
    else
      sum += bend.squaredNorm();
  }
  return -std::pow(static_cast<double>(velocity.size()), 3) * sum;
}

std::optional<double> log_of(const std::optional<double>& jerk) {
  return jerk && *jerk != 0 ? std::optional(-std::log(-*jerk)) : std::nullopt;
}

}  // namespace

std::optional<double> dimensionless_jerk(std::span<const double> speed, double rate_hz) {
  if (!is_movement(speed, rate_hz)) return std::nullopt;
  return dimensionless(speed, *std::max_element(speed.begin(), speed.end()));
}

std::optional<double> log_dimensionless_jerk(std::span<const double> speed, double rate_hz) {
  return log_of(dimensionless_jerk(speed, rate_hz));
}

std::optional<double> log_dimensionless_jerk(std::span<const Vec3> velocity, double rate_hz) {
  std::vector<double> speed;
  for (const Vec3& v : velocity) speed.push_back(v.norm());
  if (!is_movement(speed, rate_hz)) return std::nullopt;
  return log_of(dimensionless(velocity, *std::max_element(speed.begin(), speed.end())));
}

}  // namespace haptrace
