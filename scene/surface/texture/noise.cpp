#include "scene/surface/texture/noise.h"

#include "scene/surface/hash.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;

/// Perlin's 12 directions to the middles of a cube's edges, 4 of them twice.
constexpr std::array<std::array<double, 3>, 16> kDirections{{{1, 1, 0},
                                                             {-1, 1, 0},
                                                             {1, -1, 0},
                                                             {-1, -1, 0},
                                                             {1, 0, 1},
                                                             {-1, 0, 1},
                                                             {1, 0, -1},
                                                             {-1, 0, -1},
                                                             {0, 1, 1},
                                                             {0, -1, 1},
                                                             {0, 1, -1},
                                                             {0, -1, -1},
                                                             {1, 1, 0},
                                                             {-1, 1, 0},
                                                             {0, -1, 1},
                                                             {0, -1, -1}}};

/// Bound of the gradient of Perlin's noise: in the middle of a cell, all eight directions may agree. Its rms is 1.22.
constexpr double kSteepestPerlin = 3.75;
constexpr double kRmsPerlin = 0.27;  // of its value
/// Octaves hardly ever meet at their steepest: this multiple of the root of the sum of their squares is passed nowhere
/// in practice. It is 3.7 times the rms of the gradient, a vector of three parts.
constexpr double kRareOctaves = 4.5;
constexpr double kRare = 5.5;  // of a sum of many waves over its rms: once in 3e7 places

/// Calls `visit` with every point of the Poisson process in a cell, `mean` points on average. At most kMostPoints.
template <class Visit>
void each_point(const LatticeCell& cell, std::uint64_t seed, double mean, const Visit& visit) noexcept {
  constexpr int kMostPoints = 32;
  std::uint64_t bits = hash_of_cell(cell, seed);
  // Number of a Poisson distribution (Knuth): factors from 0 to 1 until their product falls below exp(-mean).
  double product = unit_number(bits);
  const double least = std::exp(-mean);
  int count = 0;
  for (; product > least && count < kMostPoints; ++count) {
    bits = mixed(bits);
    product *= unit_number(bits);
  }
  for (int i = 0; i < count; ++i) {
    Vec3 point;
    for (int axis = 0; axis < 3; ++axis) {
      bits = mixed(bits);
      point[axis] = static_cast<double>(cell[static_cast<std::size_t>(axis)]) + unit_number(bits);
    }
    bits = mixed(bits);
    visit(point, bits);
  }
}

}  // namespace

HeightSample perlin_noise(const Vec3& place, std::uint64_t seed) noexcept {
  const LatticeCell cell = cell_of(place);
  const Vec3 at =
      place - Vec3(static_cast<double>(cell[0]), static_cast<double>(cell[1]), static_cast<double>(cell[2]));
  const Vec3 t = at.cwiseMax(0).cwiseMin(1);
  const Eigen::Array3d a = t.array();
  const Eigen::Array3d fade = a * a * a * (a * (a * 6 - 15) + 10), slope = 30 * a * a * (a * (a - 2) + 1);
  HeightSample sum;
  for (unsigned corner = 0; corner < 8; ++corner) {
    const Eigen::Array3i far(corner & 1U, (corner >> 1U) & 1U, (corner >> 2U) & 1U);
    const auto& direction =
        kDirections[hash_of_cell({cell[0] + far[0], cell[1] + far[1], cell[2] + far[2]}, seed) & 15U];
    const Vec3 g(direction[0], direction[1], direction[2]);
    Eigen::Array3d weight, rise;
    for (int axis = 0; axis < 3; ++axis) {
      weight[axis] = far[axis] != 0 ? fade[axis] : 1 - fade[axis];
      rise[axis] = far[axis] != 0 ? slope[axis] : -slope[axis];
    }
    const double value = g.dot(at - far.cast<double>().matrix());
    const double w = weight[0] * weight[1] * weight[2];
    sum.value += w * value;
    sum.gradient += w * g + value * Vec3(rise[0] * weight[1] * weight[2], weight[0] * rise[1] * weight[2],
                                         weight[0] * weight[1] * rise[2]);
  }
  return sum;
}

