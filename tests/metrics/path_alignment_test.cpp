// Alignment of whole trials with their path.
#include "metrics/path_alignment.h"

#include "control/path/shapes.h"
#include "metrics/deviation.h"
#include "tests/metrics/support.h"

#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

/// A movement at even speed through corners.
std::vector<Vec3> along(const std::vector<Vec3>& corners, double step = 1e-4) {
  return Polyline(corners).resampled(step);
}

/// Returns the contour error of positions at 1 kHz.
Deviation contour_of(const Polyline& curve, const std::vector<Vec3>& hand, const PathAlignment& found) {
  std::vector<double> time;
  for (std::size_t i = 0; i < hand.size(); ++i) time.push_back(1e-3 * static_cast<double>(i));
  return contour_deviation(time, hand, curve, found.arc).value();
}

Deviation contour_of(const Polyline& curve, const std::vector<Vec3>& hand) {
  return contour_of(curve, hand, align_with_path(curve, hand));
}

const std::vector<Vec3>& out_and_back() {
  static const std::vector<Vec3> kLine{{0, 0, 0}, {0.1, 0, 0}, {0, 0, 0}};
  return kLine;
}

std::vector<Vec3> square_of(double side) {
  const double h = side / 2;
  return {{-h, -h, 0}, {h, -h, 0}, {h, h, 0}, {-h, h, 0}, {-h, -h, 0}};
}

TEST(PathAlignment, KeepsAHandThatTurnsEarlyOnItsBranch) {
  const Polyline curve(out_and_back());
  for (const double early : {2e-3, 8e-3, 15e-3}) {
    const std::vector<Vec3> hand = along({{0, 1e-3, 0}, {0.1 - early, 1e-3, 0}, {0, 1e-3, 0}});
    const PathAlignment found = align_with_path(curve, hand);
    EXPECT_NEAR(contour_of(curve, hand, found).rms, 1e-3, 1e-4) << early;
    EXPECT_NEAR(found.arc.back(), 0.2, 1e-6);
    const double half = (0.1 - early) / 2;
    EXPECT_NEAR(found.arc[hand.size() / 4], half, 0.001);
    EXPECT_NEAR(found.arc[3 * hand.size() / 4], 0.2 - half, 0.001);
    EXPECT_GE(found.covered, 0.2 - 2 * early - 3e-3);
  }
}

TEST(PathAlignment, MeasuresAShapeThatWasDrawnTooSmallByItsDistance) {
  // Every side at 70 % is 15 % of the large side inside it.
  for (const double side : {0.056, 0.08}) {
    const Polyline curve(square_of(side));
    const Deviation small = contour_of(curve, along(square_of(0.7 * side)));
    EXPECT_NEAR(small.rms, 0.15 * side, 1e-3 * side) << side;
    EXPECT_NEAR(small.peak, 0.15 * side, 0.015 * side) << "at a corner the place waits a little";
  }
}

TEST(PathAlignment, FollowsEveryLapAndEveryBranchThere) {
  for (const char* kind : {"figure8", "circle"}) {
    const Polyline curve(make_shape(kind, {.duration = 12, .turns = 3}).position);
    std::vector<Vec3> hand = curve.resampled(2e-4);
    for (std::size_t i = 0; i < hand.size(); ++i)
      hand[i] += 2e-3 * Vec3(0, std::sin(0.011 * static_cast<double>(i)), 0);
    const PathAlignment found = align_with_path(curve, hand);
    EXPECT_TRUE(found.jumps.empty()) << kind;
    EXPECT_GT(found.covered, 0.995 * curve.length()) << kind;
    for (std::size_t i = 0; i < hand.size(); i += 50)
      ASSERT_NEAR(found.arc[i], 2e-4 * static_cast<double>(i), 6e-3) << kind << ' ' << i;
  }
}

TEST(PathAlignment, StaysOnItsStrandWhenTheHandIsShifted) {
  // A zigzag with legs of 45 mm, 12 mm apart.
  std::vector<Vec3> corners;
  for (int i = 0; i < 12; ++i) corners.emplace_back(0.012 * i, i % 2 == 0 ? 0 : 0.045, 0);
  const Polyline curve(corners);
  std::vector<Vec3> hand = along(corners);
  const std::size_t rows = hand.size();
  for (Vec3& p : hand) p.x() += 5e-3;
  const PathAlignment found = align_with_path(curve, hand);
  for (std::size_t i = 0; i < rows; i += 20)
    ASSERT_NEAR(found.arc[i], curve.length() * static_cast<double>(i) / static_cast<double>(rows - 1), 0.02) << i;
  EXPECT_LT(contour_of(curve, hand, found).peak, 5.1e-3);
}

