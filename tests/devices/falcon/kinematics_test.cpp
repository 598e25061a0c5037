#include "devices/falcon/kinematics.h"

#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <gmock/gmock.h>
#include <numbers>

namespace haptrace::test {
namespace {

using testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kDraws = 20'000;

/// Draws poses from the whole reach of the legs, which is larger than the range within a real device's stops.
class RandomPose {
 public:
  explicit RandomPose(std::uint64_t seed) : random_(seed, 11) {}

  FalconPose operator()() {
    while (true)
      if (const auto pose = falcon_.at_position(place())) return *pose;
  }
  Vec3 place() { return between(Vec3(-0.11, -0.11, -0.02), Vec3(0.11, 0.11, 0.2)); }
  Vec3 between(const Vec3& low, const Vec3& high) {
    const double x = random_.between(low.x(), high.x()), y = random_.between(low.y(), high.y());
    return {x, y, random_.between(low.z(), high.z())};
  }
  Vec3 vector() { return between(Vec3::Constant(-1), Vec3::Constant(1)); }

 private:
  FalconKinematics falcon_;
  SplitMix64 random_;
};

/// Returns the pose's largest error in the loop-closure equations of Stamper's thesis [m].
double loop_error(const FalconGeometry& g, const FalconPose& pose) {
  double worst = 0;
  for (int leg = 0; leg < 3; ++leg) {
    const double c = std::cos(g.azimuths[leg]), s = std::sin(g.azimuths[leg]), t1 = pose.angles[leg];
    const Vec3& p = pose.position;
    const double u = c * p.x() + s * p.y() - g.base_radius, v = c * p.y() - s * p.x() - g.base_offset;
    const double t3 = std::acos((v + g.handle_offset) / g.shin), rho = g.shin_offset + g.shin * std::sin(t3);
    const double t2 = std::atan2(p.z() - g.thigh * std::sin(t1), u + g.handle_radius - g.thigh * std::cos(t1));
    worst = std::max({worst, std::abs(g.thigh * std::cos(t1) + rho * std::cos(t2) - u - g.handle_radius),
                      std::abs(g.thigh * std::sin(t1) + rho * std::sin(t2) - p.z())});
  }
  return worst;
}

TEST(FalconKinematics, FindsThePositionOfItsAnglesFromAnyStart) {
  const FalconKinematics falcon;
  RandomPose random(1);
  for (int i = 0; i < kDraws; ++i) {
    const FalconPose pose = random();
    const Vec3 near = i % 2 == 0 ? random().position : Vec3(2 * random.vector());
    const auto found = falcon.at_angles(pose.angles, near), afresh = falcon.at_angles(pose.angles);
    ASSERT_TRUE(found && afresh) << "draw " << i << " at " << pose.position.transpose();
    ASSERT_LT((found->position - pose.position).norm(), 1e-12) << "draw " << i;
    ASSERT_LT((afresh->position - pose.position).norm(), 1e-12) << "draw " << i;
    ASSERT_LT((found->jacobian - pose.jacobian).norm(), 1e-9) << "draw " << i;
  }
}

TEST(FalconKinematics, ReachesNothingThatDoesNotCloseItsLoops) {
  const FalconKinematics falcon;
  RandomPose random(2);
  int reached = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Vec3 angles = 2.5 * random.vector();
    const auto pose = falcon.at_angles(angles, random.place());
    if (!pose) continue;
    ++reached;
    ASSERT_EQ(pose->angles, angles);
    ASSERT_LT(loop_error(falcon.geometry(), *pose), 1e-12) << "angles " << angles.transpose();
    const auto back = falcon.at_position(pose->position);
    ASSERT_TRUE(back) << "angles " << angles.transpose();
    ASSERT_LT((back->angles - angles).norm(), 1e-11) << "angles " << angles.transpose();
  }
  EXPECT_GT(reached, kDraws / 8);
}

TEST(FalconKinematics, HasTheJacobianOfItsPositions) {
  const FalconKinematics falcon;
  RandomPose random(3);
  const double h = 1e-5;
  int compared = 0;
  for (int i = 0; i < kDraws / 4; ++i) {
    const FalconPose pose = random();
    if (pose.jacobian.norm() > 0.5) continue;  // too nonlinear for this step
    for (int leg = 0; leg < 3; ++leg) {
      const Vec3 step = h * Vec3::Unit(leg);
      const auto after = falcon.at_angles(pose.angles + step, pose.position),
                 before = falcon.at_angles(pose.angles - step, pose.position);
      if (!after || !before) continue;
      const Vec3 difference = (after->position - before->position) / (2 * h);
      ASSERT_LT((difference - pose.jacobian.col(leg)).norm(), 1e-7) << "at " << pose.position.transpose();
      ++compared;
    }
  }
  EXPECT_GT(compared, kDraws / 4);
}

TEST(FalconKinematics, TakesTheWorkFromTheMotorsThatItGivesToTheHand) {
  const FalconKinematics falcon;
  RandomPose random(4);
  const double h = 1e-6;
  int compared = 0;
  for (int i = 0; i < kDraws; ++i) {
    const FalconPose pose = random();
    if (pose.jacobian.inverse().norm() > 100) continue;  // too nonlinear for differences
    const Vec3 velocity = 0.3 * random.vector(), force = 9 * random.vector();
    const auto after = falcon.at_position(pose.position + h * velocity),
               before = falcon.at_position(pose.position - h * velocity);
    if (!after || !before) continue;
    const Vec3 angular_velocity = (after->angles - before->angles) / (2 * h);
    const Vec3 torques = pose.torques(force);
    const double error = torques.dot(angular_velocity) - force.dot(velocity);
    ASSERT_LT(std::abs(error), 1e-6 * torques.norm() * angular_velocity.norm() + 1e-9)
        << "at " << pose.position.transpose();
    ++compared;
  }
  EXPECT_GT(compared, kDraws / 2);
}

TEST(FalconKinematics, IsTheSameForEachOfItsLegs) {
  const FalconKinematics falcon;
  RandomPose random(5);
  // The next leg is a third of a turn back, so a pose turned by that angle permutes the legs.
  const Eigen::Matrix3d third = Eigen::AngleAxisd(-120 * kDegree, Vec3::UnitZ()).toRotationMatrix();
  Eigen::Matrix3d next;
  next << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  for (int i = 0; i < kDraws; ++i) {
    const FalconPose pose = random();
    const auto turned = falcon.at_position(third * pose.position);
    if (!turned) continue;  // at the very edge of the reach
    ASSERT_LT((turned->angles - next * pose.angles).norm(), 1e-11);
    ASSERT_LT((turned->jacobian - third * pose.jacobian * next.transpose()).norm(), 1e-9);
  }
}

TEST(FalconKinematics, PlacesTheHandleWhereTheSourceOfItsLengthsDoes) {
  const auto pose = FalconKinematics().at_angles(Vec3::Constant(35 * kDegree));
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->position - Vec3(0, 0, 0.1346)).norm(), 5e-5);
  // Along the axis all legs carry the same load, and rising legs push the handle out of the device.
  const Vec3 torques = pose->torques(Vec3(0, 0, 3));
  EXPECT_GT(torques[0], 0);
  EXPECT_NEAR(torques[0], torques[1], 1e-12);
  EXPECT_NEAR(torques[0], torques[2], 1e-12);
}

