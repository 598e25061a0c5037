#include "scene/surface/texture/expression_height.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>

namespace haptrace {

ExpressionHeight::ExpressionHeight(Expression expression, const Mapping& mapping, double wavelength, double most)
    : expression_(std::move(expression)), mapping_(mapping), wavelength_(wavelength) {
  // Evenly spread, and in step with no wave: multiples of the plastic number (Roberts 2018).
  constexpr double kFirst = 0.7548776662466927, kSecond = 0.5698402909980532;
  constexpr int kSamples = 40'000;
  bool anywhere = false;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int i = 0; i < kSamples; ++i) {
    const double u = kReach * (2 * std::fmod(0.5 + kFirst * i, 1) - 1);
    const double v = kReach * (2 * std::fmod(0.5 + kSecond * i, 1) - 1);
    const Slope slope = expression_.slope({u, v, 0});
    const double height = std::abs(slope.value);
    if (!std::isfinite(height)) continue;
    anywhere = true;
    low = std::min(low, slope.value);
    high = std::max(high, slope.value);
    if (const double steep = std::hypot(slope.gradient[0], slope.gradient[1]); std::isfinite(steep))
      steepest_ = std::max(steepest_, steep);
    if (height > most)
      throw input_error(fmt::format(
          "the height is {:.3g} m at u = {:.3g}, v = {:.3g} m; at most {:g} m are possible. Heights, u and v "
          "are in metres",
          height, u, v, most));
    amplitude_ = std::max(amplitude_, height);
  }
  if (!anywhere) throw input_error(fmt::format("the height is not a number at any u and v within {:g} m", kReach));
  // The samples may miss the extremes by a little. The gradients of u and v on a cube meet at an angle of which the
  // cosine is up to 1/2.
  constexpr double kMissedHeight = 1.02, kMissedSlope = 1.1;
  const double middle = 0.5 * (low + high), half = kMissedHeight * 0.5 * (high - low);
  range_ = {middle - half, middle + half};
  steepest_ *= kMissedSlope * (mapping_.kind == MappingKind::cube ? std::sqrt(1.5) : 1);
}

HeightSample ExpressionHeight::at(const Vec3& place, double finest) const noexcept {
  const MappedPlace mapped = mapping_.at(place);
  const double size = mapping_.size;
  // The mapping stretches the texture: a wave is shorter where u and v change faster than the place.
  const double fastest = size * std::max(mapped.du.norm(), mapped.dv.norm());
  const double share = fastest > 0 ? fade(wavelength_ / fastest, finest) : 0;
  if (share == 0) return {};
  const Slope slope = expression_.slope({size * mapped.u, size * mapped.v, 0});
  HeightSample sample{share * slope.value,
                      share * size * (slope.gradient[0] * mapped.du + slope.gradient[1] * mapped.dv),
                      share * steepest_ * fastest};
  if (!std::isfinite(sample.value) || !is_finite(sample.gradient)) return {};
  return sample;
}

}  // namespace haptrace
