#include "studies/needed_force.h"

#include "control/path/min_jerk.h"
#include "devices/sim/sim_device.h"
#include "studies/ensemble_draw.h"

#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

TEST(NeededForce, IsTheSumOfTheForcesForMassGravityAndFriction) {
  SimSpec spec;
  spec.rotation = Vec3(0, 0, std::numbers::pi / 2);  // the actuators' x is -y, their y is x
  spec.mass = Vec3(0.2, 0.5, 0.3);
  spec.viscous = Vec3(1, 2, 3);
  spec.coulomb = Vec3(0.7, 0.4, 0.9);
  spec.gravity_bias = Vec3(0.1, 0.2, -1);
  spec.gravity_gradient(2, 2) = -20;
  constexpr double kRate = 1000, kSpeed = 0.1, kPush = 0.4;
  NeededForce steady(spec, kRate), faster(spec, kRate);
  Vec3 along, up;
  for (int k = 0; k <= 1000; ++k) {
    const double t = k / kRate;
    along = steady.update(Vec3(kSpeed * t, 0, 0.01));
    up = faster.update(Vec3(0, 0, 0.5 * kPush * t * t));
  }
  EXPECT_TRUE(along.isApprox(Vec3(kSpeed * 2 + 0.4 - 0.1, -0.2, 1 + 20 * 0.01), 1e-6)) << along.transpose();
  EXPECT_NEAR(up.z(), 0.3 * kPush + 3 * kPush + 0.9 + 1 + 20 * 0.5 * kPush, 2e-3);
}

TEST(NeededForce, MatchesTheForceThatMakesADeviceInAHandFollowExactly) {
  for (const std::uint64_t index : {0U, 5U, 9U}) {
    SimSpec spec = draw_device(1, index).spec;
    ASSERT_TRUE(spec.hand);
    spec.hand->tremor = spec.hand->drift = 0;
    spec.delay = spec.actuator_bandwidth_hz = spec.position_resolution = spec.force_resolution = 0;
    spec.presliding_stiffness.setZero();  // bristles deflect late where an axis reverses
    spec.max_force = 1e3;
    SimDevice device(spec);
    constexpr double kRate = 10000, kPeriod = 1 / kRate, kTurn = 1;  // a circle in 1 s
    NeededForce needed(spec, kRate);
    Vec3 force = Vec3::Zero(), before = Vec3::Zero(), sent = Vec3::Zero(), asked = Vec3::Zero();
    double most = 0, squares = 0;
    int count = 0;
    for (int k = 0; k < static_cast<int>(1.5 * kTurn * kRate); ++k) {
      DeviceState state;
      ASSERT_EQ(device.exchange({.force = force}, k == 0 ? 0 : kPeriod, state), Device::Status::ok);
      const double angle = 2 * std::numbers::pi * MinJerk::at(k / kRate / kTurn).s;
      const Vec3 wanted = 0.03 * Vec3(1 - std::cos(angle), std::sin(angle), 0.5 * std::sin(angle));
      const Vec3 error = wanted - state.position;
      force = 2e5 * error + 400 * (error - before) / kPeriod;
      before = error;
      // A low pass of 5 ms removes the ripple of the tracking law from both forces.
      constexpr double kBlend = 0.02;
      sent += kBlend * (force - sent);
      asked += kBlend * (needed.update(wanted) - asked);
      most = std::max(most, asked.norm());
      if (angle < 0.1 || angle > 6.2) continue;
      squares += (sent - asked).squaredNorm();
      ++count;
    }
    EXPECT_GT(most, 4);
    EXPECT_LT(std::sqrt(squares / count), 0.3) << "draw " << index << ", at most " << most << " N";
  }
}

}  // namespace
}  // namespace haptrace
