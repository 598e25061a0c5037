// Laws of the forces of a reach: fields do no more work than their tank holds, and channels come, hold and go softly.
#include "control/reach_forces.h"

#include "control/velocity_estimator.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

constexpr double kReachTick = 1e-3;  // [s]
const ReachGeometry kAhead{.target = Vec3(0.1, 0, 0), .lateral = Vec3::UnitY()};

ReachForces::Options curl_of(double b) {
  return {.field = curl_field(b, Vec3::UnitZ())};
}

ReachForces::Options clamp_of(double stiffness) {
  return {.clamp = ClampOptions{.stiffness = stiffness, .damping = 0, .rise = 0.5}};
}

/// Holds a hand at a place with a velocity, for some time, and returns the last force.
Vec3 held(ReachForces& forces, const Vec3& position, const Vec3& velocity, double seconds, bool acts = true) {
  Vec3 force = Vec3::Zero();
  for (int i = 0; i < seconds / kReachTick; ++i)
    force = forces.update({.dt = kReachTick, .position = position, .velocity = velocity}, acts, 1, true);
  return force;
}

/// A free mass in a field, which acts on an estimate of the velocity that is 2 ms late. Returns its largest kinetic
/// energy in 3 s, less that at the start [J].
double energy_of_thrown_mass(const ReachForces::Options& options, ReachForces& forces) {
  constexpr double kMass = 0.2;  // [kg]
  const auto estimator = make_velocity_estimator("lowpass:100", 1 / kReachTick, 0);
  Vec3 position = Vec3::Zero(), velocity(0.3, 0, 0), sent = Vec3::Zero();
  double most = 0;
  for (int i = 0; i < 3000; ++i) {
    const State state{.dt = kReachTick,
                      .position = position,
                      .velocity = estimator->update(position, kReachTick),
                      .force_applied = sent};
    sent = forces.update(state, true, 1, true);
    const Vec3 before = velocity;
    velocity += kReachTick / kMass * sent;
    position += kReachTick * 0.5 * (before + velocity);
    most = std::max(most, 0.5 * kMass * velocity.squaredNorm());
  }
  EXPECT_LE(forces.given(), options.energy + 0.02);
  return most - 0.5 * kMass * 0.09;
}

TEST(ReachForces, ACurlFieldPushesAcrossTheMovementWithTheMatrixOfTheLiterature) {
  Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
  expected(0, 1) = 13;
  expected(1, 0) = -13;
  EXPECT_TRUE(curl_field(13, Vec3::UnitZ()).isApprox(expected));
  EXPECT_TRUE(plane_field(expected.topLeftCorner<2, 2>(), Vec3::UnitX(), Vec3::UnitY()).isApprox(expected));
  ReachForces forces(kAhead, curl_of(13));
  const Vec3 force = held(forces, Vec3::Zero(), Vec3(0.2, 0.1, 0), 1);
  EXPECT_NEAR(force.y(), -2.6, 1e-9) << "to the right of the movement";
  EXPECT_NEAR(force.dot(Vec3(0.2, 0.1, 0)), 0, 1e-12) << "no work";
}

TEST(ReachForces, PlacesTargetsAroundTheStart) {
  const auto targets = centre_out_targets(Vec3(0.01, 0, 0), 0.08, 8, 0, Vec3::UnitX(), Vec3::UnitY());
  ASSERT_EQ(targets.size(), 8U);
  EXPECT_TRUE(targets[0].isApprox(Vec3(0.09, 0, 0)));
  EXPECT_TRUE(targets[2].isApprox(Vec3(0.01, 0.08, 0)));
  EXPECT_TRUE(lateral_axis(Vec3::Zero(), targets[2], Vec3::UnitZ(), Vec3::UnitX()).isApprox(-Vec3::UnitX(), 0.2))
      << "the left of a reach ahead";
}

TEST(ReachForces, ACurlFieldOnALateVelocityAddsEnergyOnlyUpToItsTank) {
  ReachForces::Options usual = curl_of(15), large = curl_of(15);
  large.energy = 100;
  large.max_force = 100;
  usual.max_force = 100;
  usual.delay = large.delay = 0;
  ReachForces bounded(kAhead, usual), unbounded(kAhead, large);
  EXPECT_LE(energy_of_thrown_mass(usual, bounded), usual.energy + 0.02);
  EXPECT_GT(energy_of_thrown_mass(large, unbounded), 2 * usual.energy) << "the lag makes a free mass spin up";
}

TEST(ReachForces, AFieldThatPushesAlongTheMovementGivesNoMoreThanItsTank) {
  ReachForces::Options options{.field = 12 * Eigen::Matrix3d::Identity(), .max_force = 100, .delay = 0};
  ReachForces forces(kAhead, options);
  EXPECT_LE(energy_of_thrown_mass(options, forces), options.energy + 0.02);
  EXPECT_GT(forces.given(), 0.5 * options.energy);
}

