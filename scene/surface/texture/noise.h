// Textures computed from a random lattice.
#pragma once

#include "scene/surface/texture/height.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace haptrace {

/// Returns Perlin's gradient noise (2002) at a place in units of the lattice step, and its gradient. Zero at lattice
/// points; within -1 and 1. Real-time.
HeightSample perlin_noise(const Vec3& place, std::uint64_t seed) noexcept;

struct NoiseSpec {
  double amplitude = 1e-4;   ///< bound of the height [m]
  double wavelength = 2e-3;  ///< lattice step, of the first octave [m]
  std::uint64_t seed = 0;
};

/// Perlin noise.
class PerlinHeight final : public Height {
 public:
  explicit PerlinHeight(const NoiseSpec& spec) : spec_(spec) {}
  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return spec_.amplitude; }
  [[nodiscard]] double wavelength() const noexcept override { return spec_.wavelength; }

 private:
  NoiseSpec spec_;
};

enum class FractalKind : std::uint8_t { fbm, ridged, turbulence };

/// A sum of octaves of Perlin noise, each of half the wavelength of the one before: fractional Brownian motion, whose
/// spectrum along a line falls with the exponent -(2 H + 1), or the sum of their ridges or magnitudes (Ebert et al.,
/// Texturing and Modeling). Magnitudes are rounded by a twentieth, so that the gradient has no jumps.
class FractalHeight final : public Height {
 public:
  static constexpr int kMostOctaves = 12;
  FractalHeight(const NoiseSpec& spec, FractalKind kind, int octaves, double hurst);
  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return spec_.amplitude; }
  [[nodiscard]] double wavelength() const noexcept override;
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;
  [[nodiscard]] HeightRange range() const noexcept override { return range_; }

 private:
  NoiseSpec spec_;
  FractalKind kind_;
  int octaves_;
  double hurst_;
  double scale_ = 0;  ///< amplitude of the first octave [m]
  HeightRange range_;
};

/// Random spots on a Poisson process (van Wijk 1991): each a cosine bump of a random sign.
class SpotHeight final : public Height {
 public:
  /// `spec.wavelength` is the diameter of a spot, `density` the mean number of spots in a cube of that edge.
  SpotHeight(const NoiseSpec& spec, double density);
  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return spec_.amplitude; }
  [[nodiscard]] double highest() const noexcept override;
  [[nodiscard]] HeightRange range() const noexcept override { return {-1.2 * highest(), 1.2 * highest()}; }
  [[nodiscard]] double wavelength() const noexcept override { return spec_.wavelength; }

 private:
  NoiseSpec spec_;
  double density_;
  double steepest_;  ///< of the amplitude over the wavelength
};

enum class CellularKind : std::uint8_t { f1, f2_minus_f1 };

/// Distance to the nearest point of a Poisson process, or the difference to the second nearest (Worley 1996).
/// `spec.wavelength` is the edge of a cube that holds one point on average; `spec.amplitude` the height of a distance
/// of that length. The setting `cells` is the number of cells that are searched: 27, or the 8 nearest ones.
class CellularHeight final : public Height {
 public:
  CellularHeight(const NoiseSpec& spec, CellularKind kind, int cells);
  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return spec_.amplitude; }
  [[nodiscard]] double highest() const noexcept override;
  [[nodiscard]] HeightRange range() const noexcept override { return {0, highest()}; }
  [[nodiscard]] double wavelength() const noexcept override { return spec_.wavelength; }
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  NoiseSpec spec_;
  CellularKind kind_;
  int cells_;
};

/// A sum of plane waves: height = sum a cos(k.x + p).
class WaveHeight final : public Height {
 public:
  struct Wave {
    Vec3 number = Vec3::Zero();  ///< k [rad/m]
    double amplitude = 0;        ///< a [m]
    double phase = 0;            ///< p [rad]
  };
  explicit WaveHeight(std::vector<Wave> waves);

  /// Returns waves with a spectrum of 1/f along a line, between two wavelengths [m]: equal amplitudes, wavelengths
  /// evenly spaced in their logarithm, random directions and phases (Saupe 1988, spectral synthesis). `rms` of the
  /// height [m].
  static WaveHeight pink(double rms, double longest, double shortest, int waves, std::uint64_t seed);

  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return amplitude_; }
  [[nodiscard]] HeightRange range() const noexcept override { return range_; }
  [[nodiscard]] double wavelength() const noexcept override { return shortest_; }
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  void measure();

  std::vector<Wave> waves_;
  std::size_t used_;  ///< waves that count, the strongest first
  double amplitude_ = 0, shortest_ = 0;
  double steepest_ = 0;  ///< of the waves that count
  HeightRange range_;    ///< of the waves that count
};

}  // namespace haptrace
