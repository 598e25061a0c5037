#include "metrics/learning_curve.h"

#include "base/types.h"
#include "tests/support/errors.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>
#include <vector>

namespace haptrace {
namespace {

using test::error_of;

std::vector<double> figures_of(const LearningCurve& curve, int repetitions) {
  std::vector<double> figures;
  for (int n = 1; n <= repetitions; ++n) figures.push_back(curve.at(n));
  return figures;
}

class EveryLearningLaw : public testing::TestWithParam<LearningLaw> {};

TEST_P(EveryLearningLaw, IsRecoveredFromItsOwnValues) {
  for (const double rate : {0.1, 0.4, 1.0, 2.5})
    for (const auto& [first, plateau] : {std::pair{8e-3, 1e-3}, {5.0, 0.0}, {1.0, 3.0}})
      for (const int repetitions : {4, 10, 50}) {
        const LearningCurve truth{.law = GetParam(), .first = first, .plateau = plateau, .rate = rate};
        const auto found = fit_learning_curve(figures_of(truth, repetitions), GetParam());
        ASSERT_TRUE(found);
        EXPECT_NEAR(found->first, first, 1e-4 * first) << rate << " " << repetitions;
        EXPECT_NEAR(found->plateau, plateau, 1e-3 * std::max(first, plateau)) << rate << " " << repetitions;
        EXPECT_NEAR(found->rate, rate, 2e-3 * rate) << repetitions;
        EXPECT_NEAR(found->r_squared, 1, 1e-8);
      }
}

TEST_P(EveryLearningLaw, FollowsTheUnitOfTheMetric) {
  const std::vector<double> error{9.1, 6.2, 5.5, 3.9, 4.1, 3.2, 3.4, 2.9, 3.0, 2.8};
  std::vector<double> in_mm;
  for (const double e : error) in_mm.push_back(1e3 * e);
  const auto a = fit_learning_curve(error, GetParam()), b = fit_learning_curve(in_mm, GetParam());
  EXPECT_NEAR(b->first, 1e3 * a->first, 1e-4 * b->first);
  EXPECT_NEAR(b->plateau, 1e3 * a->plateau, 1e-4 * b->first);
  EXPECT_NEAR(b->rate, a->rate, 1e-4);
  EXPECT_NEAR(b->r_squared, a->r_squared, 1e-9);
  EXPECT_GT(a->r_squared, 0.95);
}

TEST_P(EveryLearningLaw, HasTheRateWithTheSmallestResidual) {
  const std::vector<double> error{9.1, 6.2, 5.5, 3.9, 4.1, 3.2, 3.4, 2.9, 3.0, 2.8};
  const auto squares = [&](const LearningCurve& curve) {
    double sum = 0;
    for (std::size_t i = 0; i < error.size(); ++i) sum += std::pow(error[i] - curve.at(static_cast<double>(i + 1)), 2);
    return sum;
  };
  const LearningCurve best = *fit_learning_curve(error, GetParam());
  for (const double by : {0.9, 0.99, 1.01, 1.1}) {
    for (double LearningCurve::*parameter : {&LearningCurve::first, &LearningCurve::plateau, &LearningCurve::rate}) {
      LearningCurve other = best;
      other.*parameter *= by;
      EXPECT_GT(squares(other), squares(best)) << by;
    }
  }
}

TEST_P(EveryLearningLaw, StaysWithinItsBounds) {
  const std::vector<double> straight{7, 6, 5, 4, 3, 2, 1};  // an unbounded fit would end far below zero
  const auto bounded = fit_learning_curve(straight, GetParam());
  EXPECT_GE(bounded->plateau, 0);
  EXPECT_GT(bounded->first, 0);
  EXPECT_GT(bounded->r_squared, 0.8);
  const auto free = fit_learning_curve(straight, GetParam(), {.least = -std::numeric_limits<double>::infinity()});
  EXPECT_LT(free->plateau, 0);
  EXPECT_GT(free->r_squared, bounded->r_squared);

  const std::vector<double> rising{0, 0, 0, 0, 1, 2, 8};
  EXPECT_GE(fit_learning_curve(rising, GetParam())->first, 0);
  EXPECT_LE(fit_learning_curve(straight, GetParam(), {.slowest = 0.2, .fastest = 0.3})->rate, 0.3);
  EXPECT_GE(fit_learning_curve(straight, GetParam(), {.slowest = 0.2, .fastest = 0.3})->rate, 0.2);
}

TEST_P(EveryLearningLaw, ARepetitionThatWasNotMeasuredKeepsItsNumber) {
  const LearningCurve truth{.law = GetParam(), .first = 8, .plateau = 2, .rate = 0.7};
  auto figures = figures_of(truth, 12);
  figures[0] = figures[4] = kNaN;
  const auto found = fit_learning_curve(figures, GetParam());
  EXPECT_NEAR(found->first, 8, 0.01);
  EXPECT_NEAR(found->plateau, 2, 0.01);
  EXPECT_NEAR(found->rate, 0.7, 0.003);
}

TEST_P(EveryLearningLaw, IsUndefinedForFewRepetitionsAndWithoutVariation) {
  EXPECT_FALSE(fit_learning_curve({}, GetParam()));
  EXPECT_FALSE(fit_learning_curve(std::vector<double>{3, 2, 1}, GetParam()));
  EXPECT_FALSE(fit_learning_curve(std::vector<double>{4, kNaN, 3, kNaN, 2}, GetParam()));
  for (const double value : {0.0, 0.1, 1e-9, 1e9})
    EXPECT_FALSE(fit_learning_curve(std::vector<double>(20, value), GetParam())) << value;
}

TEST_P(EveryLearningLaw, AcceptsMetricsOfAnySize) {
  const LearningCurve truth{.law = GetParam(), .first = 8, .plateau = 2, .rate = 0.7};
  for (const double size : {1e-120, 1e-9, 1e9, 1e120}) {
    auto figures = figures_of(truth, 12);
    for (double& figure : figures) figure *= size;
    const auto found = fit_learning_curve(figures, GetParam());
    ASSERT_TRUE(found) << size;
    EXPECT_NEAR(found->plateau / size, 2, 0.01) << size;
  }
  EXPECT_TRUE(fit_learning_curve(std::vector<double>{1, 1e300, 1, 0, 1e-300}, GetParam()));
}

INSTANTIATE_TEST_SUITE_P(All, EveryLearningLaw, testing::Values(LearningLaw::power, LearningLaw::exponential));

TEST(LearningCurve, FollowsItsFormula) {
  const LearningCurve power{.law = LearningLaw::power, .first = 8, .plateau = 2, .rate = 0.5};
  EXPECT_EQ(power.at(1), 8);
  EXPECT_NEAR(power.at(4), 2 + 6 * 0.5, 1e-12);
  const LearningCurve exponential{.law = LearningLaw::exponential, .first = 8, .plateau = 2, .rate = 0.5};
  EXPECT_EQ(exponential.at(1), 8);
  EXPECT_NEAR(exponential.at(3), 2 + 6 * std::exp(-1), 1e-12);
}

TEST(LearningCurve, RejectsInvalidBounds) {
  const std::vector<double> error{4, 3, 2, 1};
  for (const LearningBounds bounds : {LearningBounds{.slowest = 0}, {.slowest = 2, .fastest = 1}, {.fastest = kNaN}})
    EXPECT_THAT(error_of([&] { return fit_learning_curve(error, LearningLaw::power, bounds); }),
                testing::HasSubstr("the first must be smaller"));
}

// Anscombe 1973, Graphs in statistical analysis: the first data set of the quartet, with x from 4 to 14.
TEST(LearningTrend, IsFittedToAnyPlacesAsDays) {
  const std::vector<double> days{3, 10, 11, 33, kNaN, 40}, values{5, 3.6, 3.4, -1, 2, kNaN};
  const LearningTrend trend = fit_trend(days, values).value();
  EXPECT_NEAR(trend.slope, -0.2, 1e-12);
  EXPECT_NEAR(trend.first, 5, 1e-12) << "at the first day";
  EXPECT_FALSE(fit_trend(std::vector<double>(4, 7), std::vector<double>{1, 2, 3, 4})) << "all at one place";
  EXPECT_THAT(error_of([] {
                (void)fit_trend(std::vector<double>{1, 2}, std::vector<double>{1});
              }),
              testing::HasSubstr("2 places and 1 values"));
}

TEST(LearningTrend, MatchesTheTextbookExample) {
  const std::vector<double> y{4.26, 5.68, 7.24, 4.82, 6.95, 8.81, 8.04, 8.33, 10.84, 7.58, 9.96};
  const auto trend = fit_trend(y);
  EXPECT_NEAR(trend->slope, 0.5001, 5e-5);
  EXPECT_NEAR(trend->first, 3.0001 + 4 * 0.5001, 1e-3);
  EXPECT_NEAR(trend->slope_half_width, 2.2622 * 0.1179, 2e-4);
  EXPECT_NEAR(trend->r_squared, 0.6665, 5e-5);
}

TEST(LearningTrend, ItsIntervalContainsTheTrueSlopeNineteenTimesInTwenty) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 2);
  int held = 0;
  constexpr int kDraws = 4000;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<double> figures;
    for (int n = 1; n <= 6; ++n) figures.push_back(10 - 0.3 * n + noise(random));
    const auto trend = fit_trend(figures);
    if (std::abs(trend->slope + 0.3) <= trend->slope_half_width) ++held;
  }
  EXPECT_NEAR(static_cast<double>(held) / kDraws, 0.95, 0.012);
}

TEST(LearningTrend, IsUndefinedForFewRepetitionsOnly) {
  EXPECT_FALSE(fit_trend(std::vector<double>{3, 2, 1}));
  const auto level = fit_trend(std::vector<double>{2, 2, kNaN, 2, 2});
  EXPECT_EQ(level->slope, 0);
  EXPECT_EQ(level->slope_half_width, 0);
  EXPECT_EQ(level->first, 2);
  EXPECT_EQ(level->r_squared, 0);
}

}  // namespace
}  // namespace haptrace
