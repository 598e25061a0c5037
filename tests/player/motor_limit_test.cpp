#include "player/motor_limit.h"

#include "control/path/shapes.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// A free device of 8 N whose motors give at most 3 N without saying so.
SimSpec weak_device() {
  SimSpec spec;
  spec.mass = Vec3::Constant(0.3);
  spec.viscous = Vec3::Constant(1);
  spec.max_force = spec.max_continuous_force = 8;
  spec.motor_limit = 3;
  spec.workspace = {Vec3::Constant(-0.1), Vec3::Constant(0.1)};
  return spec;
}

PlantModel found_limit(double limit) {
  PlantModel plant;
  plant.motor_limit = limit;
  return plant;
}

TEST(MotorLimit, LowersTheForceOfASessionAndSaysWhy) {
  const SimDevice device(weak_device());
  SessionOptions session;
  ASSERT_TRUE(bound_by_motors(session, device.info(), found_limit(3)));
  EXPECT_EQ(session.loop.limits.max_force, 3);
  ASSERT_EQ(session.known.size(), 1U);
  EXPECT_EQ(session.known[0].code, "motor_limit");
  EXPECT_EQ(session.known[0].severity, Severity::warning);
  EXPECT_THAT(session.known[0].text, HasSubstr("at most 3.0 N"));
  EXPECT_THAT(session.known[0].text, HasSubstr("8.0 N"));
  EXPECT_FALSE(bound_by_motors(session, device.info(), found_limit(3))) << "it is bounded already";
  EXPECT_EQ(session.known.size(), 1U);
}

TEST(MotorLimit, LeavesASessionThatSendsLessOrWhoseMotorsGiveAll) {
  const SimDevice device(weak_device());
  for (const auto& [asked, limit] : {std::pair{2.0, 3.0}, {0.0, 0.0}, {5.0, 0.0}, {0.0, 9.0}}) {
    SessionOptions session;
    session.loop.limits.max_force = asked;
    EXPECT_FALSE(bound_by_motors(session, device.info(), found_limit(limit)));
    EXPECT_EQ(session.loop.limits.max_force, asked);
    EXPECT_TRUE(session.known.empty());
  }
}

TEST(MotorLimit, BoundsAPlaybackWhoseWarningsReachItsResult) {
  SimDevice device(weak_device());
  PlayOptions options;
  options.gains = PdGains{Vec3::Constant(2000), Vec3::Constant(20)};
  ASSERT_TRUE(bound_by_motors(options.session, device.info(), found_limit(3)));
  const Path path = make_shape("circle", {.size = 0.06, .duration = 0.35});
  const PlayResult result = play(device, plan_playback(device.info(), path, options), options, StopRequest{});
  EXPECT_GT(result.session.servo.max_force, 2.9);
  EXPECT_LE(result.session.servo.max_force, 3 * (1 + 1e-9));
  EXPECT_THAT(result.session.warnings, testing::Contains(testing::Field(&Warning::code, "motor_limit")));
}

TEST(MotorHeat, IsForeseenFromTheForceThatALawTookInItsTrial) {
  DeviceInfo device;
  device.max_force = 10;  // and 3 N for long, with a time constant of 20 s
  ServoOptions loop;
  EXPECT_EQ(heat_foreseen(device, loop, 0, 1e9), "") << "not known";
  EXPECT_EQ(heat_foreseen(device, loop, 2.3, 1e9), "") << "they bear it";
  EXPECT_EQ(heat_foreseen(device, loop, 4, 8.9), "");
  EXPECT_THAT(heat_foreseen(device, loop, 4, 9.1), AllOf(HasSubstr("took 4 N rms"), HasSubstr("bear 3 N for long"),
                                                         HasSubstr("from about 9 s on")));  // 20 ln(16 / (16 - 5.76))
  MotorHeat motors{.force = 5.7};
  loop.motors = &motors;
  EXPECT_THAT(heat_foreseen(device, loop, 4, 1), HasSubstr("from about 0 s on"));
  motors.rested = 100;
  EXPECT_EQ(heat_foreseen(device, loop, 4, 1), "");
  loop.limits.max_continuous_force = 2;  // with a time constant of 10 s
  EXPECT_THAT(heat_foreseen(device, loop, 4, 9), HasSubstr("from about 2 s on"));
  DeviceInfo unlimited;
  EXPECT_EQ(heat_foreseen(unlimited, ServoOptions{}, 4, 1e9), "");
}

}  // namespace
}  // namespace haptrace