TEST(FalconKinematics, NeedsTheTorquesThatOtherSourcesState) {
  const auto pose = FalconKinematics().at_position(Vec3(0, 0, 0.12));
  ASSERT_TRUE(pose);
  EXPECT_NEAR(pose->torques(Vec3(10, 0, 0)).cwiseAbs().maxCoeff(), 0.58, 0.005);
  EXPECT_NEAR(pose->torques(Vec3(0, 10, 0)).cwiseAbs().maxCoeff(), 0.57, 0.005);
  EXPECT_NEAR(pose->torques(Vec3(0, 0, 10)).cwiseAbs().maxCoeff(), 0.25, 0.005);
}

TEST(FalconKinematics, MovesTheHandleAwayFromALegThatRisesAndOutOfTheDevice) {
  const auto pose = FalconKinematics().at_position(Vec3(0, 0, 0.12));
  ASSERT_TRUE(pose);
  EXPECT_LT(pose->jacobian(1, 0), -0.02);  // the upper leg moves it down
  EXPECT_LT(pose->jacobian(0, 1), -0.02);  // the right leg moves it left
  EXPECT_GT(pose->jacobian(0, 2), 0.02);   // the left leg moves it right
  EXPECT_TRUE((pose->jacobian.row(2).array() > 0.01).all());
}

TEST(FalconKinematics, ReachesABoxOf80MillimetresWithRoomToSpare) {
  const FalconKinematics falcon;
  for (int x = -8; x <= 8; ++x)
    for (int y = -8; y <= 8; ++y)
      for (int z = -8; z <= 8; ++z) {
        const auto pose = falcon.at_position(Vec3(0, 0, 0.12) + 0.005 * Vec3(x, y, z));
        ASSERT_TRUE(pose) << x << ' ' << y << ' ' << z;
        const Eigen::Vector3d strengths = pose->jacobian.jacobiSvd().singularValues();
        ASSERT_LT(strengths[0], 0.5) << x << ' ' << y << ' ' << z;
        ASSERT_GT(strengths[2], 0.01) << x << ' ' << y << ' ' << z;
      }
}

