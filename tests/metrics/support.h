// Movements for the tests of metrics.
#pragma once

#include "base/types.h"
#include "control/path/min_jerk.h"

#include <cmath>
#include <functional>
#include <random>
#include <vector>

namespace haptrace::test {

/// Samples of a movement.
struct Sampled {
  std::vector<double> time;
  std::vector<Vec3> position, force;
};

struct Sampling {
  double rate_hz = 1000;
  double jitter = 0;  ///< Jitter of every step, as a share of it.
  double count = 0;   ///< Encoder resolution to which positions are rounded; 0: none [m].
  double start = 0;   ///< First stamp [s].
};

inline Sampled sampled(double duration, const std::function<Vec3(double)>& position,
                       const std::function<Vec3(double)>& force, const Sampling& sampling = {}) {
  Sampled result;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> jitter(1 - sampling.jitter, 1 + sampling.jitter);
  for (double t = 0; t <= duration + 1e-9; t += jitter(random) / sampling.rate_hz) {
    Vec3 p = position(t);
    if (sampling.count > 0) p = sampling.count * (p / sampling.count).array().round().matrix();
    result.time.push_back(sampling.start + t);
    result.position.push_back(p);
    result.force.push_back(force(t));
  }
  return result;
}

/// A hand's reach of some 20 cm: three overlapping strokes in different directions (Flash and Henis 1991) and a fourth
/// after a pause, with rest before and after.
struct Reach {
  static constexpr double kDuration = 3;

  static Vec3 position(double t) {
    return stroke(t, 0.5, 0.7, {0.12, 0.02, 0.0}) + stroke(t, 1.0, 0.5, {0.02, 0.06, 0.01}) +
           stroke(t, 1.35, 0.5, {-0.01, 0.02, 0.03}) + stroke(t, 2.1, 0.5, {0.03, 0.0, -0.02});
  }
  static Vec3 velocity(double t) { return (position(t + 1e-5) - position(t - 1e-5)) / 2e-5; }

  /// Returns the force of a spring towards a line, a damper and a constant push [N].
  static Vec3 force(double t) {
    const Vec3 p = position(t);
    return Vec3(0.4, -40 * p.y(), 0.2) - 1.5 * velocity(t);
  }

 private:
  static Vec3 stroke(double t, double start, double duration, const Vec3& by) {
    return MinJerk::at((t - start) / duration).s * by;
  }
};

inline Sampled reach(const Sampling& sampling = {}) {
  return sampled(Reach::kDuration, Reach::position, Reach::force, sampling);
}

}  // namespace haptrace::test
