#include "control/path/min_jerk.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

namespace haptrace {
namespace {

TEST(MinJerk, RestsAtBothEndsAndOutside) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double u : {0.0, -1.0, -infinity, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_EQ(MinJerk::at(u).s, 0);
    EXPECT_EQ(MinJerk::at(u).ds, 0);
    EXPECT_EQ(MinJerk::at(u).dds, 0);
  }
  for (const double u : {1.0, 2.0, infinity}) {
    EXPECT_EQ(MinJerk::at(u).s, 1);
    EXPECT_EQ(MinJerk::at(u).ds, 0);
    EXPECT_EQ(MinJerk::at(u).dds, 0);
  }
}

TEST(MinJerk, ArrivesAndLeavesContinuously) {
  const MinJerk first = MinJerk::at(1e-9), last = MinJerk::at(1 - 1e-9);
  EXPECT_NEAR(first.s, 0, 1e-25);
  EXPECT_NEAR(first.ds, 0, 1e-16);
  EXPECT_NEAR(first.dds, 0, 1e-7);
  EXPECT_NEAR(last.s, 1, 1e-14);
  EXPECT_NEAR(last.ds, 0, 1e-16);
  EXPECT_NEAR(last.dds, 0, 1e-7);
}

TEST(MinJerk, IsSymmetricAndPeaksInTheMiddle) {
  EXPECT_EQ(MinJerk::at(0.5).s, 0.5);
  EXPECT_EQ(MinJerk::at(0.5).ds, MinJerk::kPeakSpeed);
  for (double u = 0.01; u < 1; u += 0.01) {
    EXPECT_NEAR(MinJerk::at(u).s + MinJerk::at(1 - u).s, 1, 1e-14);
    EXPECT_LE(MinJerk::at(u).ds, MinJerk::kPeakSpeed);
  }
}

TEST(MinJerk, ReportsTheDerivativesOfItsBlend) {
  const double h = 1e-3;
  for (double u = 0.01; u < 0.99; u += 0.01) {
    // Fourth-order difference: the error for the blend's fifth-degree polynomial is of order h^4.
    const auto difference = [&](double MinJerk::*x) {
      return (8 * (MinJerk::at(u + h).*x - MinJerk::at(u - h).*x) - MinJerk::at(u + 2 * h).*x +
              MinJerk::at(u - 2 * h).*x) /
             (12 * h);
    };
    EXPECT_NEAR(MinJerk::at(u).ds, difference(&MinJerk::s), 1e-10);
    EXPECT_NEAR(MinJerk::at(u).dds, difference(&MinJerk::ds), 1e-9);
  }
}

}  // namespace
}  // namespace haptrace
