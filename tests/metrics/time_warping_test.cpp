#include "metrics/time_warping.h"

#include "tests/support/errors.h"

#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;

Polyline curve_of(const std::function<Vec3(double)>& curve, int count = 2000) {
  std::vector<Vec3> points;
  for (int i = 0; i <= count; ++i) points.push_back(curve(static_cast<double>(i) / count));
  return Polyline(points);
}

Vec3 wave(double u) {
  return {0.2 * u, 0.02 * std::sin(9 * u), 0.01 * std::cos(4 * u)};
}

Vec3 flatter(double u) {
  return {0.2 * u, 0.015 * std::sin(9 * u + 0.3), 0.01 * std::cos(4 * u)};
}

/// Returns the distance by Sakoe and Chiba's recursion over the whole matrix [m].
double reference_distance(const Polyline& a, const Polyline& b, double spacing, double band) {
  const auto p = a.resampled(spacing), q = b.resampled(spacing);
  const auto infinity = std::numeric_limits<double>::infinity();
  std::vector<std::vector<double>> sum(p.size(), std::vector<double>(q.size(), infinity));
  sum[0][0] = 2 * (p[0] - q[0]).norm();
  for (std::size_t i = 0; i < p.size(); ++i)
    for (std::size_t j = 0; j < q.size(); ++j) {
      if (std::abs(static_cast<double>(i) - static_cast<double>(j)) > band / spacing || i + j == 0) continue;
      const double d = (p[i] - q[j]).norm();
      if (i > 0) sum[i][j] = std::min(sum[i][j], sum[i - 1][j] + d);
      if (j > 0) sum[i][j] = std::min(sum[i][j], sum[i][j - 1] + d);
      if (i > 0 && j > 0) sum[i][j] = std::min(sum[i][j], sum[i - 1][j - 1] + 2 * d);
    }
  return sum.back().back() / static_cast<double>(p.size() + q.size());
}

TEST(TimeWarping, IsZeroForEqualShapes) {
  EXPECT_EQ(*warping_distance(curve_of(wave), curve_of(wave)), 0);
}

TEST(TimeWarping, IsTheSameBothWays) {
  const double there = *warping_distance(curve_of(wave), curve_of(flatter));
  EXPECT_NEAR(*warping_distance(curve_of(flatter), curve_of(wave)), there, 1e-15);
  EXPECT_GT(there, 1e-3);
}

TEST(TimeWarping, DoesNotDependOnSpeedOrRate) {
  const double even = *warping_distance(curve_of(wave), curve_of(flatter));
  const auto hesitant = curve_of([](double u) { return wave(u * u * (3 - 2 * u)); }, 5000);
  EXPECT_NEAR(*warping_distance(hesitant, curve_of(flatter, 500)), even, 1e-6);
}

TEST(TimeWarping, DoesNotDependOnPlaceAndDirection) {
  const Eigen::AngleAxisd turn(0.7, Vec3(1, 2, 3).normalized());
  const auto moved = [&](Vec3 (*curve)(double)) {
    return curve_of([&turn, curve](double u) -> Vec3 { return turn * curve(u) + Vec3(0.1, -2, 0.4); });
  };
  EXPECT_NEAR(*warping_distance(moved(wave), moved(flatter)), *warping_distance(curve_of(wave), curve_of(flatter)),
              1e-9);
}

TEST(TimeWarping, GrowsWithTheScaleOfBoth) {
  const auto scaled = [](Vec3 (*curve)(double)) {
    return curve_of([curve](double u) -> Vec3 { return 3 * curve(u); });
  };
  EXPECT_NEAR(*warping_distance(scaled(wave), scaled(flatter), {.spacing = 3e-3, .band = 60e-3}),
              3 * *warping_distance(curve_of(wave), curve_of(flatter)), 1e-12);
}

TEST(TimeWarping, EqualsTheDistanceOfParallelLines) {
  const auto line = [](double y) { return curve_of([y](double u) { return Vec3(0.1 * u, y, 0); }); };
  EXPECT_NEAR(*warping_distance(line(0), line(0.007)), 0.007, 1e-12);
}

TEST(TimeWarping, MatchesTheWholeMatrix) {
  for (const double band : {15e-3, 20e-3, 50e-3, 1.0})
    EXPECT_NEAR(*warping_distance(curve_of(wave), curve_of(flatter), {.band = band}),
                reference_distance(curve_of(wave), curve_of(flatter), 1e-3, band), 1e-15)
        << band;
}

TEST(TimeWarping, DoesNotGrowWithAWiderBand) {
  double last = std::numeric_limits<double>::infinity();
  for (const double band : {15e-3, 17e-3, 20e-3, 40e-3, 80e-3}) {
    const double distance = *warping_distance(curve_of(wave), curve_of(flatter), {.band = band});
    EXPECT_LE(distance, last) << band;
    last = distance;
  }
}

TEST(TimeWarping, RefusesABandThatCannotJoinTheEnds) {
  const auto line = [](double length) { return curve_of([length](double u) { return Vec3(length * u, 0, 0); }); };
  EXPECT_TRUE(warping_distance(line(0.1), line(0.12), {.band = 20e-3}));
  EXPECT_THAT(error_of([&] { return warping_distance(line(0.1), line(0.121), {.band = 20e-3}); }),
              testing::HasSubstr("wider"));
  EXPECT_THAT(error_of([&] { return warping_distance(line(0.121), line(0.1), {.band = 20e-3}); }),
              testing::HasSubstr("wider"));
  for (const double bad : {0.0, -1.0, kNaN})
    EXPECT_THAT(error_of([&] { return warping_distance(line(0.1), line(0.1), {.spacing = bad}); }),
                testing::HasSubstr("spacing"));
}

TEST(TimeWarping, IsUndefinedForAPathWithoutLength) {
  const std::vector<Vec3> rest(10, Vec3(1, 2, 3));
  EXPECT_FALSE(warping_distance(Polyline(rest), curve_of(wave)));
  EXPECT_FALSE(warping_distance(curve_of(wave), Polyline(rest)));
}

TEST(TimeWarping, EqualsTheDistanceOfTheEndsOfVeryShortPaths) {
  const std::vector<Vec3> a{Vec3::Zero(), Vec3(1e-5, 0, 0)}, b{Vec3(0, 3e-5, 0), Vec3(1e-5, 3e-5, 0)};
  EXPECT_NEAR(*warping_distance(Polyline(a), Polyline(b)), 3e-5, 1e-12);
}

// 40 m in steps of 1 mm: the whole matrix would be 13 GB.
TEST(TimeWarping, TakesLongPaths) {
  const auto coil = [](double radius) {
    return curve_of(
        [radius](double u) {
          const double angle = 2 * std::numbers::pi * 64 * u;
          return Vec3(radius * std::cos(angle), radius * std::sin(angle), 0.5 * u);
        },
        100000);
  };
  EXPECT_LT(*warping_distance(coil(0.1), coil(0.1 + 1e-5)), 0.26e-3);  // a quarter of the spacing
}

}  // namespace
}  // namespace haptrace
