#include "control/design/inertia_identification.h"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace haptrace {
namespace {

using Complex = std::complex<double>;

constexpr double kLowest = 25;            // of the lines [Hz]
constexpr double kMostNoise = 0.2;        // of a response, beyond which its inverse is biased
constexpr double kBeyond = 1.1;           // how far the map reaches, over the places
constexpr double kExtrapolated = 0.85;    // smallest factor over the smallest measured one, and likewise the largest
constexpr double kLeastDeviation = 0.03;  // the model is no better than that, with a hand on the device

/// Returns the response of `axis` at the lines of its own, with the frequency of each [rad/s].
struct Line {
  double w;
  Complex response;  ///< [m/N]
  double noise;      ///< standard deviation of either part of it [m/N]
};

std::vector<Line> lines_of(const Experiment& experiment, const LineSpectrum& spectrum, int axis) {
  std::vector<Line> lines;
  for (const SpectralLine& own : experiment.dither->lines(axis)) {
    const double w = 2 * std::numbers::pi * own.frequency_hz;
    if (own.frequency_hz < kLowest) continue;
    for (const LineResponse& line : spectrum.lines)
      if (std::abs(line.w - w) < 1e-6)
        lines.push_back({w, line.position[axis] / line.force[axis], spectrum.noise / std::abs(line.force[axis])});
  }
  return lines;
}

/// Returns 1 for each axis with places at clearly different distances up to `farthest` [m], else 0.
Vec3 shows_curve(const Experiment& experiment, const Vec3& farthest) {
  constexpr double kClearlyNearer = 0.8;
  Vec3 shows = Vec3::Zero();
  for (const ExperimentPlace& place : experiment.places)
    for (int axis = 0; axis < 3; ++axis) {
      const double away = std::abs(place.position[axis] - experiment.centre[axis]);
      if (away > 0 && away < kClearlyNearer * farthest[axis]) shows[axis] = 1;
    }
  return shows;
}

/// Returns the matrix from parameters of equal likelihood to slopes, bends and curves. Where places are missing, the
/// smallest parameters that agree with the others count: a workspace is rather symmetrical, and its axes are alike.
Eigen::Matrix<double, 9, 11> likely_shapes() {
  constexpr double kUnlikely = 0.3;  // a slope, and a difference between axes
  Eigen::Matrix<double, 9, 11> shapes = Eigen::Matrix<double, 9, 11>::Zero();
  shapes.topLeftCorner<9, 9>() = kUnlikely * Eigen::Matrix<double, 9, 9>::Identity();
  shapes.col(9).segment<3>(3).setOnes();
  shapes.col(10).tail<3>().setOnes();
  return shapes;
}

}  // namespace

std::optional<std::vector<InertiaFactor>> inertia_factors(const Experiment& experiment,
                                                          const Identification& identified) {
  if (experiment.dither == nullptr || !identified.fits || experiment.places.empty()) return std::nullopt;
  const LineSpectrum centre = spectrum_of(experiment);
  std::vector<InertiaFactor> factors;
  for (const ExperimentPlace& place : experiment.places) {
    Experiment there = experiment;
    there.dithered = {place.dithered};
    const LineSpectrum spectrum = spectrum_of(there);
    if (spectrum.lines.empty()) return std::nullopt;
    InertiaFactor factor;
    for (int axis = 0; axis < 3; ++axis) {
      if (!experiment.axes[static_cast<std::size_t>(axis)]) continue;
      const std::vector<Line> here = lines_of(experiment, centre, axis), then = lines_of(there, spectrum, axis);
      const double late = identified.plant.delay + 0.5 / experiment.rate_hz;
      double sum = 0, weights = 0;
      for (std::size_t i = 0; i < here.size(); ++i) {
        const auto& [w, own, own_noise] = here[i];
        const auto& [same, other, other_noise] = then[i];
        if (own_noise > kMostNoise * std::abs(own) || other_noise > kMostNoise * std::abs(other)) continue;
        const Complex mass = -identified.plant.mass[axis] * w * w * std::polar(1.0, w * late);
        const double variance =
            (std::pow(own_noise / std::norm(own), 2) + std::pow(other_noise / std::norm(other), 2)) / std::norm(mass);
        sum += std::real((1.0 / other - 1.0 / own) / mass) / variance;
        weights += 1 / variance;
      }
      factor.factor[axis] = weights > 0 ? 1 + sum / weights : 1;
      factor.deviation[axis] = std::hypot(1 / std::sqrt(weights), kLeastDeviation);
    }
    factors.push_back(factor);
  }
  return factors;
}

