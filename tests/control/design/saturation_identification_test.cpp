#include "control/design/saturation_identification.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr double kLoopRate = 1000;

/// A device in a hand, under pulses along each axis in turn. Its own simulation, in steps of 10 us.
struct PulsedBench {
  double mass = 0.3, coulomb = 0.6, viscous = 1.5;
  Vec3 gravity{0.5, -1.2, 0.4};
  double motors = 100;  ///< magnitude at which they saturate [N]
  double most = 6;      ///< largest force that is sent [N]
  double delay = 2e-3, quantum = 5e-5;
  double cable = 0;                          ///< amplitude of a force with a period of 3 mm [N]
  double backlash = 0, handle = 0;           ///< width between motor and handle [m]; mass of the handle [kg]
  double hand = 0.15, grip = 500, damp = 5;  ///< mass, stiffness and damping of the hand and its grip
  std::array<bool, 3> axes{true, true, true};

  std::vector<TickRow> rows;
  std::array<std::vector<Stretch>, 3> pulsed;

  PulsedBench& run() {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!axes[axis]) continue;
      const std::size_t begin = rows.size();
      for (int k = 0; k < 1400; ++k) tick(static_cast<int>(axis), k / kLoopRate);
      pulsed[axis].push_back({begin + 200, rows.size()});
    }
    return *this;
  }

  [[nodiscard]] Experiment experiment() const {
    return {
        .rows = rows, .rate_hz = kLoopRate, .axes = axes, .dithered = {}, .places = {}, .sweeps = {}, .pulsed = pulsed};
  }

  [[nodiscard]] MotorLimit found() const { return identify_motor_limit(experiment()); }

 private:
  struct Body {
    Vec3 x = Vec3::Zero(), v = Vec3::Zero();
  };

  void tick(int axis, double t) {
    Vec3 seen = motor_.x;
    if (quantum > 0)
      for (double& value : seen) value = quantum * std::round(value / quantum);
    const double w = 2 * std::numbers::pi * 2.5;
    Vec3 wanted = Vec3::Zero(), speed = Vec3::Zero();
    wanted[axis] = 0.005 * std::sin(w * t);
    speed[axis] = 0.005 * w * std::cos(w * t);
    Vec3 force = 1200 * (wanted - seen) + 25 * (speed - motor_.v);
    const double size = t < 0.2 ? 0 : t < 0.6 ? 0.4 : t < 1 ? 0.7 : 1;
    force[axis] += (std::fmod(t, 0.024) < 0.012 ? 0.7 : -0.7) * most * size;
    if (const double magnitude = force.norm(); magnitude > most) force *= most / magnitude;
    rows.push_back({static_cast<double>(rows.size()) / kLoopRate, seen, force});
    sent_.push_back(force);
    if (sent_.size() > 20) sent_.pop_front();
    constexpr int kSteps = 100;
    for (int step = 0; step < kSteps; ++step) advance(step, 1 / kLoopRate / kSteps);
  }

  void advance(int step, double h) {
    const auto late = static_cast<std::size_t>(std::ceil((delay - (step + 0.5) * h) * kLoopRate));
    Vec3 u = late < sent_.size() ? sent_[sent_.size() - 1 - late] : Vec3(Vec3::Zero());
    if (const double size = u.norm(); size > motors) u *= motors / size;
    for (int i = 0; i < 3; ++i) {
      const double held = handle > 0 ? handle_.x[i] : motor_.x[i], moving = handle > 0 ? handle_.v[i] : motor_.v[i];
      const double of_hand = hand > 0 ? grip * (held - hand_.x[i]) + damp * (moving - hand_.v[i]) : 0;
      double on_motor = u[i] + gravity[i] + cable * std::sin(2 * std::numbers::pi * motor_.x[i] / 3e-3);
      if (handle > 0) {
        const double apart = motor_.x[i] - handle_.x[i], gap = 0.5 * backlash;
        const double stretch = apart - std::clamp(apart, -gap, gap);
        const double link = stretch == 0 ? 0 : 5e4 * stretch + 8 * (motor_.v[i] - handle_.v[i]);
        handle_.v[i] += h / handle * (link - of_hand);
        handle_.x[i] += h * handle_.v[i];
        on_motor -= link;
      } else {
        on_motor -= of_hand;
      }
      if (hand > 0) {
        hand_.v[i] += h / hand * (of_hand - 30 * hand_.x[i] - 2 * hand_.v[i]);
        hand_.x[i] += h * hand_.v[i];
      }
      const double free = motor_.v[i] + h / mass * (on_motor - viscous * motor_.v[i]);
      motor_.v[i] = std::copysign(std::max(std::abs(free) - h / mass * coulomb, 0.0), free);
      motor_.x[i] += h * motor_.v[i];
    }
  }

  Body motor_, handle_, hand_;
  std::deque<Vec3> sent_;
};

TEST(SaturationIdentification, FindsTheForceAtWhichMotorsSaturateWithinItsInterval) {
  for (const double motors : {2.5, 3.3, 4.1, 4.9}) {
    PulsedBench bench;
    bench.motors = motors;
    const MotorLimit found = bench.run().found();
    EXPECT_NEAR(found.force, motors, found.half_width) << motors;
    EXPECT_LT(found.half_width, 0.15 * motors) << motors;
    EXPECT_NEAR(found.tried, bench.most, 0.01) << motors;
  }
}

TEST(SaturationIdentification, FindsItWithoutAHandAndOnADeviceOfTwoAxes) {
  PulsedBench bench;
  bench.hand = 0;
  bench.motors = 3.5;
  bench.axes = {true, true, false};
  bench.gravity.z() = 0;
  const MotorLimit found = bench.run().found();
  EXPECT_NEAR(found.force, 3.5, found.half_width);
}

TEST(SaturationIdentification, FindsNoneOnMotorsThatGiveAllThatIsAsked) {
  std::array<PulsedBench, 8> all;
  all[1].hand = 0;
  all[2].quantum = 2e-4;
  all[3].delay = 5e-3;
  all[4].coulomb = 1.5;
  all[5].cable = 1;
  all[6].backlash = 2e-4;
  all[6].handle = 0.15;
  all[7].backlash = 1e-3;
  all[7].handle = 0.15;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const MotorLimit found = all[i].run().found();
    EXPECT_EQ(found.force, 0) << i;
    EXPECT_NEAR(found.tried, all[i].most, 0.01) << i;
  }
}

TEST(SaturationIdentification, FindsNoneAboveTheForceThatWasTried) {
  PulsedBench bench;
  bench.motors = 5.9;
  EXPECT_EQ(bench.run().found().force, 0);
}

TEST(SaturationIdentification, TriesNothingWithoutPulses) {
  const MotorLimit found = identify_motor_limit(Experiment{.rows = {}, .dithered = {}, .places = {}, .sweeps = {}});
  EXPECT_EQ(found.tried, 0);
  EXPECT_EQ(found.force, 0);
}

TEST(SaturationIdentification, ShortensOnlyForcesThatAreLongerThanTheLimit) {
  std::vector<TickRow> rows{{0, Vec3::Zero(), Vec3(3, 0, 4)}, {0.001, Vec3::Zero(), Vec3(0, 1, 0)}};
  shorten_forces(rows, 2.5);
  EXPECT_TRUE(rows[0].force.isApprox(Vec3(1.5, 0, 2)));
  EXPECT_EQ(rows[1].force, Vec3(0, 1, 0));
}

}  // namespace
}  // namespace haptrace
