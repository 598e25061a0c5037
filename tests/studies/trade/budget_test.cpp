#include "studies/trade/budget.h"

#include "tests/support/errors.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <limits>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

Outcome outcome_of(double error, double ripple, double tick) {
  Outcome outcome{.runs = 3};
  outcome.error = {.mean = error};
  outcome.ripple = {.mean = ripple};
  outcome.tick = tick;
  outcome.margin = 2;
  return outcome;
}

TEST(Budget, IsReadInItsUnitsAndWrittenBack) {
  const Budget budget = parse_budget(" error <= 0.1 mm,ripple<=300mN , tick<=2us, margin>=1.5, bytes<=0.2GB/h");
  ASSERT_EQ(budget.bounds.size(), 5U);
  EXPECT_EQ(budget.bounds[0].measure, Measure::error);
  EXPECT_DOUBLE_EQ(budget.bounds[0].limit, 1e-4);
  EXPECT_DOUBLE_EQ(budget.bounds[1].limit, 0.3);
  EXPECT_DOUBLE_EQ(budget.bounds[2].limit, 2e-6);
  EXPECT_DOUBLE_EQ(budget.bounds[3].limit, 1.5);
  EXPECT_DOUBLE_EQ(budget.bounds[4].limit, 2e8);
  EXPECT_EQ(to_string(budget), "error<=0.1mm, ripple<=0.3N, tick<=2us, margin>=1.5, bytes<=200MB/h");
  EXPECT_EQ(to_string(parse_budget(to_string(budget))), to_string(budget));
  for (const MeasureFacts& facts : measures()) {
    const std::string one = fmt::format("{}{}1{}", facts.name, facts.at_most ? "<=" : ">=", facts.unit);
    EXPECT_EQ(to_string(parse_budget(one)), one);
    EXPECT_EQ(&facts_of(facts.measure), &facts);
  }
}

TEST(Budget, SaysWhichPartCannotBeReadAndWhy) {
  for (const auto& [text, said] :
       std::vector<std::pair<std::string, std::string>>{{"", "a bound is missing"},
                                                        {"error<=0.1mm,", "a bound is missing"},
                                                        {"error", "a bound is a measure"},
                                                        {"error<0.1mm", "a bound is a measure"},
                                                        {"eror<=0.1mm", "did you mean 'error'"},
                                                        {"error>=0.1mm", "bounded by <="},
                                                        {"margin<=2", "bounded by >="},
                                                        {"error<=0.1", "write its unit, as in error<=1mm"},
                                                        {"error<=0.1s", "write its unit, as in error<=1mm"},
                                                        {"margin>=2mm", "it has no unit"},
                                                        {"error<=-1mm", "positive number"},
                                                        {"error<=nanmm", "positive number"},
                                                        {"error<=1mm, error<=2mm", "bounded twice"}})
    EXPECT_THAT(error_of([&] { (void)parse_budget(text); }), HasSubstr(said)) << text;
}

TEST(Budget, IsKeptWhenEveryBoundIsAndKnowsTheTightest) {
  const Budget budget = parse_budget("error<=0.1mm, ripple<=0.3N, margin>=1.5");
  EXPECT_TRUE(budget.kept(outcome_of(0.9e-4, 0.1, 1e-6)));
  EXPECT_TRUE(budget.kept(outcome_of(1e-4, 0.3, 1e-6)));
  EXPECT_FALSE(budget.kept(outcome_of(1.1e-4, 0.1, 1e-6)));
  EXPECT_FALSE(budget.kept(outcome_of(0.5e-4, 0.31, 1e-6)));
  const Outcome tight = outcome_of(0.9e-4, 0.1, 1e-6);
  EXPECT_EQ(budget.tightest(tight)->bound->measure, Measure::error);
  EXPECT_DOUBLE_EQ(budget.tightest(tight)->ratio, 0.9);
  EXPECT_TRUE(budget.bounds_accuracy());
  EXPECT_FALSE(parse_budget("tick<=2us").bounds_accuracy());
  EXPECT_FALSE(Budget{}.tightest(tight).has_value());
}

TEST(Budget, ComparesTheUpperEndOfTheInterval) {
  Outcome outcome = outcome_of(0.9e-4, 0.1, 1e-6);
  const Budget budget = parse_budget("error<=0.1mm");
  outcome.error.half_width = 0.2e-4;
  EXPECT_FALSE(budget.kept(outcome));
}

TEST(Budget, IsNotKeptByAnOutcomeThatDidNotRunOrWasNotMeasured) {
  Outcome refused = outcome_of(0, 0, 0);
  refused.refused = "the tool was faster than its limit";
  EXPECT_FALSE(parse_budget("error<=0.1mm").kept(refused));
  EXPECT_FALSE(Budget{}.kept(refused));
  const Outcome unmeasured = outcome_of(1e-5, 0.1, kNaN);
  EXPECT_EQ(parse_budget("tick<=2us").tightest(unmeasured)->ratio, std::numeric_limits<double>::infinity());
}

TEST(Estimate, IsAMeanWithStudentsInterval) {
  const Estimate estimate = Estimate::of({1, 2, 3});
  EXPECT_DOUBLE_EQ(estimate.mean, 2);
  EXPECT_NEAR(estimate.half_width, 4.302653 / std::sqrt(3.0), 1e-5);                 // t of 2 degrees at 0.975, s = 1
  EXPECT_EQ(Estimate::of({5}).half_width, std::numeric_limits<double>::infinity());  // one run has no interval
  EXPECT_TRUE(std::isnan(Estimate::of({}).mean));
  EXPECT_EQ(Estimate::of({1, std::numeric_limits<double>::infinity()}).mean, std::numeric_limits<double>::infinity());
}

TEST(Outcome, LoadIsThePriceTimesTheRate) {
  Outcome outcome{.configuration = {.rate_hz = 500}, .runs = 1};
  outcome.price = outcome.instructions = 4000;
  EXPECT_DOUBLE_EQ(mean_of(outcome, Measure::load), 500 * 4000);
  EXPECT_EQ(text_of_load(outcome), "2 MIPS");
}

TEST(Outcome, LoadIsAShareOfTheTimeAndNoMeasureOfABudgetWithoutCountedInstructions) {
  Outcome outcome{.configuration = {.rate_hz = 500}, .runs = 1};
  outcome.price = 4000;  // [ns]
  EXPECT_TRUE(std::isnan(mean_of(outcome, Measure::load)));
  EXPECT_FALSE(parse_budget("load<=1000MIPS").kept(outcome));
  EXPECT_EQ(text_of_load(outcome), "0.2 % of the time");
  EXPECT_DOUBLE_EQ(to_json(outcome)["load_share_of_time"], 0.002);
  EXPECT_TRUE(to_json(outcome)["load_per_s"].is_null());
}

TEST(Budget, IsRefusedWhereItNeedsInstructionsAndNoneAreCounted) {
  EXPECT_THAT(error_of([] { check_counted(parse_budget("error<=1mm, load<=5MIPS")); }),
              HasSubstr("load is bounded, but no instructions are counted"));
  EXPECT_THAT(error_of([] { check_counted(parse_budget("instructions<=5000")); }), HasSubstr("bound `tick`"));
  check_counted(parse_budget("error<=1mm, tick<=2us"));
}

}  // namespace
}  // namespace haptrace
