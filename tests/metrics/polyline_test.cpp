#include "metrics/polyline.h"

#include "metrics/path_alignment.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <string>

namespace haptrace {
namespace {

using test::error_of;

std::vector<Vec3> points_of(int count, const std::function<Vec3(double)>& curve) {
  std::vector<Vec3> points;
  for (int i = 0; i <= count; ++i) points.push_back(curve(static_cast<double>(i) / count));
  return points;
}

Vec3 ring(double u) {
  const double angle = 2 * std::numbers::pi * u;
  return {0.05 * std::cos(angle), 0.05 * std::sin(angle), 0};
}

Vec3 figure_eight(double u) {
  const double angle = 2 * std::numbers::pi * u;
  return {0.05 * std::sin(angle), 0.05 * std::sin(angle) * std::cos(angle), 0};
}

Vec3 to_and_fro(double u) {
  return {0.1 * (u < 0.5 ? 2 * u : 2 - 2 * u), 0, 0};
}

Vec3 square(double u) {
  const double side = 4 * u, along = 0.1 * (side - std::floor(side));
  if (side < 1) return {along, 0, 0};
  if (side < 2) return {0.1, along, 0};
  if (side < 3) return {0.1 - along, 0.1, 0};
  if (side < 4) return {0, 0.1 - along, 0};
  return Vec3::Zero();
}

TEST(Polyline, HasTheLengthOfItsCurve) {
  EXPECT_NEAR(Polyline(points_of(5000, ring)).length(), 0.1 * std::numbers::pi, 1e-7);
  EXPECT_NEAR(Polyline(points_of(4, square)).length(), 0.4, 1e-15);
}

TEST(Polyline, RunsThroughItsPointsAtTheirArcLengths) {
  const Polyline curve(points_of(4, square));
  EXPECT_NEAR((curve.at(0.05) - Vec3(0.05, 0, 0)).norm(), 0, 1e-15);
  EXPECT_NEAR((curve.at(0.25) - Vec3(0.05, 0.1, 0)).norm(), 0, 1e-15);
  EXPECT_EQ(curve.at(-1), Vec3::Zero());
  EXPECT_EQ(curve.at(kNaN), Vec3::Zero());
  EXPECT_EQ(curve.at(9), curve.at(curve.length()));
}

TEST(Polyline, IsTheSameCurveHoweverItWasSampled) {
  auto dense = points_of(4000, square);
  dense.insert(dense.begin() + 700, 50, dense[700]);  // the hand rests
  dense.insert(dense.begin() + 100, nan3());
  const Polyline a(dense), b(points_of(4, square));
  EXPECT_NEAR(a.length(), b.length(), 1e-12);
  for (double s = 0; s <= 0.4; s += 0.0137) EXPECT_NEAR((a.at(s) - b.at(s)).norm(), 0, 1e-12) << s;
}

TEST(Polyline, SearchesTheNearestPointOnlyWithinTheGivenRange) {
  const Polyline curve(points_of(1000, to_and_fro));
  EXPECT_NEAR(curve.nearest({0.03, 0.01, 0}, 0, 0.1), 0.03, 1e-12);
  EXPECT_NEAR(curve.nearest({0.03, 0.01, 0}, 0.1, 0.2), 0.17, 1e-12);
  EXPECT_NEAR(curve.nearest({0.03, 0.01, 0}, 0.04, 0.05), 0.04, 1e-12);
  EXPECT_NEAR(curve.nearest({0.03, 0.01, 0}, 0.01, 0.02), 0.02, 1e-12);
  EXPECT_EQ(curve.nearest({-1, 0, 0}, 0, 1), 0);
}

TEST(Polyline, IsCutEvenly) {
  const Polyline curve(points_of(1000, ring));
  const auto points = curve.resampled(1e-3);
  ASSERT_EQ(points.size(), 315U);
  for (std::size_t i = 1; i < points.size(); ++i) EXPECT_NEAR((points[i] - points[i - 1]).norm(), 1e-3, 1e-5) << i;
  EXPECT_EQ(points.back(), curve.at(curve.length()));
}

TEST(Polyline, OnePointIsACurveWithoutLength) {
  const std::vector<Vec3> points(10, Vec3(1, 2, 3));
  const Polyline curve(points);
  EXPECT_EQ(curve.length(), 0);
  EXPECT_EQ(curve.at(0.1), Vec3(1, 2, 3));
  EXPECT_EQ(curve.nearest(Vec3::Zero(), -1, 1), 0);
  EXPECT_EQ(curve.resampled(1e-3).size(), 1U);
}

TEST(Polyline, ReportsInvalidInput) {
  EXPECT_THAT(error_of([] { return Polyline({}); }), testing::HasSubstr("finite point"));
  EXPECT_THAT(error_of([] { return Polyline(std::vector<Vec3>{nan3()}); }), testing::HasSubstr("finite point"));
  const Polyline curve(points_of(1000, ring));
  for (const double spacing : {0.0, -1.0, kNaN, 1e-9})
    EXPECT_THAT(error_of([&] { return curve.resampled(spacing); }), testing::HasSubstr("cannot be divided")) << spacing;
}

struct Track {
  std::string name;
  Vec3 (*curve)(double);
};

class FootPoints : public testing::TestWithParam<Track> {};

TEST_P(FootPoints, StayOnTheBranchThatTheHandIsOn) {
  const Polyline curve(points_of(2000, GetParam().curve));
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1e-4);
  for (const int samples : {1000, 4000}) {  // samples of one pass along the curve
    std::vector<Vec3> hand = points_of(samples, GetParam().curve);
    std::vector<double> truth;
    for (const Vec3& p : hand) truth.push_back(truth.empty() ? 0 : truth.back() + (p - hand[truth.size() - 1]).norm());
    // The hand wanders by 2 mm and trembles.
    for (std::size_t i = 0; i < hand.size(); ++i) {
      const double angle = 20 * std::numbers::pi * static_cast<double>(i) / samples;
      hand[i] += 2e-3 * Vec3(std::sin(angle), std::cos(0.7 * angle), std::sin(1.3 * angle)) +
                 Vec3(noise(random), noise(random), noise(random));
    }
    const auto feet = align_with_path(curve, hand).arc;
    for (std::size_t i = 0; i < feet.size(); ++i) ASSERT_NEAR(feet[i], truth[i], 0.0125) << samples << ", sample " << i;
  }
}

TEST_P(FootPoints, LieAtTheHandThatIsOnTheCurve) {
  const Polyline curve(points_of(2000, GetParam().curve));
  const auto hand = points_of(3000, GetParam().curve);
  const auto feet = align_with_path(curve, hand).arc;
  for (std::size_t i = 0; i < feet.size(); ++i) EXPECT_NEAR((curve.at(feet[i]) - hand[i]).norm(), 0, 1e-4) << i;
}

INSTANTIATE_TEST_SUITE_P(All, FootPoints,
                         testing::Values(Track{"circle", ring}, Track{"figure_eight", figure_eight},
                                         Track{"to_and_fro", to_and_fro}, Track{"square", square}),
                         [](const auto& tested) { return tested.param.name; });

TEST(FootPoint, IsMissingWhereTheHandIsMissing) {
  const Polyline curve(points_of(2000, square));
  auto hand = points_of(1000, square);
  std::fill(hand.begin() + 200, hand.begin() + 240, nan3());  // a gap of 16 mm
  const auto feet = align_with_path(curve, hand).arc;
  EXPECT_TRUE(std::isnan(feet[220]));
  EXPECT_NEAR(feet[199], 0.0796, 1e-4);
  EXPECT_NEAR(feet[240], 0.096, 1e-4);
  EXPECT_TRUE(align_with_path(curve, {}).arc.empty());
}

TEST(FootPoint, FollowsAFastHandThatIsSampledSlowly) {
  const std::vector<Vec3> line{Vec3::Zero(), Vec3(2, 0, 0)};
  const Polyline curve(line);
  const auto hand = points_of(20, [](double u) { return Vec3(2 * u, 0.01, 0); });  // 100 mm per sample
  EXPECT_NEAR(align_with_path(curve, hand).arc.back(), 2, 1e-12);
}

/// Returns the arc length of the nearest point between `from` and `to` [m], searched in every segment in order.
double nearest_of_all(std::span<const Vec3> points, const Vec3& point, double from, double to) {
  double best = from, least = std::numeric_limits<double>::infinity(), begin = 0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double size = (points[i + 1] - points[i]).norm();
    if (begin + size >= from && begin <= to) {
      const Vec3 along = (points[i + 1] - points[i]) / size;
      const double s =
          std::clamp(begin + along.dot(point - points[i]), std::max(begin, from), std::min(begin + size, to));
      const double distance = (points[i] + (s - begin) * along - point).norm();
      if (distance < least) {
        least = distance;
        best = s;
      }
    }
    begin += size;
  }
  return best;
}

