// Random numbers that do not depend on the standard library's distributions.
#pragma once

#include "base/types.h"

#include <cmath>
#include <cstdint>
#include <numbers>

namespace haptrace {

/// Generator of uniform bits: SplitMix64 (Steele, Lea and Flood 2014).
///
/// Real-time safe.
class SplitMix64 {
 public:
  /// Generators with equal seeds and different `stream` are independent.
  SplitMix64(std::uint64_t seed, std::uint64_t stream) noexcept : state_(seed) { state_ = next() + stream * kGamma2; }

  std::uint64_t next() noexcept {
    std::uint64_t z = state_ += kGamma;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }

  /// Returns a uniform number in [-1, 1).
  double symmetric() noexcept { return static_cast<double>(static_cast<std::int64_t>(next())) * 0x1p-63; }

  /// Returns a uniform number in [low, high].
  double between(double low, double high) noexcept {
    return low + (high - low) * (static_cast<double>(next() >> 11) * 0x1p-53);
  }

 private:
  static constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15, kGamma2 = 0xd1342543de82ef95;

  std::uint64_t state_;
};

/// Generator of normal deviates of variance 1, by Marsaglia's polar method (1964).
///
/// Real-time safe.
class Gaussian {
 public:
  /// Generators with equal seeds and different `stream` are independent.
  Gaussian(std::uint64_t seed, std::uint64_t stream) noexcept : bits_(seed, stream) {}

  double operator()() noexcept {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double u, v, s;
    do {
      u = bits_.symmetric();
      v = bits_.symmetric();
      s = u * u + v * v;
    } while (s >= 1 || s == 0);
    const double r = std::sqrt(-2 * std::log(s) / s);
    spare_ = v * r;
    has_spare_ = true;
    return u * r;
  }

  Vec3 vector() noexcept {
    const double x = (*this)(), y = (*this)();
    return {x, y, (*this)()};
  }

 private:
  SplitMix64 bits_;
  double spare_ = 0;
  bool has_spare_ = false;
};

/// White noise through a filter of one pole, or of two equal sections with two poles each, on three axes, starting at
/// rest. It is scaled to the requested rms.
///
/// Real-time safe after construction.
class ColouredNoise {
 public:
  static ColouredNoise low_pass(double rms, double cutoff_hz, double rate_hz) {
    const double w = 2 * std::numbers::pi * cutoff_hz / rate_hz, alpha = std::sin(w) / std::numbers::sqrt2;
    const double half = 0.5 * (1 - std::cos(w));
    return {rms, {half, 2 * half, half}, {1 + alpha, -2 * std::cos(w), 1 - alpha}};
  }

  /// One pole, with its -3 dB edge at `corner_hz`.
  static ColouredNoise first_order(double rms, double corner_hz, double rate_hz) {
    const double pole = std::exp(-2 * std::numbers::pi * corner_hz / rate_hz);
    return {rms, {1 - pole, 0, 0}, {1, -pole, 0}, 1};
  }

  /// Sets the -3 dB edges of one section to those of the band.
  static ColouredNoise band_pass(double rms, double low_hz, double high_hz, double rate_hz) {
    const double center_hz = std::sqrt(low_hz * high_hz);
    const double w = 2 * std::numbers::pi * center_hz / rate_hz,
                 alpha = std::sin(w) * (high_hz - low_hz) / center_hz / 2;
    return {rms, {alpha, 0, -alpha}, {1 + alpha, -2 * std::cos(w), 1 - alpha}};
  }

  Vec3 next(Gaussian& gaussian) noexcept { return gain_ == 0 ? Vec3::Zero() : Vec3(gain_ * filter(gaussian.vector())); }

 private:
  struct Section {
    Vec3 s1 = Vec3::Zero(), s2 = Vec3::Zero();  // transposed direct form II
  };

  ColouredNoise(double rms, const Vec3& b, const Vec3& a, std::size_t sections = 2)
      : b_(b / a[0]), a_(a / a[0]), used_(sections) {
    if (rms == 0) return;
    // The variance of filtered white noise is the energy of the impulse response, which has decayed by then.
    constexpr int kLongest = 5000;
    double energy = 0;
    for (int i = 0; i < kLongest; ++i) {
      const double response = filter(i == 0 ? Vec3(1, 0, 0) : Vec3::Zero()).x();
      energy += response * response;
    }
    for (Section& section : sections_) section = {};
    gain_ = rms / std::sqrt(energy);
  }

  Vec3 filter(Vec3 x) noexcept {
    for (std::size_t i = 0; i < used_; ++i) {
      Section& section = sections_[i];
      const Vec3 y = b_[0] * x + section.s1;
      section.s1 = b_[1] * x - a_[1] * y + section.s2;
      section.s2 = b_[2] * x - a_[2] * y;
      x = y;
    }
    return x;
  }

  Vec3 b_, a_;
  Section sections_[2];
  std::size_t used_;
  double gain_ = 0;
};

}  // namespace haptrace
