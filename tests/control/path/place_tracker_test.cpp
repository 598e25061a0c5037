#include "control/path/place_tracker.h"

#include "tests/control/path/trainees.h"
#include "tests/support/allocations.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>
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

ArcPath place_path_of(const Curve& curve) {
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

class PlaceLaws : public testing::TestWithParam<Curve> {
 protected:
  ArcPath path_ = place_path_of(GetParam());
};

TEST_P(PlaceLaws, FollowsATraineeThatMovesExactly) {
  PlaceTracker tracker(path_, {});
  tracker.start();
  for (int i = 0; i <= 8000; ++i) {
    const auto& foot = tracker.update(GetParam().at(i / 8000.0), 1e-3);
    ASSERT_LT(foot.distance, 4e-4) << i;
  }
  EXPECT_NEAR(tracker.foot().s, path_.length(), 6e-4);
}

TEST_P(PlaceLaws, NeverJumpsAndStaysNearTheTruePointForATremblingTrainee) {
  PlaceTracker exact(path_, {});
  std::vector<double> true_place;
  for (int i = 0; i <= 8000; ++i) true_place.push_back(exact.update(GetParam().at(i / 8000.0), 1e-3).s);
  for (const unsigned seed : {1U, 2U, 3U}) {
    PlaceTracker tracker(path_, {});
    Tremble tremble(seed);
    double before = 0, worst = 0;
    for (int i = 0; i <= 8000; ++i) {
      const double u = i / 8000.0;
      const auto& foot = tracker.update(GetParam().at(u) + tremble.next(), 1e-3);
      const double s = foot.s;
      ASSERT_LE(foot.certainty > 0 ? std::abs(s - before) : 0, 2e-3 + 1e-9);
      before = s;
      worst = std::max(worst, std::abs(s - true_place[static_cast<std::size_t>(i)]));
    }
    EXPECT_LT(worst, 0.036) << "the tremor reaches 8 mm and turns as early, and the path turns too";
  }
}

TEST_P(PlaceLaws, NeverJumpsForATraineeThatStopsReversesAndLeaves) {
  for (const bool back : {false, true}) {
    PlaceTracker tracker(path_, {.allow_back = back});
    tracker.start();
    Tremble tremble(7);
    double before = 0;
    for (int i = 0; i <= 20000; ++i) {
      // Forward, a stop, back by a tenth, 3 cm away from the path and back to it, then forward to the end.
      const double t = i / 20000.0;
      const double u = t < 0.4 ? t : t < 0.5 ? 0.4 : t < 0.6 ? 0.4 - (t - 0.5) : 0.3 + 1.75 * (t - 0.6);
      const double away = t > 0.7 && t < 0.8 ? 0.03 * std::sin(pi * 10 * (t - 0.7)) : 0;
      const auto& foot = tracker.update(GetParam().at(u) + Vec3(0, 0, away) + 0.5 * tremble.next(), 1e-3);
      ASSERT_LE(foot.certainty > 0 ? std::abs(foot.s - before) : 0, 2e-3 + 1e-9) << t;
      before = foot.s;
    }
    EXPECT_GT(before, 0.9 * path_.length()) << "and arrives";
  }
}

TEST_P(PlaceLaws, AllocatesNothing) {
  PlaceTracker tracker(path_, {});
  const std::size_t before = test::allocations();
  for (int i = 0; i <= 1000; ++i) (void)tracker.update(GetParam().at(i / 1000.0), 8e-3);
  EXPECT_EQ(test::allocations(), before);
}

INSTANTIATE_TEST_SUITE_P(All, PlaceLaws, testing::ValuesIn(kCurves),
                         [](const auto& tested) { return tested.param.name; });

/// The results of all trials of some departures on all strokes.
struct Tally {
  int trials = 0, kept = 0, jumps = 0;
  double wall = 0, fastest = 0;
  std::vector<double> wrong;  ///< longest time at a wrong place, of the trials that have one [s]
};

Tally tally(const std::vector<test::Departure>& departures, int trials, std::uint64_t seed) {
  Tally tally;
  for (const test::Stroke& stroke : test::strokes()) {
    const ArcPath path = test::path_of(stroke, 5e-3);
    for (const test::Departure& departure : departures) {
      if (departure.early > 0 && stroke.corners.empty()) continue;
      for (int i = 0; i < trials; ++i) {
        const auto number = seed + static_cast<std::uint64_t>(tally.trials);
        const test::Verdict verdict = test::judge(path, test::trial_of(stroke, path, departure, number));
        ++tally.trials;
        tally.kept += verdict.kept ? 1 : 0;
        tally.jumps += verdict.jumps;
        tally.wall = std::max(tally.wall, verdict.wrong_wall);
        tally.fastest = std::max(tally.fastest, verdict.fastest);
        if (verdict.longest_wrong > 0) tally.wrong.push_back(verdict.longest_wrong);
      }
    }
  }
  std::sort(tally.wrong.begin(), tally.wrong.end());
  return tally;
}

constexpr double kNoWall = 1e-4;  // depth of a wrong wall that nobody feels [m]

TEST(PlaceTracker, KeepsEveryGoodTrainee) {
  const Tally good = tally({{.noise = 1e-3}, {.noise = 2e-3}, {.speed = 0.5}, {.speed = 4}, {.stop = 3}}, 1, 900);
  EXPECT_GE(good.kept, 0.98 * good.trials);
  EXPECT_EQ(good.jumps, 0);
  EXPECT_LE(good.wall, kNoWall);
}

TEST(PlaceTracker, KeepsTraineesWhoDrawAnotherSizeOrElsewhereOrTurned) {
  const double degree = pi / 180;
  const Tally drawn =
      tally({{.scale = 0.7}, {.scale = 1.3}, {.shift = 10e-3}, {.shift = 15e-3}, {.rotation = 20 * degree}}, 1, 1900);
  EXPECT_EQ(drawn.kept, drawn.trials);
  EXPECT_LE(drawn.wall, kNoWall);
}

TEST(PlaceTracker, KeepsTraineesWhoTurnEarlyAndCutCorners) {
  const Tally early = tally({{.early = 2.7e-3}, {.early = 8e-3}, {.early = 15e-3}}, 2, 2900);
  EXPECT_EQ(early.kept, early.trials);
  EXPECT_LE(early.wall, kNoWall);
}

TEST(PlaceTracker, KeepsTraineesWhoShakeAtOneSpotOfTheWay) {
  const Tally shaking = tally({{.shake = 2e-3}, {.shake = 3e-3}, {.shake = 4e-3}}, 1, 5900);
  EXPECT_GE(shaking.kept, 0.93 * shaking.trials);
  EXPECT_LE(shaking.jumps, 1);
  EXPECT_LE(shaking.wall, kNoWall);
}

TEST(PlaceTracker, KeepsTraineesWhoGoBackFarWhereThatDiffersFromAnotherStrand) {
  for (const test::Stroke& stroke : test::strokes()) {
    const std::array retraced{"line and back", "stretch three times", "hairpin", "zigzag", "script"};
    if (std::find(retraced.begin(), retraced.end(), stroke.name) != retraced.end()) continue;
    const ArcPath path = test::path_of(stroke, 5e-3);
    for (const test::Departure& departure : {test::Departure{.back = 0.06}, {.back = 0.1}, {.again = true}})
      for (std::uint64_t seed = 4900; seed < 4903; ++seed) {
        const test::Verdict verdict = test::judge(path, test::trial_of(stroke, path, departure, seed));
        EXPECT_TRUE(verdict.kept) << stroke.name << ", " << departure.back << " m, seed " << seed << ": wrong for "
                                  << verdict.longest_wrong << " s";
        EXPECT_LE(verdict.wrong_wall, 2e-3) << stroke.name << ", " << departure.back << " m, seed " << seed;
      }
  }
}

TEST(PlaceTracker, FindsTraineesAgainWhoSkipGoBackWanderOrStartInTheMiddle) {
  const Tally lost = tally({{.back = 0.02}, {.skip = 0.05}, {.middle = true}, {.wander = 0.05}}, 1, 3900);
  EXPECT_GE(lost.kept, 0.85 * lost.trials);
  ASSERT_FALSE(lost.wrong.empty());
  EXPECT_LE(lost.wrong[lost.wrong.size() / 2], 0.5);
  EXPECT_LE(lost.fastest, 2e-3) << "while the place bears force";
}

TEST(PlaceTracker, SeesNoDifferenceBetweenAPathAndItsEnlargement) {
  const test::Stroke small = test::strokes()[3];
  test::Stroke large = small;
  for (Vec3& p : large.points) p *= 2;
  const ArcPath path = test::path_of(small, 5e-3), twice = test::path_of(large, 10e-3);
  const test::Trial trial = test::trial_of(small, path, {.early = 8e-3}, 4);
  PlaceTracker tracker(path, {}), of_twice(twice, {.max_speed = 4});
  // Knots a fixed distance apart cut the corners of the smaller path more.
  const double ratio = path.length() / twice.length();
  std::size_t differ = 0;
  for (const Vec3& hand : trial.hand) {
    const double s = tracker.update(hand, 1e-3).s;
    differ += std::abs(ratio * of_twice.update(2 * hand, 1e-3).s - s) > 2e-3 ? 1 : 0;
  }
  EXPECT_LT(differ, trial.hand.size() / 10) << "slides are bounded in metres a second, and take twice as long";
}

TEST(PlaceTracker, FollowsATraineeThatTurnsBeforeTheEndOfAStroke) {
  const ArcPath path = place_path_of(kCurves[2]);  // a line of 0.1 m, there and back
  PlaceTracker tracker(path, {});
  double before = 0;
  const auto move = [&](double x) {
    const double s = tracker.update(Vec3(x, 5e-4, 0), 1e-3).s;
    EXPECT_LE(std::abs(s - before), 2e-3 + 1e-9) << "it slides";
    before = s;
  };
  for (int i = 0; i <= 920; ++i) move(1e-4 * i);
  for (int i = 920; i >= 500; --i) move(1e-4 * i);
  EXPECT_NEAR(before, 0.15, 1e-3);
}

TEST(PlaceTracker, LetsWallsHoldATraineeWhoReturnsUnlessThatIsAllowed) {
  const ArcPath path = place_path_of(kCurves[0]);
  for (const bool back : {false, true}) {
    PlaceTracker tracker(path, {.allow_back = back});
    for (int i = 0; i <= 600; ++i) (void)tracker.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
    EXPECT_NEAR(tracker.foot().s, 0.06, 1e-4);
    for (int i = 600; i >= 300; --i) (void)tracker.update(Vec3(1e-4 * i, 1e-3, 0), 1e-3);
    EXPECT_NEAR(tracker.foot().s, 0.03, 0.013) << "the place is late: most trainees do not return";
    EXPECT_NEAR(tracker.foot().tube.distance, back ? 1e-3 : std::hypot(0.03, 1e-3), 2e-3);
  }
}

TEST(PlaceTracker, LetsTheExpertRestWhileItHoldsThePlace) {
  const ArcPath path = place_path_of(kCurves[0]);
  PlaceTracker tracker(path, {});
  for (int i = 0; i <= 600; ++i) (void)tracker.update(Vec3(1e-4 * i, 0, 0), 1e-3);
  EXPECT_GT(tracker.foot().expert_speed, 0.01) << "the path ends in full movement";
  EXPECT_EQ(tracker.hold(Vec3(0.06, 0, 0), 1e-3).expert_speed, 0) << "help for the slow would push the hand";
  (void)tracker.update(Vec3(0.0601, 0, 0), 1e-3);
  EXPECT_GT(tracker.foot().expert_speed, 0.01);
}

TEST(PlaceTracker, DoubtsAPlaceThatMayBeOnEitherLegAndGrowsCertainAgain) {
  const ArcPath path = place_path_of(kCurves[2]);
  PlaceTracker tracker(path, {});
  double least = 1;
  for (int i = 0; i <= 900; ++i) (void)tracker.update(Vec3(1e-4 * i, 0, 0), 1e-3);
  EXPECT_EQ(tracker.foot().certainty, 1);
  EXPECT_TRUE(std::isnan(tracker.rival()));
  for (int i = 900; i >= 300; --i)
    least = std::min(least, tracker.update(Vec3(1e-4 * i, 0, 0), 1e-3).heading_certainty);
  EXPECT_LT(least, 0.7);
  EXPECT_EQ(tracker.foot().heading_certainty, 1);
  EXPECT_EQ(tracker.foot().certainty, 1) << "both legs have the same force, which is none";
}

TEST(PlaceTracker, FindsATraineeFarAwayOnALongPathAndMovesThereWithoutForces) {
  // Rows in three layers, 4 m in all. After 1 m, the trainee continues 2 m later.
  ArcPath::Builder builder(2.5e-4);
  const auto at = [](double s) {
    const double row = std::floor(s / 0.12), x = s - 0.12 * row, layer = std::floor(row / 10);
    return Vec3(std::fmod(row, 2) == 0 ? x : 0.12 - x, 13e-3 * (row - 10 * layer), 0.05 * layer);
  };
  for (int i = 0; i <= 35900; ++i) builder.add(1e-3 * i, at(1e-4 * i), Vec3::Zero());
  const ArcPath path = builder.finish(2e-3);
  ASSERT_GT(path.length(), 3);
  const auto nearest = [&](const Vec3& hand) { return path.nearest_between(0, path.length(), hand).s; };
  PlaceTracker tracker(path, {});
  double before = 0, fastest = 0;
  const auto move = [&](const Vec3& hand) {
    const auto& foot = tracker.update(hand, 1e-3);
    if (foot.certainty > 0) fastest = std::max(fastest, std::abs(foot.s - before));
    before = foot.s;
  };
  for (int i = 0; i <= 10000; ++i) move(at(1e-4 * i));
  EXPECT_NEAR(before, nearest(at(1)), 2e-3);
  for (int i = 0; i <= 1000; ++i) move(at(1) + 1e-3 * i * (at(3) - at(1)));
  for (int i = 30000; i <= 35000; ++i) move(at(1e-4 * i));
  EXPECT_NEAR(before, nearest(at(3.5)), 2e-3);
  EXPECT_LE(fastest, 2e-3 + 1e-9);
}

}  // namespace
}  // namespace haptrace
