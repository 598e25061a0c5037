#include "control/design/nelder_mead.h"

#include <cmath>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

TEST(NelderMead, FindsTheBottomOfACurvedValley) {
  const auto rosenbrock = [](const std::array<double, 2>& x) {
    return 100 * std::pow(x[1] - x[0] * x[0], 2) + std::pow(1 - x[0], 2);
  };
  const auto found = minimised<2>(rosenbrock, {-1.2, 1.0}, {0.5, 0.5}, 300);
  EXPECT_NEAR(found[0], 1, 1e-4);
  EXPECT_NEAR(found[1], 1, 1e-4);
}

TEST(NelderMead, FindsTheBottomOfABowlInSixVariables) {
  const auto bowl = [](const std::array<double, 6>& x) {
    double sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i) sum += static_cast<double>(i + 1) * std::pow(x[i] - 0.3, 2);
    return sum;
  };
  for (const double x : minimised<6>(bowl, {2, -1, 0, 3, 1, -2}, {1, 1, 1, 1, 1, 1}, 1500)) EXPECT_NEAR(x, 0.3, 1e-3);
}

TEST(NelderMead, EndsWhenTheCornersOfItsSimplexAreEquallyGood) {
  int evaluations = 0;
  const auto bowl = [&](const std::array<double, 2>& x) {
    ++evaluations;
    return x[0] * x[0] + x[1] * x[1];
  };
  const auto found = minimised<2>(bowl, {1, 1}, {0.5, 0.5}, 1000, 1e-6);
  EXPECT_LT(std::hypot(found[0], found[1]), 2e-3);
  EXPECT_LT(evaluations, 100);
}

TEST(NelderMead, KeepsToItsNumberOfEvaluations) {
  int evaluations = 0;
  const auto plane = [&](const std::array<double, 3>& x) {
    ++evaluations;
    return x[0] + x[1] + x[2];
  };
  (void)minimised<3>(plane, {0, 0, 0}, {1, 1, 1}, 50);
  EXPECT_GE(evaluations, 50);
  EXPECT_LE(evaluations, 50 + 4) << "one shrink may follow the last";
}

}  // namespace
}  // namespace haptrace
