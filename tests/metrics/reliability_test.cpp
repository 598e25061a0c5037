// Reliability of repeated sessions.
#include "metrics/reliability.h"

#include "tests/support/errors.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <random>

namespace haptrace {
namespace {

using test::error_of;
using Table = std::vector<std::vector<double>>;

// Shrout and Fleiss (1979), table 2: six targets, four judges; the values of their table 4.
TEST(Reliability, HasThePublishedValuesOfShroutAndFleiss) {
  const Table judged{{9, 2, 5, 8}, {6, 1, 3, 2}, {8, 4, 6, 8}, {7, 1, 2, 6}, {10, 5, 6, 9}, {6, 2, 4, 7}};
  const Reliability found = reliability(judged).value();
  EXPECT_NEAR(found.icc_agreement, 0.29, 5e-3);
  EXPECT_NEAR(found.icc_consistency, 0.71, 5e-3);
  EXPECT_NEAR(found.mdc95, 1.959964 * std::sqrt(2) * found.sem, 1e-5);
}

TEST(Reliability, CountsPracticeInAgreementButNotInConsistency) {
  // Every person improves by 2; nothing else changes.
  const Reliability found = reliability(Table{{10, 8}, {14, 12}, {18, 16}, {25, 23}}).value();
  EXPECT_NEAR(found.icc_consistency, 1, 1e-12);
  EXPECT_LT(found.icc_agreement, 0.99);
  EXPECT_NEAR(found.sem, std::sqrt(2.0), 1e-12) << "the variance of 10 and 8";
}

TEST(Reliability, FindsTheErrorOfSessionsThatWasDrawn) {
  std::mt19937 random(11);
  std::normal_distribution<double> person(0, 3), session(0, 0.7);
  Table table;
  for (int i = 0; i < 4000; ++i) {
    const double level = 20 + person(random);
    table.push_back({level + session(random), level + session(random)});
  }
  const Reliability found = reliability(table).value();
  EXPECT_NEAR(found.sem, 0.7, 0.03);
  EXPECT_NEAR(found.icc_agreement, 9 / (9 + 0.49), 0.01);
  // SEM = SD sqrt(1 - ICC), and SD of the differences / sqrt(2), are the same without practice.
  EXPECT_NEAR(standard_error_of_measurement(std::sqrt(9 + 0.49), found.icc_agreement), found.sem, 0.03);
  int beyond = 0;
  for (const std::vector<double>& of : table) beyond += std::abs(of[1] - of[0]) > found.mdc95 ? 1 : 0;
  EXPECT_NEAR(beyond / 4000.0, 0.05, 0.01) << "an unchanged person exceeds it in 5 % of cases";
}

TEST(Reliability, IsSmallerForMeansOfSeveralSessions) {
  EXPECT_NEAR(mdc95(1), 2.7718, 1e-4);
  EXPECT_NEAR(mdc95(1, 4), 2.7718 / 2, 1e-4);
  EXPECT_EQ(standard_error_of_measurement(2, -0.1), 2) << "retest data can give a negative ICC";
}

TEST(Reliability, IsUndefinedForTooFewOrEqualValuesAndRejectsOthers) {
  EXPECT_FALSE(reliability(Table{}));
  EXPECT_FALSE(reliability(Table{{1, 2}, {2, 3}}));
  EXPECT_FALSE(reliability(Table{{1}, {2}, {3}}));
  EXPECT_FALSE(reliability(Table{{2, 2}, {2, 2}, {2, 2}}));
  EXPECT_THAT(error_of([] { (void)reliability(Table{{1, 2}, {1}}); }), testing::HasSubstr("person 2"));
  EXPECT_THAT(error_of([] { (void)reliability(Table{{1, NAN}, {1, 2}, {2, 3}}); }), testing::HasSubstr("not finite"));
}

}  // namespace
}  // namespace haptrace