TEST(Polyline, FindsTheNearestOfAllSegmentsThoughItLooksAtFew) {
  std::mt19937_64 random(7);
  const auto between = [&](double a, double b) { return std::uniform_real_distribution(a, b)(random); };
  for (int curve_number = 0; curve_number < 40; ++curve_number) {
    // A random walk that turns, crosses itself and has segments from a micrometre to centimetres.
    std::vector<Vec3> points{Vec3::Zero()};
    const double scale = std::pow(10, between(-6, -2));
    Vec3 direction = Vec3::UnitX();
    for (int i = 0; i < 400; ++i) {
      direction += 0.6 * Vec3(between(-1, 1), between(-1, 1), between(-1, 1));
      direction.normalize();
      points.push_back(points.back() + scale * std::pow(10, between(-1, 0.5)) * direction);
    }
    const Polyline curve(points);
    for (int i = 0; i < 200; ++i) {
      double from = between(0, curve.length()), to = between(0, curve.length());
      if (from > to) std::swap(from, to);
      const Vec3 off = scale * between(0, 20) * Vec3(between(-1, 1), between(-1, 1), 0);
      const Vec3 point = curve.at(between(0, curve.length())) + off;
      const double found = curve.nearest(point, from, to), all = nearest_of_all(points, point, from, to);
      EXPECT_NEAR((curve.at(found) - point).norm(), (curve.at(all) - point).norm(), 1e-9 * scale) << curve_number;
      EXPECT_NEAR(found, all, 1e-6 * scale) << curve_number;
    }
  }
}

}  // namespace
}  // namespace haptrace
