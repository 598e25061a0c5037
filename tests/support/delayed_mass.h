// The plant that the tracking law reckons with, in the open: tests see its truth.
#pragma once

#include "base/types.h"
#include "control/design/plant_model.h"

#include <cmath>
#include <deque>

namespace haptrace::test {

inline constexpr double kPeriod = 1e-3;  ///< of the loops that these tests close [s]
const Vec3 kNone = Vec3::Zero();

/// Two ticks late.
inline PlantModel late_plant(double resolution = 0) {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.4, 0.3);
  plant.delay = 2 * kPeriod;
  plant.position_resolution = resolution;
  return plant;
}

/// m x'' = u(t - delay) + load per axis, where u is held from its tick to the next. Closed form over each twentieth of
/// a tick, to which the delay is rounded: exact for loads that are constant in it.
class DelayedMass {
 public:
  DelayedMass(const Vec3& mass, double delay_ticks, double rate_hz = 1000)
      : mass_(mass),
        period_(1 / rate_hz),
        sent_(static_cast<std::size_t>(std::lround(delay_ticks * kSteps)), Vec3(0, 0, 0)) {}

  /// A tick under the force that is sent at its begin; `load(x, v)` [N].
  template <class Load>
  void advance(const Vec3& force, const Load& load) {
    for (int step = 0; step < kSteps; ++step) {
      sent_.push_back(force);
      const Vec3 a = (sent_.front() + load(x, v)).cwiseQuotient(mass_);
      sent_.pop_front();
      const double h = period_ / kSteps;
      x += h * v + 0.5 * h * h * a;
      v += h * a;
    }
  }
  void advance(const Vec3& force, const Vec3& load = Vec3::Zero()) {
    advance(force, [&](const Vec3&, const Vec3&) { return load; });
  }

  Vec3 x = Vec3::Zero();  ///< [m]
  Vec3 v = Vec3::Zero();  ///< [m/s]

 private:
  static constexpr int kSteps = 20;

  Vec3 mass_;
  double period_;
  std::deque<Vec3> sent_;  ///< oldest first
};

/// As an encoder reads it.
inline Vec3 quantised(const Vec3& position, double resolution) {
  return resolution > 0 ? Vec3(resolution * (position / resolution).array().round()) : position;
}

/// Friction that sticks and slides, smooth enough to be integrated [N].
inline Vec3 friction(const Vec3& velocity, double coulomb, double viscous = 0) {
  return -(coulomb * (velocity.array() / 1e-3).tanh() + viscous * velocity.array()).matrix();
}

}  // namespace haptrace::test
