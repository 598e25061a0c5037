#include "devices/haply/kinematics.h"

#include "base/json_reader.h"
#include "devices/haply/calibration.h"
#include "tests/devices/support.h"

#include <gmock/gmock.h>
#include <random>

namespace haptrace::test {
namespace {

using testing::HasSubstr;

class Pantograph : public testing::TestWithParam<const char*> {
 protected:
  TwoDiyCalibration device_ = two_diy_calibration(GetParam(), "test");
  PantographKinematics kinematics_{device_.geometry};
  std::mt19937 random_{7};

  /// Returns a random position in the workspace.
  Vec3 place() {
    std::uniform_real_distribution<double> side(-1, 1);
    const double x = side(random_), y = side(random_);
    return {device_.workspace.x() * x, device_.workspace.y() * y, 0};
  }
  PantographPose pose() { return *kinematics_.at_position(device_.to_mechanism(place())); }
};

TEST_P(Pantograph, RecoversThePositionFromItsAngles) {
  for (int k = 0; k < 10'000; ++k) {
    const Vec3 p = place();
    const auto there = kinematics_.at_position(device_.to_mechanism(p));
    ASSERT_TRUE(there) << p.transpose();
    const auto back = kinematics_.at_angles(there->angles);
    ASSERT_TRUE(back);
    ASSERT_LT((device_.to_world(back->position) - p).norm(), 1e-12);
  }
}

TEST_P(Pantograph, KeepsTheLengthsOfItsLinks) {
  const PantographGeometry& g = device_.geometry;
  for (int k = 0; k < 1000; ++k) {
    const PantographPose at = pose();
    const Vec2 a(g.proximal * std::cos(at.angles[0]), g.proximal * std::sin(at.angles[0]));
    const Vec2 b(g.separation + g.proximal * std::cos(at.angles[1]), g.proximal * std::sin(at.angles[1]));
    ASSERT_NEAR((at.position - a).norm(), g.distal, 1e-13);
    ASSERT_NEAR((at.position - b).norm(), g.distal, 1e-13);
    ASSERT_GT(at.position.y(), std::max(a.y(), b.y())) << "the far solution";
    ASSERT_LT(a.x(), b.x()) << "knees outward";
  }
}

TEST_P(Pantograph, HasTheJacobianOfItsFiniteDifferences) {
  constexpr double kStep = 1e-6;
  for (int k = 0; k < 1000; ++k) {
    const PantographPose at = pose();
    for (int arm = 0; arm < 2; ++arm) {
      const auto more = kinematics_.at_angles(at.angles + kStep * Vec2::Unit(arm)),
                 less = kinematics_.at_angles(at.angles - kStep * Vec2::Unit(arm));
      ASSERT_TRUE(more && less);
      const Vec2 difference = (more->position - less->position) / (2 * kStep);
      ASSERT_LT((difference - at.jacobian.col(arm)).norm(), 1e-9);
    }
  }
}

TEST_P(Pantograph, PushesInTheCommandedDirectionAndDoesTheWorkOfTheForce) {
  std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi);
  for (int k = 0; k < 1000; ++k) {
    const PantographPose at = pose();
    const double phi = turn(random_);
    const Vec3 small = 0.9 * device_.max_force * Vec3(std::cos(phi), std::sin(phi), 0);
    const Vec2 torques = device_.torques(at, small);
    ASSERT_LE(torques.cwiseAbs().maxCoeff(), device_.max_torque) << "max_force holds in every direction";
    ASSERT_LT((device_.force_in_world(at.force(torques)) - small).norm(), 1e-12);
    // The power at the motors equals the power at the handle.
    const Vec2 rates(0.3, -0.7), velocity = at.jacobian * rates;
    ASSERT_NEAR(torques.dot(rates), small.dot(device_.force_in_world(velocity)), 1e-12);

    const Vec2 limited = device_.torques(at, 100 * small);
    ASSERT_NEAR(limited.cwiseAbs().maxCoeff(), device_.max_torque, 1e-12);
    ASSERT_LT((device_.force_in_world(at.force(limited)).normalized() - small.normalized()).norm(), 1e-9);
    ASSERT_EQ(device_.torques(at, Vec3(kNaN, 0, 0)), Vec2(0, 0));
  }
}

TEST_P(Pantograph, HasNoPoseWhereAMotionOrAForceIsLost) {
  const PantographGeometry& g = device_.geometry;
  const double reach = g.proximal + g.distal;
  EXPECT_FALSE(kinematics_.at_position(Vec2(0, reach + 1e-9)));
  EXPECT_FALSE(kinematics_.at_position(Vec2(0, reach - 1e-9))) << "an arm is stretched";
  EXPECT_FALSE(kinematics_.at_position(Vec2(0, 0))) << "on the motor";
  EXPECT_FALSE(kinematics_.at_angles(Vec2(kNaN, 0)));
  EXPECT_FALSE(kinematics_.at_angles(Vec2(std::numbers::pi / 2, std::numbers::pi / 2)) && g.separation == 0)
      << "elbows in one place";
  // The elbows are so far apart that the outer links lie in a line.
  const double wide = std::acos((g.distal - g.separation / 2) / g.proximal);
  EXPECT_FALSE(kinematics_.at_angles(Vec2(std::numbers::pi - wide, wide)) && g.distal - g.separation / 2 < g.proximal);
}

TEST_P(Pantograph, HasAPoseInItsStopsForHoming) {
  EXPECT_TRUE(kinematics_.at_angles(device_.stops()));
}

INSTANTIATE_TEST_SUITE_P(All, Pantograph, testing::Values("gen2", "gen3", "devkit"),
                         [](const auto& generation) { return std::string(generation.param); });

TEST(TwoDiyCalibration, HasXToTheRightAndYAway) {
  // For a user facing the base, the second motor is on the left and the handle moves towards the user.
  const TwoDiyCalibration device = two_diy_calibration("gen3", "test");
  EXPECT_LT(device.to_world(device.origin + Vec2(0.01, 0)).x(), 0);
  EXPECT_LT(device.to_world(device.origin + Vec2(0, 0.01)).y(), 0);
  const Vec3 place(0.01, -0.02, 0);
  EXPECT_LT((device.to_world(device.to_mechanism(place)) - place).norm(), 1e-15);
}

TEST(TwoDiyCalibration, ReadsTheSampleAsTheDefaultsOfItsGeneration) {
  const TwoDiyCalibration read = read_two_diy_calibration(load_json(SAMPLE_DEVICES "/haply-2diy.json"), "sample"),
                          made = two_diy_calibration("gen3", "test");
  EXPECT_EQ(read.generation, made.generation);
  EXPECT_EQ(read.geometry.separation, made.geometry.separation);
  EXPECT_EQ(read.origin, made.origin);
  EXPECT_EQ(read.workspace, made.workspace);
  EXPECT_EQ(read.max_force, made.max_force);
  EXPECT_EQ(read.max_torque, made.max_torque);
  EXPECT_LT((read.stops() - made.stops()).norm(), 1e-6);
  for (std::size_t arm = 0; arm < 2; ++arm) {
    EXPECT_EQ(read.arms[arm].port, made.arms[arm].port);
    EXPECT_EQ(read.arms[arm].counts_per_turn, made.arms[arm].counts_per_turn);
  }
}

TEST(TwoDiyCalibration, RejectsInvalidValuesAndNamesTheKey) {
  const auto refusal = [](const char* json) {
    return error_of([&] { read_two_diy_calibration(nlohmann::json::parse(json), "my.json"); });
  };
  EXPECT_THAT(refusal(R"({"generation": "gen4"})"), HasSubstr("my.json: generation: 'gen4'"));
  EXPECT_THAT(refusal(R"({"arm1": {"port": 1}})"), HasSubstr("arm2.port: 1 is already the port of the first arm"));
  EXPECT_THAT(refusal(R"({"arm2": {"motor": "left"}})"), HasSubstr("arm2.motor"));
  EXPECT_THAT(refusal(R"({"axis_sign": {"x": 0.5}})"), HasSubstr("axis_sign: a sign is 1 or -1"));
  EXPECT_THAT(refusal(R"({"workspace": {"x": 0.06}})"), HasSubstr("workspace: (-0.06, "));
  EXPECT_THAT(refusal(R"({"geometry": {"distal": 0.05}})"), HasSubstr("out of the arms' reach"));
  EXPECT_THAT(refusal(R"({"geometry": {"proximal": 7}})"), HasSubstr("geometry: proximal is 7 m"));
  EXPECT_THAT(refusal(R"({"torque": 1})"), HasSubstr("torque"));
}

}  // namespace
}  // namespace haptrace::test
