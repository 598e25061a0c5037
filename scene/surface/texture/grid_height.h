// Textures from a grid of heights: images and computed patterns.
#pragma once

#include "scene/surface/texture/height.h"
#include "scene/surface/texture/mapping.h"

#include <cstdint>
#include <vector>

namespace haptrace {

/// Heights on a grid, row by row. u grows with the column, v with the row; both wrap.
struct HeightGrid {
  int columns = 0, rows = 0;
  std::vector<float> values;  ///< -1 to 1

  [[nodiscard]] float at(int column, int row) const noexcept {
    return values[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column)];
  }
};

/// A grid that is mapped onto the shape. Between its points the height is bicubic (Catmull and Rom), with a continuous
/// gradient, or bilinear, whose gradient jumps from cell to cell.
///
/// Settings: `order` 1 or 3; `texels`, the largest number of columns and rows, to which the grid is averaged.
class GridHeight final : public Height {
 public:
  /// `amplitude` [m] is the height of the value 1.
  GridHeight(HeightGrid grid, const Mapping& mapping, double amplitude);

  void prepare() override;
  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return amplitude_; }
  /// Cubic interpolation overshoots: its weights add up to at most 1.25 in magnitude, along each side.
  [[nodiscard]] double highest() const noexcept override { return (order_ == 1 ? 1 : 1.25 * 1.25) * amplitude_; }
  [[nodiscard]] HeightRange range() const noexcept override { return range_; }
  [[nodiscard]] double wavelength() const noexcept override { return wavelength_; }
  [[nodiscard]] std::vector<Knob> knobs() const override;
  void set(const std::string& knob, double level) override;

 private:
  HeightGrid whole_, used_;
  Mapping mapping_;
  double amplitude_;
  double wavelength_ = 0;
  double steepest_ = 0;  ///< height of the value 1: bound of the slope from texel to texel
  HeightRange range_;
  int order_ = 3;
  int texels_;
};

/// Returns the pattern of a reaction and diffusion of two substances (Gray and Scott 1984, as in Pearson 1993), on a
/// torus of `side` x `side` points after `steps` steps of time, scaled to -1 to 1. The same seed gives the same
/// pattern. Explicit Euler, stable up to a diffusion of 1/4 per step.
HeightGrid reaction_diffusion(int side, int steps, double feed, double kill, std::uint64_t seed);

}  // namespace haptrace