TEST(ReachForces, AClampPushesBackToTheLineAndNotAlongIt) {
  ReachForces forces(kAhead, clamp_of(800));
  const Vec3 force = held(forces, Vec3(0.03, 0.002, -0.001), Vec3(0.1, 0, 0), 1);
  EXPECT_NEAR(force.x(), 0, 1e-12);
  EXPECT_NEAR(force.y(), -1.6, 1e-9);
  EXPECT_NEAR(force.z(), 0.8, 1e-9);
}

TEST(ReachForces, AClampComesOnOverItsRiseAndGoesOffWithoutAStep) {
  ReachForces forces(kAhead, clamp_of(800));
  const Vec3 place(0.03, 0.002, 0), velocity(0.1, 0, 0);
  EXPECT_NEAR(held(forces, place, velocity, 0.25).y(), -0.8, 0.01);
  (void)held(forces, place, velocity, 0.5);
  double before = held(forces, place, velocity, 0.1).y();
  for (int i = 0; i < 300; ++i) {
    const double now = held(forces, place, velocity, kReachTick, false).y();
    EXPECT_LE(now - before, 1.6 * 1.01 * kReachTick / ReachForces::kFall);
    before = now;
  }
  EXPECT_EQ(before, 0);
}

TEST(ReachForces, AClampThatTheHandBreaksStaysOffForTheReach) {
  ReachForces forces(kAhead, clamp_of(800));
  (void)held(forces, Vec3(0.03, 0, 0), Vec3(0.1, 0, 0), 1);
  EXPECT_FALSE(forces.broken());
  (void)held(forces, Vec3(0.03, 0.031, 0), Vec3(0.1, 0, 0), 0.3);
  EXPECT_TRUE(forces.broken());
  EXPECT_EQ(held(forces, Vec3(0.03, 0.002, 0), Vec3(0.1, 0, 0), 1).norm(), 0);
  forces.begin();
  EXPECT_GT(held(forces, Vec3(0.03, 0.002, 0), Vec3(0.1, 0, 0), 1).norm(), 1);
}

TEST(ReachForces, AForceThatHoldsAHandAtRestDecays) {
  ReachForces forces(kAhead, clamp_of(800));
  EXPECT_NEAR(held(forces, Vec3(0.03, 0.002, 0), Vec3::Zero(), 1.5).y(), -1.6, 1e-9);
  EXPECT_EQ(held(forces, Vec3(0.03, 0.002, 0), Vec3::Zero(), 4).norm(), 0);
  EXPECT_NEAR(held(forces, Vec3(0.03, 0.002, 0), Vec3(0.1, 0, 0), 1).y(), -1.6, 1e-9) << "it moves again";
}

TEST(ReachForces, AStaleStateGivesNoForce) {
  for (const ReachForces::Options& options : {curl_of(13), clamp_of(800)}) {
    ReachForces forces(kAhead, options);
    const State good{.dt = kReachTick, .position = Vec3(0.03, 0.002, 0), .velocity = Vec3(0.2, 0, 0)};
    (void)held(forces, good.position, good.velocity, 1);
    EXPECT_GT(forces.update(good, true, 1, true).norm(), 1);
    State gap = good, lost = good, unknown = good;
    gap.dt = 0;
    lost.position = nan3();
    unknown.velocity = nan3();
    for (const State& stale : {gap, lost, unknown}) EXPECT_EQ(forces.update(stale, true, 1, true).norm(), 0);
  }
}

TEST(ReachForces, LimitsTheForceAndKeepsItsDirection) {
  ReachForces::Options options = curl_of(13);
  options.max_force = 2;
  ReachForces forces(kAhead, options);
  const Vec3 force = held(forces, Vec3::Zero(), Vec3(1, 1, 0), 1);
  EXPECT_NEAR(force.norm(), 2, 1e-9);
  EXPECT_NEAR(force.x(), -force.y(), 1e-9);
}

TEST(ReachForces, LimitsSpringAndDampingOfAClampTogether) {
  ReachForces::Options options = clamp_of(800);
  options.clamp->damping = 50;
  options.max_force = 2;
  ReachForces forces(kAhead, options);
  EXPECT_NEAR(held(forces, Vec3(0.03, 0.002, 0), Vec3(0.1, 0.3, 0), 1).y(), -2, 1e-9) << "1.6 and 15 N";
  EXPECT_NEAR(held(forces, Vec3(0.03, 0.002, 0), Vec3(0.1, -0.02, 0), kReachTick).y(), -0.6, 1e-9);
}

TEST(ReachForces, NamesTheValueThatIsOutOfItsRange) {
  EXPECT_THAT(error_of([] { ReachForces(kAhead, clamp_of(-1)); }), HasSubstr("the stiffness of the clamp is -1 N/m"));
  EXPECT_THAT(error_of([] { ReachForces({.target = Vec3::Zero()}, curl_of(1)); }),
              HasSubstr("the distance of the target"));
}

}  // namespace
}  // namespace haptrace