HeightSample PerlinHeight::at(const Vec3& place, double finest) const noexcept {
  const double share = spec_.amplitude * fade(spec_.wavelength, finest);
  if (share == 0) return {};
  const HeightSample noise = perlin_noise(place / spec_.wavelength, spec_.seed);
  const double slope = share / spec_.wavelength;
  return {share * noise.value, slope * noise.gradient, kSteepestPerlin * slope};
}

FractalHeight::FractalHeight(const NoiseSpec& spec, FractalKind kind, int octaves, double hurst)
    : spec_(spec), kind_(kind), octaves_(octaves), hurst_(hurst) {
  set("octaves", octaves);
}

double FractalHeight::wavelength() const noexcept {
  return spec_.wavelength * std::exp2(1 - octaves_);
}

std::vector<Knob> FractalHeight::knobs() const {
  return {{"octaves", "", {1, 2, 4, 8}, static_cast<double>(octaves_), 1, kMostOctaves}};
}

void FractalHeight::set(const std::string& knob, double level) {
  if (knob != "octaves") return;
  octaves_ = static_cast<int>(std::lround(level));
  double sum = 0;
  for (int i = 0; i < kMostOctaves; ++i) sum += std::exp2(-hurst_ * i);
  scale_ = spec_.amplitude / sum;  // the same for any number of octaves: fewer only leave out detail

  // Heights are the mean of the used octaves and six times their standard deviation, within what is possible.
  double used = 0, squares = 0;
  for (int i = 0; i < octaves_; ++i) {
    used += std::exp2(-hurst_ * i);
    squares += std::exp2(-2 * hurst_ * i);
  }
  const double spread = std::sqrt(squares);
  switch (kind_) {
    case FractalKind::fbm:
      range_.high = std::min(used, 6 * kRmsPerlin * spread);
      range_.low = -range_.high;
      break;
    case FractalKind::ridged:
    case FractalKind::turbulence: {
      constexpr double kMean = 0.22, kSpread = 1;  // of a magnitude
      range_ = {std::max(0.0, kMean * used - kSpread * spread), std::min(used, kMean * used + kSpread * spread)};
      if (kind_ == FractalKind::ridged) range_ = {used - range_.high, used - range_.low};
      break;
    }
  }
  range_ = {scale_ * range_.low, scale_ * range_.high};
}

HeightSample FractalHeight::at(const Vec3& place, double finest) const noexcept {
  constexpr double kRound = 0.05;
  HeightSample sum;
  double scale = scale_, wavelength = spec_.wavelength;
  const double gain = std::exp2(-hurst_);
  double slopes = 0, squares = 0;
  for (int i = 0; i < octaves_; ++i, scale *= gain, wavelength *= 0.5) {
    const double share = scale * fade(wavelength, finest);
    if (share == 0) break;
    // Octaves are shifted: their lattice points, where each is zero, would meet.
    const Vec3 shifted = place / wavelength + Vec3::Constant(0.31 * i);
    HeightSample noise = perlin_noise(shifted, spec_.seed + static_cast<std::uint64_t>(i));
    if (kind_ != FractalKind::fbm) {
      const double magnitude = std::sqrt(noise.value * noise.value + kRound * kRound);
      noise.gradient *= (kind_ == FractalKind::ridged ? -1 : 1) * noise.value / magnitude;
      noise.value = kind_ == FractalKind::ridged ? 1 - magnitude : magnitude;
    }
    const double slope = share / wavelength;
    sum.value += share * noise.value;
    sum.gradient += slope * noise.gradient;
    slopes += slope;
    squares += slope * slope;
  }
  sum.steepest = std::min(kSteepestPerlin * slopes, kRareOctaves * std::sqrt(squares));
  return sum;
}

// The steepest slope: one and a half spots, and 4.5 times the rms of Campbell's theorem, whose integral of the squared
// slope is 2.19.
SpotHeight::SpotHeight(const NoiseSpec& spec, double density)
    : spec_(spec), density_(density), steepest_(1.5 * pi + 4.5 * std::sqrt(2.19 * density)) {}

