#include "control/path/path_projection.h"

#include "tests/support/allocations.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

using std::numbers::pi;

struct Curve {
  std::string name;
  std::function<Vec3(double)> at;  ///< Position [m] at a share of the curve from 0 to 1.
};

void PrintTo(const Curve& curve, std::ostream* out) {  // NOLINT(readability-identifier-naming): GoogleTest's name
  *out << curve.name;
}

Vec3 square(double u) {
  const double side = 0.1, s = 4 * u;
  if (s < 1) return {side * s, 0, 0};
  if (s < 2) return {side, side * (s - 1), 0};
  if (s < 3) return {side * (3 - s), side, 0};
  return {0, side * (4 - s), 0};
}

Vec3 cursive(double u) {
  const double t = 12 * 2 * pi * u;
  return {0.16 * u + 0.012 * std::sin(t), 0.015 * std::cos(t), 0};
}

const std::vector<Curve> kCurves{
    {"Line", [](double u) { return Vec3(0.1 * u, 0, 0); }},
    {"FigureEight", [](double u) { return Vec3(0.06 * std::sin(2 * pi * u), 0.04 * std::sin(4 * pi * u), 0); }},
    {"RetracedLine", [](double u) { return Vec3(0.1 * (u < 0.5 ? 2 * u : 2 - 2 * u), 0, 0); }},
    {"ClosedSquare", square},
    {"Cursive", cursive},
    {"SelfTouchingSpiral",
     [](double u) {
       const double angle = 4 * 2 * pi * u, r = 0.05 * (1 - u) * (1 + 0.3 * std::cos(3 * angle));
       return Vec3(r * std::cos(angle), r * std::sin(angle), 0);
     }},
    {"CircleTwice", [](double u) { return Vec3(0.04 * std::cos(4 * pi * u), 0.04 * std::sin(4 * pi * u), 0); }},
    {"InSpace", [](double u) { return Vec3(0.05 * std::cos(6 * u), 0.05 * std::sin(6 * u), 0.05 * u); }}};

ArcPath path_of(const Curve& curve) {
  ArcPath::Builder builder(2.5e-4);
  constexpr int kSteps = 8000;
  for (int i = 0; i <= kSteps; ++i) builder.add(1e-3 * i, curve.at(static_cast<double>(i) / kSteps), Vec3::Zero());
  return builder.finish(0.005);
}

