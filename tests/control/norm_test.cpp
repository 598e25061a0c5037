#include "control/norm.h"

#include <gtest/gtest.h>
#include <limits>

namespace haptrace {
namespace {

TEST(TheNormOfAVector, IsExactForEveryRepresentableLength) {
  const Vec3 way(2, -3, 6);
  for (double scale = 1e-320; scale < 1e307; scale *= 10) {
    const double expected = 7 * scale;
    // Denormal numbers have few digits.
    EXPECT_NEAR(norm_of(scale * way), expected, 4e-16 * expected + 10 * std::numeric_limits<double>::denorm_min())
        << scale;
  }
}

TEST(TheNormOfAVector, IsZeroForZeroAndNaNForAMissingComponent) {
  EXPECT_EQ(norm_of(Vec3::Zero()), 0);
  EXPECT_EQ(norm_of(Vec3(0, -0.0, 0)), 0);
  EXPECT_TRUE(std::isnan(norm_of(Vec3(1, std::numeric_limits<double>::quiet_NaN(), 1))));
  EXPECT_FALSE(norm_of(Vec3(std::numeric_limits<double>::infinity(), 1, 1)) <= std::numeric_limits<double>::max());
}

}  // namespace
}  // namespace haptrace