std::optional<InertiaMap> identify_inertia(const Experiment& experiment, const Identification& identified) {
  const auto factors = inertia_factors(experiment, identified);
  if (!factors) return std::nullopt;
  bool varies = false;
  for (const InertiaFactor& at : *factors)
    varies |= ((at.factor.array() - 1).abs() > (3 * at.deviation.array()).max(kLeastVariation)).any();
  if (!varies) return std::nullopt;

  InertiaMap map{.centre = experiment.centre};
  const auto count = static_cast<Eigen::Index>(factors->size());
  const auto place = [&](Eigen::Index i) -> Vec3 {
    return experiment.places[static_cast<std::size_t>(i)].position - experiment.centre;
  };
  Vec3 farthest = Vec3::Zero();
  for (Eigen::Index i = 0; i < count; ++i) farthest = farthest.cwiseMax(place(i).cwiseAbs());
  for (int axis = 0; axis < 3; ++axis)
    if (experiment.axes[static_cast<std::size_t>(axis)])
      map.reach[axis] = kBeyond * (farthest[axis] > 0 ? farthest[axis] : farthest.maxCoeff());
  const Vec3 inverse_reach = (map.reach.array() > 0).select(map.reach.cwiseInverse(), Vec3::Zero());
  const Vec3 curved = shows_curve(experiment, farthest);
  Eigen::Matrix<double, Eigen::Dynamic, 9> places(count, 9);  // slopes, bends and curves, for a reach of 1
  for (Eigen::Index i = 0; i < count; ++i) {
    const Vec3 u = place(i).cwiseProduct(inverse_reach), squares = u.cwiseProduct(u);
    places.row(i) << u.transpose(), squares.transpose(), squares.sum() * curved.cwiseProduct(squares).transpose();
  }
  const Eigen::Matrix<double, 9, 11> likely = likely_shapes();
  for (int axis = 0; axis < 3; ++axis) {
    if (!experiment.axes[static_cast<std::size_t>(axis)]) continue;
    Eigen::VectorXd off(count), weight(count);
    double least = 1, most = 1;
    for (Eigen::Index i = 0; i < count; ++i) {
      const InertiaFactor& at = (*factors)[static_cast<std::size_t>(i)];
      off[i] = at.factor[axis] - 1;
      weight[i] = 1 / at.deviation[axis];
      least = std::min(least, at.factor[axis]);
      most = std::max(most, at.factor[axis]);
    }
    const Eigen::Matrix<double, 9, 1> found =
        likely *
        (weight.asDiagonal() * places * likely).completeOrthogonalDecomposition().solve(weight.cwiseProduct(off));
    for (int along = 0; along < 3; ++along) {
      if (farthest[along] == 0 && found[3 + along] > 0) continue;  // a law for too large a mass would be too stiff
      const double inverse = inverse_reach[along];
      map.slope(axis, along) = found[along] * inverse;
      map.bend(axis, along) = found[3 + along] * inverse * inverse;
      map.curve(axis, along) = found[6 + along] * inverse * inverse;
    }
    map.least[axis] = kExtrapolated * std::max(least, 0.1);
    map.most[axis] = most / kExtrapolated;
  }
  return map;
}

}  // namespace haptrace