TEST(PathAlignment, CountsALeftOutPartAsNotCovered) {
  const Polyline curve(std::vector<Vec3>{{0, 0, 0}, {0.1, 0, 0}, {0.1, 0.05, 0}, {0, 0.05, 0}});
  // From the middle of the first side straight to the middle of the last.
  const std::vector<Vec3> hand = along({{0, 0, 0}, {0.05, 0, 0}, {0.05, 0.05, 0}, {0, 0.05, 0}});
  const PathAlignment found = align_with_path(curve, hand);
  EXPECT_NEAR(found.covered, 0.1, 0.04);
  EXPECT_LT(found.covered, 0.15) << "150 mm of 250 mm were left out but for the ends";
  EXPECT_FALSE(found.jumps.empty());
  EXPECT_NEAR(found.farthest, curve.length(), 1e-6);
  // The force along the path has no value there.
  const std::vector<Vec3> force(hand.size(), Vec3::UnitX());
  const std::vector<Vec3> cells = force_by_arc_length(found.arc, force, curve.length(), 1e-3, found.jumps);
  EXPECT_TRUE(is_finite(cells[20]));
  EXPECT_FALSE(is_finite(cells[125]));
  EXPECT_TRUE(is_finite(force_by_arc_length(found.arc, force, curve.length(), 1e-3)[125])) << "without the jumps";
}

TEST(PathAlignment, CountsARepeatedPartOnce) {
  const Polyline curve(std::vector<Vec3>{{0, 0, 0}, {0.1, 0, 0}});
  const PathAlignment found =
      align_with_path(curve, along({{0, 0, 0}, {0.06, 0, 0}, {0.01, 0, 0}, {0.08, 0, 0}, {0.07, 0, 0}}));
  EXPECT_NEAR(found.covered, 0.08, 1e-4);
  EXPECT_NEAR(found.farthest, 0.08, 1e-4);
}

TEST(PathAlignment, GivesTheSamePlacesAtEverySpeedAndRate) {
  const Polyline curve(square_of(0.08));
  const std::vector<Vec3> slow = along(square_of(0.07), 2e-5);
  std::vector<Vec3> fast, rests;
  for (std::size_t i = 0; i < slow.size(); ++i) {
    if (i % 20 == 0) fast.push_back(slow[i]);
    rests.push_back(slow[i]);
    if (i == slow.size() / 3) rests.insert(rests.end(), 5000, slow[i]);
  }
  const PathAlignment a = align_with_path(curve, slow), b = align_with_path(curve, fast),
                      c = align_with_path(curve, rests);
  for (std::size_t i = 0; i < fast.size(); ++i) ASSERT_NEAR(a.arc[20 * i], b.arc[i], 2e-3) << i;
  EXPECT_NEAR(a.covered, b.covered, 1e-3);
  EXPECT_NEAR(c.covered, b.covered, 1e-3);
}

TEST(PathAlignment, AcceptsAnyInput) {
  const Polyline curve(square_of(0.08));
  EXPECT_TRUE(align_with_path(curve, {}).arc.empty());
  const PathAlignment missing = align_with_path(curve, std::vector<Vec3>(5, nan3()));
  EXPECT_EQ(missing.arc.size(), 5U);
  EXPECT_TRUE(std::isnan(missing.arc[0]));
  EXPECT_EQ(missing.covered, 0);
  const PathAlignment far =
      align_with_path(curve, std::vector<Vec3>{{0, 0, 0}, {1e300, 0, 0}, {-1e9, 3, 1}, {0, 0, 0}});
  for (const double s : far.arc) EXPECT_TRUE(s >= 0 && s <= curve.length()) << s;
  const Polyline point(std::vector<Vec3>{{1, 2, 3}});
  EXPECT_EQ(align_with_path(point, std::vector<Vec3>{{0, 0, 0}}).arc, std::vector<double>(1, 0.0));
  // A path of 30 m in a box of 0.1 m, followed to its end.
  std::vector<Vec3> winding;
  for (int i = 0; i < 300; ++i) winding.emplace_back(i % 2 == 0 ? 0 : 0.1, 3e-4 * i, 0);
  const Polyline longest(winding);
  const PathAlignment whole = align_with_path(longest, longest.resampled(1e-3));
  EXPECT_GT(whole.covered, 0.9 * longest.length());
}

TEST(PathAlignment, PutsAPointCurveUnderEveryHand) {
  const Polyline point(std::vector<Vec3>{{0.01, 0, 0}});
  const PathAlignment found = align_with_path(point, std::vector<Vec3>{{0, 0, 0}, {0.02, 0, 0}});
  EXPECT_EQ(found.farthest, 0);
}

TEST(Polyline, KeepsItsShapeWithFewerPoints) {
  std::vector<Vec3> dense;
  for (int i = 0; i <= 50'000; ++i) {
    const double angle = 2 * std::numbers::pi * i / 50'000;
    dense.emplace_back(0.04 * std::cos(angle), 0.04 * std::sin(angle), i > 25'000 ? 1e-3 : 0);
  }
  const Polyline curve(dense), few = curve.simplified(1e-6);
  EXPECT_NEAR(few.length(), curve.length(), 1e-6);
  EXPECT_LE(few.resampled(1).size(), 2U);
  double farthest = 0;
  for (double s = 0; s < curve.length(); s += 1e-4)
    farthest = std::max(farthest, (curve.at(s) - few.at(few.nearest(curve.at(s), s - 1e-3, s + 1e-3))).norm());
  EXPECT_LT(farthest, 1.01e-6);
  EXPECT_EQ(curve.simplified(0).length(), curve.length());
  EXPECT_EQ(Polyline(std::vector<Vec3>{{1, 1, 1}}).simplified(1e-6).length(), 0);
}

}  // namespace
}  // namespace haptrace
