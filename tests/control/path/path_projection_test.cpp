#include "control/path/path_projection.h"

#include <cmath>
#include <functional>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

ArcPath path_through(const std::function<Vec3(double)>& at) {
  ArcPath::Builder builder(2.5e-4);
  constexpr int kSteps = 8000;
  for (int i = 0; i <= kSteps; ++i) builder.add(1e-3 * i, at(static_cast<double>(i) / kSteps), Vec3::Zero());
  return builder.finish(0.005);
}

Vec3 straight_line(double u) {
  return {0.1 * u, 0, 0};
}

Vec3 turning_helix(double u) {
  return {0.05 * std::cos(6 * u), 0.05 * std::sin(6 * u), 0.05 * u};
}

TEST(PathProjection, FollowsATraineeThatMovesExactly) {
  const ArcPath path = path_through(turning_helix);
  PathProjection projection(path, {});
  projection.start();
  for (int i = 0; i <= 8000; ++i) ASSERT_LT(projection.update(turning_helix(i / 8000.0), 1e-3).distance, 4e-4) << i;
  EXPECT_NEAR(projection.foot().s, path.length(), 6e-4);
}

TEST(PathProjection, StaysWithinTheAllowedPartAndSlidesIntoIt) {
  const ArcPath path = path_through(straight_line);
  PathProjection projection(path, {});
  projection.start(0.02);
  double before = 0.02;
  for (int i = 0; i < 100; ++i) {
    const double s = projection.update(Vec3(0.02, 0, 0), 1e-3, 0.04, 0.05).s;
    ASSERT_GE(s, before);
    ASSERT_LE(s - before, 1e-3 + 1e-9) << "the tool rests";
    before = s;
  }
  EXPECT_EQ(before, 0.04);
  EXPECT_NEAR(projection.update(Vec3(0.0401, 0, 0), 1e-3, 0.04, 0.05).s, 0.0401, 1e-9);
}

TEST(PathProjection, LeapsNoFartherInALongTick) {
  // The tool cuts a corner, at a rate of 250 Hz.
  ArcPath::Builder builder(2.5e-4);
  for (int i = 0; i <= 100; ++i) builder.add(1e-2 * i, Vec3(1e-3 * i, 0, 0), Vec3::Zero());
  for (int i = 1; i <= 100; ++i) builder.add(1 + 1e-2 * i, Vec3(0.1, 1e-3 * i, 0), Vec3::Zero());
  const ArcPath path = builder.finish(0.005);
  PathProjection projection(path, {});
  Vec3 place = path.position_at(0), tool = place;
  for (int i = 0; i <= 400; ++i) {
    const Vec3 now = i < 195 ? Vec3(5e-4 * i, 0, 0) : Vec3(0.0975, 5e-4 * (i - 195), 0);
    const Vec3 foot = projection.update(now, 4e-3).place.position;
    ASSERT_LE((foot - place).norm(), (now - tool).norm() + 1e-3 + 1e-9) << i;
    place = foot;
    tool = now;
  }
  EXPECT_GT(projection.foot().s, 0.09);
}

TEST(PathProjection, FollowsATraineeWhoReturns) {
  const ArcPath path = path_through(straight_line);
  PathProjection projection(path, {});
  projection.start();
  for (int i = 0; i <= 600; ++i) (void)projection.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
  EXPECT_NEAR(projection.foot().s, 0.06, 1e-6);
  EXPECT_NEAR(projection.foot().speed, 0.1, 1e-3);
  for (int i = 600; i >= 300; --i) (void)projection.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
  EXPECT_NEAR(projection.foot().s, 0.03, 1e-6);
  EXPECT_NEAR(projection.foot().distance, 1e-3, 1e-6);
}

TEST(PathProjection, IsPerpendicularWhereItIsFree) {
  const ArcPath path = path_through(turning_helix);
  PathProjection projection(path, {});
  projection.start();
  for (int i = 0; i <= 8000; ++i) {
    const auto& foot = projection.update(turning_helix(i / 8000.0) + Vec3(0, 0, 4e-3), 1e-3);
    if (i > 500 && i < 7500) {
      ASSERT_LT(std::abs(foot.outwards.dot(foot.place.tangent)), 0.02);
      ASSERT_NEAR(foot.outwards.norm(), 1, 1e-12);
    }
  }
}

TEST(PathProjection, StaysFiniteOnAPathOfOnePoint) {
  ArcPath::Builder builder(2.5e-4);
  builder.add(0, Vec3(1, 2, 3), Vec3::Zero());
  const ArcPath path = builder.finish(0.005);
  PathProjection projection(path, {});
  projection.start();
  const auto& foot = projection.update(Vec3(1, 2, 4), 1e-3);
  EXPECT_EQ(foot.s, 0);
  EXPECT_EQ(foot.distance, 1);
  EXPECT_EQ(foot.outwards, Vec3(0, 0, 1));
  EXPECT_EQ(projection.update(Vec3(1, 2, 3), 1e-3).outwards, Vec3::Zero());
}

TEST(PathProjection, MovesACursorAtAnyDistance) {
  const ArcPath path = path_through(straight_line);
  PathProjection projection(path, {});
  EXPECT_NEAR(projection.move_to(0.05, Vec3(0, 0.03, 0), 1e-3).distance, std::hypot(0.05, 0.03), 1e-9);
  EXPECT_NEAR(projection.move_to(7, Vec3::Zero(), 1e-3).s, 0.1, 1e-9);
}

}  // namespace
}  // namespace haptrace
