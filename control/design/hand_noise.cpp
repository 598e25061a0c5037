#include "control/design/hand_noise.h"

#include "base/statistics.h"
#include "control/design/nelder_mead.h"
#include "control/design/spectrum_estimator.h"
#include "control/ripple.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <map>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

namespace haptrace {
namespace {

using Complex = std::complex<double>;

// Between what an arm does of its own accord and what only machines do.
constexpr double kLowestBetween = 4.5, kHighestBetween = 24;  // [Hz]
constexpr double kHighestMovement = 4.1;                      // of the harmonics of the movement but for friction [Hz]
constexpr double kLeastTremorHz = 3.5, kMostTremorHz = 17;
constexpr double kClearTremor = 10;    // evidence
constexpr double kLeastTremor = 0.15;  // a healthy hand has less [N]

// Dampings of the tremors that are looked for: that of the model, and one as narrow as a tremor of an illness.
constexpr std::array kDampings{HandNoise::kTremorDamping, 0.04};

/// Returns the two-sided spectral density of a tremor of 1 N at `tremor_hz` [1/Hz].
double tremor_density(double tremor_hz, double w, double damping = HandNoise::kTremorDamping) {
  const double natural = kTwoPi * tremor_hz;
  return 4 * damping * natural * natural * natural /
         std::norm(Complex(natural * natural - w * w, 2 * damping * natural * w));
}

/// One observation between the lines.
struct Remainder {
  double w = 0;       ///< [rad/s]
  double power = 0;   ///< |E|^2 [N^2]
  double passes = 0;  ///< |h|^2
  double known = 0;   ///< part of the expected power that the noise of the positions and friction make [N^2]
};

/// Returns the frequencies between the lines.
std::vector<double> frequencies_between(const Multisine& dither) {
  const std::vector<double> lines = dither.frequencies();
  std::vector<double> free;
  const double step = 1 / dither.period();
  for (double f = step; f < kHighestBetween; f += step)
    if (f > kLowestBetween && std::ranges::none_of(lines, [&](double line) { return std::abs(line - f) < 0.5 * step; }))
      free.push_back(f);
  return free;
}

std::vector<Remainder> rests_of(const Experiment& experiment, const HeldModel& held, const PlantModel& plant) {
  const Multisine& dither = *experiment.dither;
  std::vector<double> frequencies = frequencies_between(dither);
  const std::size_t free = frequencies.size();
  if (free == 0) return {};
  // The lines leak into their neighbours unless they are estimated too.
  const std::vector<double> lines = dither.frequencies();
  frequencies.insert(frequencies.end(), lines.begin(), lines.end());
  SpectrumEstimator estimator(std::move(frequencies), dither.period(), experiment.rate_hz, kHighestMovement);
  const auto add = [&](const Stretch& rows) {
    estimator.add(experiment.rows.subspan(rows.begin, rows.end - rows.begin));
  };
  for (const Stretch& stretch : experiment.dithered) add(stretch);
  for (const ExperimentPlace& place : experiment.places) add(place.dithered);
  if (estimator.windows().empty()) return {};

  const double tick = 1 / experiment.rate_hz, of_density = 4 / dither.period();
  std::vector<Remainder> rests;
  for (int axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    if (!experiment.axes[i] || !(held.mass[axis] > 0)) continue;
    for (std::size_t k = 0; k < free; ++k) {
      const double w = estimator.windows().front()[k].w;
      const Complex s(0, w);
      const HeldResponse response = held_response(held.hand[i], held.link[i], s);
      const Complex stiffness = held.mass[axis] * s * s + held.viscous[axis] * s + response.impedance;
      const double half = 0.5 * w * tick;
      const Complex acting = std::polar(std::sin(half) / half, -half - w * held.delay) / (1.0 + s * held.lag);
      const double noise = measured_noise(plant), harmonic = 0.5 * w / kTwoPi * dither.period();
      double known = of_density * std::norm(stiffness) * noise * noise * tick;
      if (std::abs(harmonic - std::round(harmonic)) < 0.25)
        known += std::pow(4 / std::numbers::pi * plant.coulomb.maxCoeff() / harmonic, 2);
      for (const auto& window : estimator.windows()) {
        const Complex force = stiffness * window[k].position[axis] - acting * window[k].force[axis];
        rests.push_back({w, std::norm(force), std::norm(response.share), known});
      }
    }
  }
  return rests;
}

class TremorFit {
 public:
  /// Borrows `rests`.
  TremorFit(std::span<const Remainder> rests, double period, double damping)
      : rests_(rests), damping_(damping), of_density_(4 / period) {
    for (const Remainder& rest : rests_) mean_ += rest.power / static_cast<double>(rests_.size());
  }

