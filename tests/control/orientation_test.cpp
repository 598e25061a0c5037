#include "control/path/orientation_trajectory.h"
#include "control/rotation.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace::test {
namespace {

constexpr double kPi = std::numbers::pi;

Vec3 random_vector(std::mt19937& random, double largest) {
  std::uniform_real_distribution<double> component(-1, 1);
  Vec3 v(component(random), component(random), component(random));
  return largest * v / std::max(1.0, v.norm());
}

/// Returns the orientation at `t` of a smooth rotation to and fro.
Quat turning(double t) {
  return quaternion(Vec3(0.8 * std::sin(3 * t), 0.5 * std::cos(2 * t) - 0.5, 0.4 * t));
}

Path path_of(const std::vector<double>& time, const std::function<Quat(double)>& orientation) {
  Path path{.name = "turning"};
  for (const double t : time) {
    path.time.push_back(t);
    path.position.emplace_back(t, 0, 0);
    path.orientation.push_back(orientation(t));
  }
  return path;
}

std::vector<double> even(double step, int count) {
  std::vector<double> time;
  for (int i = 0; i < count; ++i) time.push_back(step * i);
  return time;
}

OrientationTrajectory trajectory_of(const Path& path, Interpolation interpolation) {
  return {path, interpolation, path.time.front(), path.time.back()};
}

double angle_between(const Quat& a, const Quat& b) {
  return rotation_between(a, b).norm();
}

TEST(Rotation, VectorAndQuaternionAreEachOthersInverse) {
  std::mt19937 random(3);
  for (const double largest : {1e-12, 1e-6, 1e-3, 1.0, 0.999 * kPi})
    for (int k = 0; k < 200; ++k) {
      const Vec3 v = random_vector(random, largest);
      EXPECT_LT((rotation_vector(quaternion(v)) - v).norm(), 1e-12 + 1e-9 * v.norm()) << v.transpose();
      Quat other = quaternion(v);
      other.coeffs() *= -1;
      EXPECT_LT((rotation_vector(other) - v).norm(), 1e-12 + 1e-9 * v.norm()) << "both quaternions of a rotation";
    }
  EXPECT_EQ(rotation_vector(Quat(Quat::Identity())), Vec3::Zero());
  EXPECT_FALSE(is_finite(rotation_vector(nan_quat())));
}

TEST(Rotation, BetweenTwoIsExpressedInTheBaseFrame) {
  const Quat from = quaternion(Vec3(0, 0, 0.5 * kPi)), to = quaternion(Vec3(0.3, 0, 0)) * from;
  EXPECT_LT((rotation_between(from, to) - Vec3(0.3, 0, 0)).norm(), 1e-12);
}

TEST(AngularVelocity, EqualsTheRateOfASteadyTurn) {
  AngularVelocity estimate(1000);
  const Vec3 velocity(0.4, -2, 1);
  Vec3 found = Vec3::Zero();
  for (int k = 0; k < 200; ++k)
    found = estimate.update(quaternion(velocity.normalized() * velocity.norm() * 1e-3 * k), 1e-3);
  EXPECT_LT((found - velocity).norm(), 1e-6);
}

TEST(AngularVelocity, KeepsKnownValuesWhereAnOrientationIsMissing) {
  AngularVelocity estimate(1000);
  for (int k = 0; k < 200; ++k) (void)estimate.update(quaternion(Vec3(0, 0, 1e-3 * k)), 1e-3);
  const Vec3 before = estimate.update(nan_quat(), 1e-3);
  EXPECT_NEAR(before.z(), 1, 1e-6);
  EXPECT_TRUE(is_finite(estimate.update(quaternion(Vec3(0, 0, 0.2)), 0)));
  estimate.reset();
  EXPECT_EQ(estimate.update(quaternion(Vec3(1, 0, 0)), 1e-3), Vec3::Zero());
}

TEST(OrientationLaw, TurnsARigidBodyToItsReferenceFromAnywhere) {
  std::mt19937 random(5);
  const OrientationGains gains{.kp = 1, .kd = 0.05};
  const double inertia = 5e-4, h = 1e-4;
  for (int draw = 0; draw < 50; ++draw) {
    Quat q = quaternion(random_vector(random, 3));
    const Quat goal = quaternion(random_vector(random, 3));
    Vec3 w = Vec3::Zero();
    for (int k = 0; k < 20'000; ++k) {
      w += h / inertia * orientation_torque(gains, rotation_between(q, goal), -w);
      q = (quaternion(h * w) * q).normalized();
    }
    EXPECT_LT(angle_between(q, goal), 1e-6);
  }
}

class OrientationInterpolations : public testing::TestWithParam<Interpolation> {};

TEST_P(OrientationInterpolations, PassThroughEverySampleAndRestOutside) {
  const std::vector<double> time{0.5, 0.52, 0.9, 1.0, 2.5, 2.5001};
  const OrientationTrajectory trajectory = trajectory_of(path_of(time, turning), GetParam());
  Trajectory::Cursor cursor;
  for (const double t : time)
    EXPECT_LT(angle_between(trajectory.sample(t - 0.5, cursor).orientation, turning(t)), 1e-9) << t;
  EXPECT_EQ(trajectory.sample(-1, cursor).angular_velocity, Vec3::Zero());
  EXPECT_EQ(trajectory.sample(99, cursor).angular_velocity, Vec3::Zero());
  EXPECT_LT(angle_between(trajectory.sample(kNaN, cursor).orientation, turning(0.5)), 1e-12);
}

/// Interpolations that do not jump between samples.
class ContinuousOrientations : public OrientationInterpolations {};

TEST_P(ContinuousOrientations, TurnAtTheRateThatTheyState) {
  const OrientationTrajectory trajectory = trajectory_of(path_of(even(0.1, 40), turning), GetParam());
  Trajectory::Cursor cursor;
  constexpr double kStep = 1e-6;
  for (double t = 0.0137; t < 3.8; t += 0.0173) {
    const Quat before = trajectory.sample(t - kStep, cursor).orientation;
    const OrientationReference now = trajectory.sample(t, cursor);
    const Quat after = trajectory.sample(t + kStep, cursor).orientation;
    if (std::fmod(t, 0.1) < 2 * kStep) continue;
    EXPECT_LT((rotation_between(before, after) / (2 * kStep) - now.angular_velocity).norm(), 1e-4) << t;
  }
}

TEST_P(OrientationInterpolations, DoNotCareOnWhichHemisphereAQuaternionIs) {
  Path path = path_of(even(0.05, 30), turning), flipped = path;
  for (std::size_t i = 0; i < path.size(); i += 3) flipped.orientation[i].coeffs() *= -1;
  const OrientationTrajectory one = trajectory_of(path, GetParam()), other = trajectory_of(flipped, GetParam());
  Trajectory::Cursor a, b;
  for (double t = 0; t < 1.5; t += 0.0071)
    EXPECT_LT(angle_between(one.sample(t, a).orientation, other.sample(t, b).orientation), 1e-12) << t;
}

TEST_P(OrientationInterpolations, GiveTheSameForPiecesAsForTheWhole) {
  const Path path = path_of(even(0.05, 60), turning);
  const OrientationTrajectory whole = trajectory_of(path, GetParam());
  Path piece{.name = "piece"};
  for (std::size_t i = 20; i < 40; ++i) {
    piece.time.push_back(path.time[i]);
    piece.position.push_back(path.position[i]);
    piece.orientation.push_back(path.orientation[i]);
  }
  const OrientationTrajectory part(piece, GetParam(), path.time.front(), path.time.back());
  Trajectory::Cursor a, b;
  for (double t = 1.1; t < 1.9; t += 0.0071) {
    const OrientationReference of_whole = whole.sample(t, a), of_part = part.sample(t, b);
    EXPECT_LT(angle_between(of_whole.orientation, of_part.orientation), 1e-12) << t;
    EXPECT_LT((of_whole.angular_velocity - of_part.angular_velocity).norm(), 1e-9) << t;
  }
}

INSTANTIATE_TEST_SUITE_P(All, OrientationInterpolations,
                         testing::Values(Interpolation::hold, Interpolation::linear, Interpolation::cubic,
                                         Interpolation::quintic),
                         [](const auto& interpolation) { return to_string(interpolation.param); });
INSTANTIATE_TEST_SUITE_P(All, ContinuousOrientations,
                         testing::Values(Interpolation::linear, Interpolation::cubic, Interpolation::quintic),
                         [](const auto& interpolation) { return to_string(interpolation.param); });

TEST(OrientationTrajectory, IsSmoothInItsRateWhereItIsCubic) {
  const OrientationTrajectory trajectory = trajectory_of(path_of(even(0.1, 40), turning), Interpolation::cubic);
  Trajectory::Cursor cursor;
  for (int i = 1; i < 39; ++i) {
    const Vec3 before = trajectory.sample(0.1 * i - 1e-9, cursor).angular_velocity;
    const Vec3 after = trajectory.sample(0.1 * i + 1e-9, cursor).angular_velocity;
    EXPECT_LT((after - before).norm(), 1e-5) << i;
  }
}

TEST(OrientationTrajectory, ConvergesToASmoothTurnWithMoreSamples) {
  double before = 1;
  for (const double step : {0.2, 0.1, 0.05}) {
    const Path path = path_of(even(step, static_cast<int>(3 / step)), turning);
    const OrientationTrajectory trajectory = trajectory_of(path, Interpolation::cubic);
    Trajectory::Cursor cursor;
    double worst = 0;
    for (double t = 0.5; t < 2; t += 0.003)
      worst = std::max(worst, angle_between(trajectory.sample(t, cursor).orientation, turning(t)));
    EXPECT_LT(worst, before / 5) << "order three at least";
    before = worst;
  }
}

TEST(OrientationTrajectory, DoesNotTurnOnInAPauseOfMinutes) {
  const auto step = [](double t) { return quaternion(Vec3(0, 0, t < 1 ? t : 1)); };
  const OrientationTrajectory trajectory = trajectory_of(path_of({0, 0.5, 1, 301, 301.5}, step), Interpolation::cubic);
  Trajectory::Cursor cursor;
  for (double t = 1; t < 301; t += 1)
    EXPECT_LT(angle_between(trajectory.sample(t, cursor).orientation, step(1)), 1e-9) << t;
}

TEST(Path, RefusesAnOrientationThatIsNotAUnitQuaternion) {
  Path path = path_of(even(0.1, 4), turning);
  validate(path);
  path.orientation[2] = Quat(0.5, 0, 0, 0);
  EXPECT_THAT(error_of([&] { validate(path); }), testing::HasSubstr("sample 3: orientation is not a unit quaternion"));
  path.orientation.pop_back();
  EXPECT_THAT(error_of([&] { validate(path); }), testing::HasSubstr("orientation has 3 samples"));
}

}  // namespace
}  // namespace haptrace::test
