#include "formats/convert/low_pass.h"

#include "control/rotation.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kAttenuation = 60;  // [dB]
constexpr double kBeta = 0.1102 * (kAttenuation - 8.7);
constexpr double kTransition = 0.4;  // width of the transition band / cut-off
constexpr std::size_t kTable = 4096;

std::vector<double> kaiser_window() {
  std::vector<double> table(kTable + 2, 0.0);
  for (std::size_t i = 0; i <= kTable; ++i) {
    const double u = static_cast<double>(i) / kTable;
    table[i] = std::cyl_bessel_i(0.0, kBeta * std::sqrt(1 - u * u)) / std::cyl_bessel_i(0.0, kBeta);
  }
  return table;
}

/// Returns how many samples on both sides have values, at most `reach`.
template <class Column>
std::size_t known_around(std::span<const Sample> samples, std::size_t at, std::size_t reach, Column column) {
  const std::size_t most = std::min({reach, at, samples.size() - 1 - at});
  for (std::size_t k = 1; k <= most; ++k)
    if (!is_finite(samples[at - k].*column) || !is_finite(samples[at + k].*column)) return k - 1;
  return most;
}

}  // namespace

LowPass::LowPass(double cutoff_hz, double rate_hz)
    : step_(2 * std::numbers::pi * cutoff_hz / rate_hz),
      // Half of Kaiser's length of a kernel, (A - 7.95) / (2.285 dw).
      reach_(static_cast<std::size_t>(std::ceil((kAttenuation - 7.95) / (2 * 2.285 * kTransition * step_)))),
      window_(kaiser_window()) {}

/// Computes the weights of a kernel of `reach` samples to either side; their sum over both sides is one.
void LowPass::weigh(std::size_t reach) {
  if (weights_.size() == reach + 1) return;
  weights_.assign(1, 1.0);
  double sum = 1;
  for (std::size_t k = 1; k <= reach; ++k) {
    const auto distance = static_cast<double>(k);
    const double place = distance / static_cast<double>(reach) * kTable;
    const auto entry = static_cast<std::size_t>(place);
    const double window = std::lerp(window_[entry], window_[entry + 1], place - static_cast<double>(entry));
    weights_.push_back(window * std::sin(step_ * distance) / (step_ * distance));
    sum += 2 * weights_.back();
  }
  for (double& weight : weights_) weight /= sum;
}

Sample LowPass::at(std::span<const Sample> samples, std::size_t at) {
  Sample result = samples[at];
  for (const auto column :
       {&Sample::position, &Sample::velocity, &Sample::force, &Sample::torque, &Sample::force_measured,
        &Sample::reference_position, &Sample::reference_velocity, &Sample::reference_force}) {
    if (!is_finite(result.*column)) continue;
    weigh(known_around(samples, at, reach_, column));
    Vec3 sum = weights_[0] * (result.*column);
    for (std::size_t k = 1; k < weights_.size(); ++k)
      sum += weights_[k] * (samples[at - k].*column + samples[at + k].*column);
    result.*column = sum;
  }
  for (const auto column : {&Sample::orientation, &Sample::reference_orientation}) {
    if (!is_finite(result.*column)) continue;
    weigh(known_around(samples, at, reach_, column));
    const Eigen::Vector4d here = (result.*column).coeffs();
    const auto near = [&](std::size_t i) -> Eigen::Vector4d {  // a quaternion and its negative are the same rotation
      const Eigen::Vector4d& there = (samples[i].*column).coeffs();
      return there.dot(here) < 0 ? Eigen::Vector4d(-there) : there;
    };
    Eigen::Vector4d sum = weights_[0] * here;
    for (std::size_t k = 1; k < weights_.size(); ++k) sum += weights_[k] * (near(at - k) + near(at + k));
    if (const double norm = sum.norm(); norm > 0.5) (result.*column).coeffs() = sum / norm;
  }
  return result;
}

}  // namespace haptrace