  [[nodiscard]] HandNoiseIdentification run() const {
    constexpr int kEvaluations = 200;
    const double floor = std::log(std::max(mean_ / of_density_, 1e-20));
    const auto without = minimised<1>([&](const auto& p) { return cost(0, 1, std::exp(p[0])); }, {floor}, {1}, 60);
    Point best{};
    double least = std::numeric_limits<double>::infinity();
    for (const double hz : {5.0, 7.5, 10.5, strongest()}) {
      const Point found = minimised<3>([&](const Point& p) { return cost(p); },
                                       {std::log(0.3), std::log(hz), floor - 2}, {0.7, 0.2, 1}, kEvaluations);
      if (const double value = cost(found); value < least) {
        least = value;
        best = found;
      }
    }
    HandNoiseIdentification result;
    const auto n = static_cast<double>(rests_.size());
    result.evidence = 2 * (cost(0, 1, std::exp(without[0])) - least) - 2 * std::log(n);
    const double tremor = damping_ < HandNoise::kTremorDamping ? around(best) : std::exp(best[0]);
    // Beyond the range, it is something else: cables that pass at a steady speed, for one.
    constexpr double kWithin = 0.97;
    const bool of_a_hand = frequency(best) < kWithin * kMostTremorHz;
    if (!(result.evidence > kClearTremor && tremor > kLeastTremor && of_a_hand)) return result;
    result.noise = {.drift = 0, .drift_hz = 0, .tremor = tremor, .tremor_hz = frequency(best)};
    result.half_width = {.drift = 0,
                         .drift_hz = 0,
                         .tremor = tremor * half_width(best, 0),
                         .tremor_hz = result.noise.tremor_hz * half_width(best, 1)};
    return result;
  }

 private:
  using Point = std::array<double, 3>;  ///< logarithms of tremor [N], its frequency [Hz] and the floor c^2

  static double frequency(const Point& p) { return std::clamp(std::exp(p[1]), kLeastTremorHz, kMostTremorHz); }

  [[nodiscard]] double cost(const Point& p) const { return cost(std::exp(p[0]), frequency(p), std::exp(p[2])); }

  /// Returns -ln of the likelihood.
  [[nodiscard]] double cost(double tremor, double tremor_hz, double floor) const {
    double sum = 0;
    for (const Remainder& rest : rests_) {
      const double expected =
          of_density_ * (rest.passes * tremor * tremor * tremor_density(tremor_hz, rest.w, damping_) + floor) +
          rest.known;
      sum += std::log(expected) + rest.power / expected;
    }
    return sum;
  }

  /// Returns the rms of the tremor from the power within a window's resolution of its frequency [N]. The density at
  /// the frequencies alone would make a tremor too small that is narrower than the resolution.
  [[nodiscard]] double around(const Point& best) const {
    const double resolution = kTwoPi * of_density_ / 4;  // of a window [rad/s]
    std::map<double, std::pair<double, int>> powers;
    for (const Remainder& rest : rests_) {
      if (!(std::abs(rest.w - kTwoPi * frequency(best)) < 1.5 * resolution)) continue;
      auto& [sum, count] = powers[rest.w];
      sum += (rest.power - rest.known - of_density_ * std::exp(best[2])) / rest.passes;
      ++count;
    }
    double squares = 0;
    for (const auto& [w, power] : powers) squares += 0.5 * power.first / power.second;
    return std::sqrt(std::max(squares, 0.0));
  }

  /// Returns the frequency at which the force of the hand is largest [Hz].
  [[nodiscard]] double strongest() const {
    std::map<double, double> powers;
    for (const Remainder& rest : rests_) powers[rest.w] += rest.power / rest.passes;
    const auto less = [](const auto& a, const auto& b) { return a.second < b.second; };
    return std::max_element(powers.begin(), powers.end(), less)->first / kTwoPi;
  }

  /// Returns the half width of the 95 % confidence interval of a logarithm, the other numbers held.
  [[nodiscard]] double half_width(const Point& best, std::size_t which) const {
    constexpr double kStep = 0.05;
    Point more = best, less = best;
    more[which] += kStep;
    less[which] -= kStep;
    const double curvature = (cost(more) + cost(less) - 2 * cost(best)) / (kStep * kStep);
    return curvature > 0 ? std::min(1.0, kInterval95 / std::sqrt(curvature)) : 1;
  }

  std::span<const Remainder> rests_;
  double damping_, of_density_, mean_ = 0;
};

}  // namespace

HandNoiseIdentification identify_hand_noise(const Experiment& experiment, const HeldModel& held,
                                            const PlantModel& plant) {
  if (experiment.dither == nullptr) return {};
  constexpr std::size_t kFewest = 24;
  const std::vector<Remainder> rests = rests_of(experiment, held, plant);
  if (rests.size() < kFewest) return {};
  HandNoiseIdentification best;
  for (const double damping : kDampings) {
    const HandNoiseIdentification found = TremorFit(rests, experiment.dither->period(), damping).run();
    // A window shows a broad tremor as narrow by chance, and then its sides are missing.
    const bool larger = found.noise.tremor > best.noise.tremor && found.evidence > best.evidence;
    if (damping == kDampings.front() || larger) best = found;
  }
  return best;
}

TremorForce tremor_at_motors(const HeldModel& held) noexcept {
  TremorForce force;
  if (!(held.noise.tremor > 0 && held.noise.tremor_hz > 0)) return force;
  constexpr double kStep = 0.05, kMost = 80;  // [Hz]
  for (int axis = 0; axis < 3; ++axis) {
    if (!(held.mass[axis] > 0)) continue;
    const auto i = static_cast<std::size_t>(axis);
    double whole = 0, ripple = 0;  // variances for a tremor of 1 N
    for (double f = 0.5 * kStep; f < kMost; f += kStep) {
      const double w = kTwoPi * f;
      const double power = 2 * kStep * tremor_density(held.noise.tremor_hz, w) *
                           std::norm(held_response(held.hand[i], held.link[i], Complex(0, w)).share);
      const double passes = 1 / (1 + std::pow(kRippleCutoff / f, 4));
      whole += power;
      ripple += power * passes * passes;
    }
    force.whole[axis] = held.noise.tremor * std::sqrt(whole);
    force.ripple[axis] = held.noise.tremor * std::sqrt(ripple);
  }
  return force;
}

}  // namespace haptrace
