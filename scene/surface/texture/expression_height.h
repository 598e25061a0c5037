// Textures stated by a formula.
#pragma once

#include "scene/expression.h"
#include "scene/surface/texture/height.h"
#include "scene/surface/texture/mapping.h"

namespace haptrace {

/// The height [m] of an expression in u and v [m]: the lengths on the flat texture, which a mapping puts onto the
/// shape. Where it is not finite, the height is 0.
class ExpressionHeight final : public Height {
 public:
  static constexpr double kReach =
      0.1;  ///< u and v from -kReach to kReach are sampled for the amplitude and the slope [m]

  /// `wavelength`: the shortest one that matters [m]. Throws Error(input) where the height is above `most` [m].
  ExpressionHeight(Expression expression, const Mapping& mapping, double wavelength, double most);

  [[nodiscard]] HeightSample at(const Vec3& place, double finest) const noexcept override;
  [[nodiscard]] double amplitude() const noexcept override { return amplitude_; }
  [[nodiscard]] HeightRange range() const noexcept override { return range_; }
  [[nodiscard]] double wavelength() const noexcept override { return wavelength_; }

 private:
  Expression expression_;
  Mapping mapping_;
  double wavelength_, amplitude_ = 0;
  double steepest_ = 0;  ///< slope over u and v
  HeightRange range_;
};

}  // namespace haptrace
