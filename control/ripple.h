// What of a signal in space is faster than a cut-off.
#pragma once

#include "base/types.h"
#include "control/filters.h"

#include <array>

namespace haptrace {

/// A fourth-order Linkwitz-Riley high pass (two equal Butterworth sections) of each axis.
///
/// Real-time: all but the constructor.
class Ripple {
 public:
  Ripple(double cutoff_hz, double rate_hz) : sections_(filled(cutoff_hz, rate_hz)) {}

  /// The squared magnitude of what passes. To be called at every sample, so that it is settled when it counts.
  double update(const Vec3& x) noexcept {
    double sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double high =
          sections_[2 * axis + 1].update(sections_[2 * axis].update(x[static_cast<Eigen::Index>(axis)]));
      sum += high * high;
    }
    return sum;
  }

 private:
  static std::array<Butterworth2, 6> filled(double cutoff_hz, double rate_hz) {
    const Butterworth2 one(Butterworth2::Kind::high_pass, cutoff_hz, rate_hz);
    return {one, one, one, one, one, one};
  }

  std::array<Butterworth2, 6> sections_;
};

}  // namespace haptrace