HeightSample SpotHeight::at(const Vec3& place, double finest) const noexcept {
  const double share = spec_.amplitude * fade(spec_.wavelength, finest);
  if (share == 0) return {};
  const Vec3 scaled = place / spec_.wavelength;
  // A spot reaches half a cell's edge: those in the nearer half of the neighbours matter.
  const LatticeCell corner = cell_of(scaled - Vec3::Constant(0.5));
  HeightSample sum;
  for (std::int64_t i = 0; i < 8; ++i)
    each_point({corner[0] + (i & 1), corner[1] + ((i >> 1) & 1), corner[2] + ((i >> 2) & 1)}, spec_.seed, density_,
               [&](const Vec3& point, std::uint64_t bits) {
                 const Vec3 offset = scaled - point;
                 const double distance = offset.norm();
                 if (distance >= 0.5) return;
                 const double sign = (bits & 1U) != 0 ? 1 : -1;
                 sum.value += sign * 0.5 * (1 + std::cos(2 * pi * distance));
                 if (distance > 0) sum.gradient -= sign * pi * std::sin(2 * pi * distance) / distance * offset;
               });
  const double slope = share / spec_.wavelength;
  return {share * sum.value, slope * sum.gradient, slope * steepest_};
}

double SpotHeight::highest() const noexcept {
  // Six times the rms of Campbell's theorem, whose integral of the squared spot is 0.0471, and one spot.
  return spec_.amplitude * (1 + 6 * std::sqrt(0.0471 * density_));
}

CellularHeight::CellularHeight(const NoiseSpec& spec, CellularKind kind, int cells)
    : spec_(spec), kind_(kind), cells_(cells) {}

double CellularHeight::highest() const noexcept {
  // The second nearest point is further away in 3e-9 of the places: (1 + m) exp(-m) with m = 4/3 pi 1.75^3.
  return 1.75 * spec_.amplitude;
}

std::vector<Knob> CellularHeight::knobs() const {
  return {{"cells", "", {8, 27}, static_cast<double>(cells_), 8, 27}};
}

void CellularHeight::set(const std::string& knob, double level) {
  if (knob == "cells") cells_ = level < 27 ? 8 : 27;
}

HeightSample CellularHeight::at(const Vec3& place, double finest) const noexcept {
  // Four points in a cell make an empty neighbourhood of 27 cells as rare as exp(-108).
  constexpr double kPoints = 4;
  static const double kEdge = std::cbrt(kPoints);
  const double share = spec_.amplitude * fade(spec_.wavelength, finest);
  if (share == 0) return {};
  const double edge = kEdge * spec_.wavelength;  // of a cell [m]
  const Vec3 scaled = place / edge;
  const bool all = cells_ == 27;
  const LatticeCell corner = cell_of(all ? Vec3(scaled - Vec3::Ones()) : Vec3(scaled - Vec3::Constant(0.5)));
  const std::int64_t side = all ? 3 : 2;
  double first = std::numeric_limits<double>::infinity(), second = first;
  Vec3 to_first = Vec3::UnitX(), to_second = Vec3::UnitX();
  for (std::int64_t i = 0; i < side * side * side; ++i)
    each_point({corner[0] + i % side, corner[1] + i / side % side, corner[2] + i / (side * side)}, spec_.seed, kPoints,
               [&](const Vec3& point, std::uint64_t) {
                 const Vec3 offset = scaled - point;
                 const double square = offset.squaredNorm();
                 if (square < first) {
                   second = first;
                   to_second = to_first;
                   first = square;
                   to_first = offset;
                 } else if (square < second) {
                   second = square;
                   to_second = offset;
                 }
               });
  const auto distance = [&](double square, const Vec3& offset) {
    HeightSample sample{.value = std::sqrt(square)};
    if (sample.value > 0) sample.gradient = offset / sample.value;
    return sample;
  };
  if (!(second < std::numeric_limits<double>::infinity())) return {};
  HeightSample result = distance(first, to_first);
  if (kind_ == CellularKind::f2_minus_f1) {
    const HeightSample further = distance(second, to_second);
    result = {further.value - result.value, further.gradient - result.gradient};
  }
  const double scale = share * kEdge;  // height of a distance of one cell's edge
  const double slope = scale / edge;
  return {scale * result.value, slope * result.gradient, kind_ == CellularKind::f1 ? slope : 2 * slope};
}