/// A hand's tremor: band-limited noise of 2 mm in every direction.
class Tremble {
 public:
  explicit Tremble(unsigned seed) : random_(seed) {}
  Vec3 next() {
    for (int axis = 0; axis < 3; ++axis) slow_[axis] += 0.05 * (2 * normal_(random_) / 0.16 - slow_[axis]);
    return 1e-3 * slow_;
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  Vec3 slow_ = Vec3::Zero();
};

class ProjectionLaws : public testing::TestWithParam<Curve> {
 protected:
  ArcPath path_ = path_of(GetParam());
};

TEST_P(ProjectionLaws, FollowsATraineeThatMovesExactly) {
  PathProjection projection(path_, {});
  projection.start();
  for (int i = 0; i <= 8000; ++i) {
    const auto& foot = projection.update(GetParam().at(i / 8000.0), 1e-3);
    ASSERT_LT(foot.distance, 4e-4) << i;
  }
  EXPECT_NEAR(projection.foot().s, path_.length(), 6e-4);
}

TEST_P(ProjectionLaws, NeverJumpsAndStaysNearTheTruePointForATremblingTrainee) {
  PathProjection exact(path_, {});
  std::vector<double> true_place;
  for (int i = 0; i <= 8000; ++i) true_place.push_back(exact.update(GetParam().at(i / 8000.0), 1e-3).s);
  for (const unsigned seed : {1U, 2U, 3U}) {
    PathProjection projection(path_, {});
    Tremble tremble(seed);
    double before = 0, worst = 0;
    for (int i = 0; i <= 8000; ++i) {
      const double u = i / 8000.0;
      const double s = projection.update(GetParam().at(u) + tremble.next(), 1e-3).s;
      ASSERT_GE(s, before) << "monotone";
      ASSERT_LE(s - before, 2e-3 + 1e-9);
      before = s;
      worst = std::max(worst, std::abs(s - true_place[static_cast<std::size_t>(i)]));
    }
    EXPECT_LT(worst, 0.018) << "the tremor reaches 8 mm and passes a turn before it";
  }
}

TEST_P(ProjectionLaws, NeverJumpsForATraineeThatStopsReversesAndLeaves) {
  for (const bool back : {false, true}) {
    PathProjection projection(path_, {.allow_back = back});
    projection.start();
    Tremble tremble(7);
    double before = 0;
    for (int i = 0; i <= 20000; ++i) {
      // Forward, a stop, back by a tenth, 3 cm away from the path and back to it, then forward to the end.
      const double t = i / 20000.0;
      const double u = t < 0.4 ? t : t < 0.5 ? 0.4 : t < 0.6 ? 0.4 - (t - 0.5) : 0.3 + 1.75 * (t - 0.6);
      const double away = t > 0.7 && t < 0.8 ? 0.03 * std::sin(pi * 10 * (t - 0.7)) : 0;
      const double s = projection.update(GetParam().at(u) + Vec3(0, 0, away) + 0.5 * tremble.next(), 1e-3).s;
      ASSERT_LE(std::abs(s - before), 2e-3 + 1e-9) << t;
      ASSERT_GE(s, back ? 0 : before);
      before = s;
    }
    EXPECT_GT(before, 0.9 * path_.length()) << "and arrives";
  }
}

TEST_P(ProjectionLaws, AllocatesNothing) {
  PathProjection projection(path_, {});
  const std::size_t before = test::allocations();
  for (int i = 0; i <= 1000; ++i) (void)projection.update(GetParam().at(i / 1000.0), 8e-3);
  EXPECT_EQ(test::allocations(), before);
}

INSTANTIATE_TEST_SUITE_P(All, ProjectionLaws, testing::ValuesIn(kCurves),
                         [](const auto& tested) { return tested.param.name; });

TEST(PathProjection, FollowsATraineeThatTurnsBeforeTheEndOfAStroke) {
  const ArcPath path = path_of(kCurves[2]);  // a line of 0.1 m, there and back
  PathProjection projection(path, {});
  double before = 0;
  const auto move = [&](double x) {
    const double s = projection.update(Vec3(x, 5e-4, 0), 1e-3).s;
    EXPECT_LE(s - before, 2e-3 + 1e-9) << "it slides";
    before = s;
  };
  for (int i = 0; i <= 960; ++i) move(1e-4 * i);
  for (int i = 960; i >= 500; --i) move(1e-4 * i);
  EXPECT_NEAR(before, 0.15, 1e-3);
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
  EXPECT_GT(projection.foot().s, path.length() - 0.01);
}

TEST(PathProjection, StaysWhenATraineeReturnsUnlessThatIsAllowed) {
  const ArcPath path = path_of(kCurves[0]);
  for (const bool back : {false, true}) {
    PathProjection projection(path, {.allow_back = back});
    projection.start();
    for (int i = 0; i <= 600; ++i) (void)projection.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
    EXPECT_NEAR(projection.foot().s, 0.06, 1e-6);
    EXPECT_NEAR(projection.foot().speed, 0.1, 1e-3);
    for (int i = 600; i >= 300; --i) (void)projection.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
    EXPECT_NEAR(projection.foot().s, back ? 0.03 : 0.06, 1e-6);
    EXPECT_NEAR(projection.foot().distance, back ? 1e-3 : std::hypot(0.03, 1e-3), 1e-6);
  }
}

TEST(PathProjection, IsPerpendicularWhereItIsFree) {
  const ArcPath path = path_of(kCurves[7]);
  PathProjection projection(path, {});
  projection.start();
  for (int i = 0; i <= 8000; ++i) {
    const auto& foot = projection.update(kCurves[7].at(i / 8000.0) + Vec3(0, 0, 4e-3), 1e-3);
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
  const ArcPath path = path_of(kCurves[0]);
  PathProjection projection(path, {});
  EXPECT_NEAR(projection.move_to(0.05, Vec3(0, 0.03, 0), 1e-3).distance, std::hypot(0.05, 0.03), 1e-9);
  EXPECT_NEAR(projection.move_to(7, Vec3::Zero(), 1e-3).s, 0.1, 1e-9);
}

}  // namespace
}  // namespace haptrace