TEST(FalconKinematics, IsFoundOnEveryPathFromTheMiddleToItsEdge) {
  const FalconKinematics falcon;
  RandomPose random(6);
  for (int i = 0; i < 300; ++i) {
    const Vec3 direction = random.vector().normalized();
    Vec3 last(0, 0, 0.12);
    double way = 0;
    while (const auto pose = falcon.at_position(Vec3(0, 0, 0.12) + way * direction)) {
      const auto found = falcon.at_angles(pose->angles, last);
      ASSERT_TRUE(found && found->jacobian.allFinite())
          << "lost after " << way << " m towards " << direction.transpose();
      ASSERT_LT((found->position - pose->position).norm(), 1e-12);
      last = found->position;
      way += 1e-4;
    }
    EXPECT_GT(way, 0.05) << direction.transpose();
    EXPECT_LT(way, 0.12) << direction.transpose();
  }
}

TEST(FalconKinematics, ReachesNothingOutside) {
  const FalconKinematics falcon;
  for (const Vec3& position : {Vec3(0, 0, 0.19), Vec3(0, 0, 0.05), Vec3(0, 0, -0.12), Vec3(0.2, 0, 0.1), Vec3(0, 0, 0),
                               Vec3(1e9, 0, 0), Vec3(kNaN, 0, 0.1), Vec3(0, INFINITY, 0.1)})
    EXPECT_FALSE(falcon.at_position(position)) << position.transpose();
  // Elbows too far apart for one handle, legs folded under it, and angles that are not finite.
  for (const Vec3& degrees : {Vec3(0, 0, -180), Vec3(150, 150, 150), Vec3(-120, -120, -120)})
    EXPECT_FALSE(falcon.at_angles(kDegree * degrees)) << degrees.transpose();
  EXPECT_FALSE(falcon.at_angles(Vec3(kNaN, 0.6, 0.6)));
  EXPECT_FALSE(falcon.at_angles(Vec3(0.6, 0.6, INFINITY), Vec3(0, 0, 0.12)));
}

TEST(FalconKinematics, RestartsWhenItsStartPositionIsInvalid) {
  const FalconKinematics falcon;
  const FalconPose pose = *falcon.at_position(Vec3(0.01, -0.02, 0.13));
  for (const Vec3& near : {nan3(), Vec3(INFINITY, 0, 0), Vec3(0, 0, -1e300), Vec3(0, 0, -0.12), Vec3(5, 5, 5)}) {
    const auto found = falcon.at_angles(pose.angles, near);
    ASSERT_TRUE(found) << near.transpose();
    EXPECT_LT((found->position - pose.position).norm(), 1e-12);
  }
}

TEST(FalconKinematics, AllocatesNothing) {
  const FalconKinematics falcon;
  const std::size_t before = allocations();
  const auto pose = falcon.at_position(Vec3(0.01, 0.02, 0.11));
  const auto found = falcon.at_angles(pose->angles, Vec3(0, 0, 0.12));
  const Vec3 torques = found->torques(Vec3(1, 2, 3));
  const auto nowhere = falcon.at_angles(Vec3(-3, 0, 3), Vec3(0, 0, 0.12));
  EXPECT_EQ(allocations(), before);
  EXPECT_TRUE(is_finite(torques));
  EXPECT_FALSE(nowhere);
}

TEST(FalconKinematics, StandsRoundItsAxisInEitherSense) {
  FalconGeometry mirrored;
  mirrored.azimuths = -FalconGeometry().azimuths;
  mirrored.handle_offset = -mirrored.handle_offset;
  mirrored.base_offset = -mirrored.base_offset;
  const FalconKinematics falcon, other(mirrored);
  RandomPose random(7);
  for (int i = 0; i < 1000; ++i) {
    const FalconPose pose = random();
    const auto there = other.at_position(pose.position.cwiseProduct(Vec3(1, -1, 1)));
    ASSERT_TRUE(there);
    ASSERT_LT((there->angles - pose.angles).norm(), 1e-11);
    ASSERT_TRUE(other.at_angles(pose.angles));
  }
}

TEST(FalconKinematics, RejectsInvalidLengths) {
  const auto refusal = [](auto change) {
    FalconGeometry geometry;
    change(geometry);
    return error_of([&] { (void)FalconKinematics(geometry); });
  };
  EXPECT_THAT(refusal([](auto& g) { g.thigh = 60; }), HasSubstr("thigh is 60 m"));
  EXPECT_THAT(refusal([](auto& g) { g.shin = 0; }), HasSubstr("shin is 0 m"));
  EXPECT_THAT(refusal([](auto& g) { g.shin_offset = -0.01; }), HasSubstr("shin_offset"));
  EXPECT_THAT(refusal([](auto& g) { g.base_radius = kNaN; }), HasSubstr("base_radius"));
  EXPECT_THAT(refusal([](auto& g) { g.azimuths = Vec3(105, -15, -135); }), HasSubstr("azimuths is 105 rad"));
  EXPECT_THAT(refusal([](auto& g) { g.azimuths = Vec3(1, 1, -2); }), HasSubstr("two legs are at the same place"));
}

}  // namespace
}  // namespace haptrace::test
