#include "report/thinning.h"

#include "metrics/polyline.h"

#include <cmath>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

TEST(Thinning, KeepsEveryPeakAndStaysWithinItsTolerance) {
  std::vector<double> arc, value;
  for (int i = 0; i < 50'000; ++i) {
    arc.push_back(1e-5 * i);
    value.push_back(1e-3 * std::sin(2e-3 * i) + (i == 31'234 ? 5e-3 : 0));  // one sample sticks out
  }
  const ReportLine line = thinned(arc, value, 300);
  EXPECT_LE(line.arc.size(), 300);
  EXPECT_GT(line.arc.size(), 50);
  EXPECT_NEAR(*std::max_element(line.value.begin(), line.value.end()), *std::max_element(value.begin(), value.end()),
              1e-9);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < line.arc.size(); ++i) points.emplace_back(line.arc[i] / 0.5, line.value[i] / 6e-3, 0);
  const Polyline drawn(points);
  for (std::size_t i = 0; i < arc.size(); i += 97) {
    const Vec3 p(arc[i] / 0.5, value[i] / 6e-3, 0);
    EXPECT_LT((p - drawn.at(drawn.nearest(p, 0, drawn.length()))).norm(), 5e-3);
  }
}

TEST(Thinning, BoundsTheNumberOfPointsOfNoise) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise;
  std::vector<Vec3> points;
  for (int i = 0; i < 20'000; ++i) points.emplace_back(noise(random), noise(random), noise(random));
  EXPECT_LE(thinned(points, 400).size(), 400);
}

TEST(Thinning, AcceptsLinesThatAreEmptyAtRestOrNotFinite) {
  EXPECT_TRUE(thinned(std::vector<Vec3>{}, 10).empty());
  EXPECT_TRUE(thinned(std::vector<Vec3>{nan3(), nan3()}, 10).empty());
  EXPECT_EQ(thinned(std::vector<Vec3>(1000, Vec3(1, 2, 3)), 10).size(), 1);
  const std::vector<Vec3> line{{0, 0, 0}, nan3(), {0.5, 0, 0}, {1, 0, 0}};
  const std::vector<Vec3> thin = thinned(line, 10);
  ASSERT_EQ(thin.size(), 2);
  EXPECT_EQ(thin.back(), Vec3(1, 0, 0));
}

}  // namespace
}  // namespace haptrace
