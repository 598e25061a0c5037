// Interface of textures: a height over a surface.
#pragma once

#include "base/types.h"
#include "scene/knob.h"

#include <algorithm>

namespace haptrace {

/// A height and its gradient in space.
struct HeightSample {
  double value = 0;              ///< [m]
  Vec3 gradient = Vec3::Zero();  ///< d value / d place, exact
  double steepest = 0;           ///< bound of |gradient| at all places of this scale, however a wave's phase is there
};

/// The heights that are to be expected anywhere [m].
struct HeightRange {
  double low = 0, high = 0;
};

/// A height as a function of the place in the shape's frame. Only its values on the surface matter.
///
/// Real-time and free of state: at.
class Height : public Adjustable {
 public:
  /// Prepares after changes of settings.
  virtual void prepare() {}

  /// Returns the height at a place. Parts with a wavelength below `finest` [m] are faded by fade().
  [[nodiscard]] virtual HeightSample at(const Vec3& place, double finest) const noexcept = 0;

  /// Returns a bound of |value|, or the typical amplitude where there is none [m].
  [[nodiscard]] virtual double amplitude() const noexcept = 0;
  /// Returns the largest height that is to be expected anywhere, where amplitude() is typical or was sampled: contacts
  /// begin at this distance in front of the shape [m].
  [[nodiscard]] virtual double highest() const noexcept { return amplitude(); }
  /// Returns the range of heights, which is at most about twice that of a long stroke: the guard against vibration is
  /// told its half.
  [[nodiscard]] virtual HeightRange range() const noexcept { return {-amplitude(), amplitude()}; }
  /// Returns the shortest wavelength that carries a considerable part of it [m].
  [[nodiscard]] virtual double wavelength() const noexcept = 0;

 protected:
  /// Returns the share of a part that stays: 1 from `finest` on, 0 up to half of it.
  [[nodiscard]] static double fade(double wavelength, double finest) noexcept {
    if (!(finest > wavelength)) return 1;
    const double t = std::max(0.0, 2 * wavelength / finest - 1);
    return t * t * (3 - 2 * t);
  }
};

}  // namespace haptrace
