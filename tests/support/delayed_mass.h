// The plant that the tracking law models; tests have access to its true state.
#pragma once

#include "base/types.h"
#include "control/controller.h"
#include "control/design/plant_model.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <gtest/gtest.h>

namespace haptrace::test {

inline constexpr double kPeriod = 1e-3;  ///< period of the test loops [s]
const Vec3 kNone = Vec3::Zero();

/// Returns a plant with a delay of two ticks.
inline PlantModel late_plant(double resolution = 0) {
  PlantModel plant;
  plant.mass = Vec3(0.4, 0.4, 0.3);
  plant.delay = 2 * kPeriod;
  plant.position_resolution = resolution;
  return plant;
}

/// m x'' = u(t - delay) + load per axis, with u held between ticks. Each twentieth of a tick is solved in closed form,
/// exact for loads that are constant in it. The delay is rounded to twentieths of a tick.
class DelayedMass {
 public:
  DelayedMass(const Vec3& mass, double delay_ticks, double rate_hz = 1000)
      : mass_(mass),
        period_(1 / rate_hz),
        sent_(static_cast<std::size_t>(std::lround(delay_ticks * kSteps)), Vec3(0, 0, 0)) {}

  /// Advances by a tick. `force` is sent at its start; `load(x, v)` returns the load [N].
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

/// Returns a position as an encoder measures it.
inline Vec3 quantised(const Vec3& position, double resolution) {
  return resolution > 0 ? Vec3(resolution * (position / resolution).array().round()) : position;
}

/// Returns a smooth approximation of sliding and sticking friction [N].
inline Vec3 friction(const Vec3& velocity, double coulomb, double viscous = 0) {
  return -(coulomb * (velocity.array() / 1e-3).tanh() + viscous * velocity.array()).matrix();
}

inline Reference resting_at(const Vec3& position) {
  return {position, kNone, kNone, 0};
}

/// Returns how far a loop goes beyond a target 30 mm away, after a hand has held the device for `held` [s]; in metres.
/// A loop has `held`, `plant`, run() and tick().
template <class Loop>
double overshoot_after(Loop& loop, double held) {
  const Reference there = resting_at(Vec3(0.03, 0, 0));
  loop.held = true;
  loop.run(held, there);
  loop.held = false;
  double farthest = 0;
  for (int i = 0; i < 3000; ++i) {
    loop.tick(there);
    farthest = std::max(farthest, loop.plant.x.x());
  }
  EXPECT_NEAR(loop.plant.x.x(), 0.03, 1e-4);
  return farthest - 0.03;
}

}  // namespace haptrace::test