WaveHeight::WaveHeight(std::vector<Wave> waves) : waves_(std::move(waves)), used_(waves_.size()) {
  std::stable_sort(waves_.begin(), waves_.end(),
                   [](const Wave& a, const Wave& b) { return std::abs(a.amplitude) > std::abs(b.amplitude); });
  shortest_ = std::numeric_limits<double>::infinity();
  for (const Wave& wave : waves_) {
    amplitude_ += std::abs(wave.amplitude);
    shortest_ = std::min(shortest_, 2 * pi / wave.number.norm());
  }
  measure();
}

/// Sums what the waves reach where their phases agree, and limits it to what is hardly ever passed.
void WaveHeight::measure() {
  double sum = 0, squares = 0, slopes = 0;
  for (std::size_t i = 0; i < used_; ++i) {
    const double amplitude = std::abs(waves_[i].amplitude);
    sum += amplitude;
    squares += amplitude * amplitude;
    slopes += amplitude * amplitude * waves_[i].number.squaredNorm();
  }
  range_.high = std::min(sum, kRare * std::sqrt(0.5 * squares));
  range_.low = -range_.high;
  // The sum of the slopes along a direction is largest along one of these, or 2 % less: a spiral on a hemisphere.
  constexpr int kOnSpiral = 200;
  constexpr double kGoldenAngle = 2.399963229728653, kBetween = 1.02;
  double steepest = 0;
  for (int i = 0; i < kOnSpiral; ++i) {
    const double z = (i + 0.5) / kOnSpiral, around = std::sqrt(1 - z * z);
    const Vec3 direction(around * std::cos(kGoldenAngle * i), around * std::sin(kGoldenAngle * i), z);
    double along = 0;
    for (std::size_t w = 0; w < used_; ++w) along += std::abs(waves_[w].amplitude * waves_[w].number.dot(direction));
    steepest = std::max(steepest, along);
  }
  steepest_ = std::min(kBetween * steepest, kRare * std::sqrt(0.5 * slopes));
}

WaveHeight WaveHeight::pink(double rms, double longest, double shortest, int count, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> angle(0, 2 * pi);
  std::vector<Wave> waves;
  for (int i = 0; i < count; ++i) {
    const double share = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
    const double wavelength = longest * std::pow(shortest / longest, share);
    Vec3 direction(normal(random), normal(random), normal(random));
    waves.push_back({.number = 2 * pi / wavelength * direction.normalized(),
                     .amplitude = rms * std::sqrt(2.0 / count),
                     .phase = angle(random)});
  }
  return WaveHeight(std::move(waves));
}

std::vector<Knob> WaveHeight::knobs() const {
  const auto all = static_cast<double>(waves_.size());
  if (waves_.size() < 4) return {};
  return {{"waves", "", {std::ceil(all / 4), std::ceil(all / 2), all}, static_cast<double>(used_), 1, all}};
}

void WaveHeight::set(const std::string& knob, double level) {
  if (knob != "waves") return;
  used_ = static_cast<std::size_t>(std::lround(level));
  measure();
}

HeightSample WaveHeight::at(const Vec3& place, double finest) const noexcept {
  HeightSample sum;
  for (std::size_t i = 0; i < used_; ++i) {
    const Wave& wave = waves_[i];
    const double share =
        finest > shortest_ ? wave.amplitude * fade(2 * pi / wave.number.norm(), finest) : wave.amplitude;
    const double angle = wave.number.dot(place) + wave.phase;
    sum.value += share * std::cos(angle);
    sum.gradient -= share * std::sin(angle) * wave.number;
  }
  sum.steepest = steepest_;
  return sum;
}

}  // namespace haptrace
