#include "studies/trade/tradeoff.h"

#include "studies/trade/trade_report.h"
#include "tests/studies/trade/support.h"

#include <algorithm>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <map>

namespace haptrace {
namespace {

using test::full_configuration;
using test::small_workplace;

TradeOptions small_options(bool instructions, std::size_t threads) {
  TradeOptions options{
      .base = full_configuration(), .runs = 2, .threads = threads, .instructions = instructions, .rates = {250, 1000}};
  options.base.learn = 2;
  return options;
}

/// Returns the accuracy of an outcome as text, without times, because these depend on the machine.
std::string accuracy_of(const Outcome& o) {
  return fmt::format("{} {:a} {:a} {:a} {:a}", o.runs, o.error.mean, o.error.half_width, o.peak.mean, o.ripple.mean);
}

/// Returns a trade-off that is priced in instructions, on two threads, or in time, on one. Each takes seconds and is
/// measured once.
const TradeReport& measured_trade(bool instructions, int* drawn = nullptr) {
  static std::map<bool, std::pair<TradeReport, int>> reports;
  auto found = reports.find(instructions);
  if (found == reports.end()) {
    Workbench bench(small_workplace());
    int draws = 0;
    TradeReport report = measure_trade(
        bench, small_options(instructions, instructions ? 2 : 1), StopRequest{},
        [](const std::string&, double done) {
          EXPECT_GE(done, 0);
          EXPECT_LE(done, 1);
        },
        [&](const TradeReport& so_far) {
          ++draws;
          EXPECT_FALSE(so_far.sweeps.empty());
          EXPECT_FALSE(so_far.front.empty());
        });
    found = reports.emplace(instructions, std::pair(std::move(report), draws)).first;
  }
  if (drawn != nullptr) *drawn = found->second.second;
  return found->second.first;
}

class MeasuredTrade : public testing::TestWithParam<bool> {
 protected:
  MeasuredTrade() : report_(&measured_trade(GetParam(), &drawn_)) {}
  int drawn_ = 0;
  const TradeReport* report_;
};
INSTANTIATE_TEST_SUITE_P(All, MeasuredTrade, testing::Bool(),
                         [](const auto& each) { return each.param ? "Counted" : "Timed"; });

TEST_P(MeasuredTrade, VariesEverySettingAndDrawsOnceInBetween) {
  EXPECT_TRUE(report_->complete);
  EXPECT_EQ(drawn_, 1);
  std::vector<std::string> knobs;
  for (const KnobSweep& sweep : report_->sweeps) {
    knobs.push_back(sweep.knob);
    EXPECT_EQ(std::count_if(sweep.levels.begin(), sweep.levels.end(), [](const KnobLevel& l) { return l.is_base; }),
              sweep.knob == "velocity of PD" ? 0 : 1)
        << sweep.knob;
  }
  EXPECT_THAT(knobs, testing::ElementsAre("rate", "interpolation", "velocity", "without", "velocity of PD", "learn",
                                          "thin", "speed"));
}

TEST_P(MeasuredTrade, HasAFrontThatNoOutcomeDominates) {
  const std::vector<Outcome>& front = report_->front;
  ASSERT_GE(front.size(), 3U);
  for (std::size_t i = 1; i < front.size(); ++i) EXPECT_GE(front[i].load(), front[i - 1].load());
  for (const Outcome& one : front) {
    EXPECT_GE(one.runs, 4U);
    for (const Outcome& other : front)
      EXPECT_FALSE(other.error.mean < one.error.mean && other.ripple.mean < one.ripple.mean &&
                   other.load() < one.load() && other.configuration.learn <= one.configuration.learn)
          << describe(other.configuration) << " beats " << describe(one.configuration);
  }
  // With measured times, the cheapest outcome depends on the machine, but the errors do not.
  const auto [exact, coarse] = std::minmax_element(
      front.begin(), front.end(), [](const Outcome& a, const Outcome& b) { return a.error.mean < b.error.mean; });
  EXPECT_LT(exact->error.mean, 0.3 * coarse->error.mean);
}

TEST_P(MeasuredTrade, GivesTheSameToTheLastBitWithOtherThreads) {
  std::map<std::string, std::string> others;
  for (const Outcome& o : measured_trade(!GetParam()).tried) others[describe(o.configuration)] = accuracy_of(o);
  int compared = 0;
  for (const Outcome& o : report_->tried) {
    const auto other = others.find(describe(o.configuration));
    // The choice of refined combinations depends on their loads, which are measured.
    if (other == others.end() || other->second.front() != accuracy_of(o).front()) continue;
    EXPECT_EQ(accuracy_of(o), other->second);
    ++compared;
  }
  EXPECT_GT(compared, 50);
}

TEST_P(MeasuredTrade, ChoosesTheCheapestThatKeepsTheBudget) {
  // The configurations on the front and their order depend on the measured cost of a tick.
  const std::vector<Outcome>& front = report_->front;
  auto middle = front.begin() + static_cast<std::ptrdiff_t>(front.size() / 2);
  while (middle != front.begin() && middle->margin < 2) --middle;
  ASSERT_GE(middle->margin, kLeastMargin);
  const Budget budget{{{Measure::error, 1.01 * value_of(*middle, Measure::error)}}};
  const auto choice = choose(*report_, budget);
  ASSERT_TRUE(choice);
  EXPECT_TRUE(choice->kept);
  EXPECT_TRUE(budget.kept(choice->outcome));
  Budget all = budget;  // with the bounds that every choice keeps
  all.bounds.push_back({Measure::margin, kLeastMargin});
  all.bounds.push_back({Measure::ripple, value_of(report_->plain.value(), Measure::ripple)});
  for (const Outcome& cheaper : report_->front)
    if (cheaper.load() < choice->outcome.load()) {
      EXPECT_FALSE(all.kept(cheaper));
    }
  // The named bound is the one that the choice uses most.
  EXPECT_EQ(choice->binding, to_string(*all.tightest(choice->outcome)->bound));
  EXPECT_EQ(choice->binding_ratio, all.tightest(choice->outcome)->ratio);
  EXPECT_LE(choice->binding_ratio, 1);
  if (choice->cheaper && !all.kept(*choice->cheaper)) {
    EXPECT_EQ(choice->excludes, to_string(*all.tightest(*choice->cheaper)->bound));
  }
  if (choice->cheaper) {
    EXPECT_LE(choice->cheaper->load(), choice->outcome.load());
  }
  if (choice->dearer) {
    EXPECT_GE(choice->dearer->load(), choice->outcome.load());
  }
}

TEST_P(MeasuredTrade, ChoosesTheMostExactWhenOnlyCostsAreBounded) {
  // Without counted instructions, no load is known in MIPS.
  const Budget budget = parse_budget(GetParam() ? "load<=1000000MIPS" : "tick<=1s");
  const auto choice = choose(*report_, budget);
  ASSERT_TRUE(choice && choice->kept);
  for (const Outcome& other : report_->front) {
    if (other.margin < kLeastMargin ||
        value_of(other, Measure::ripple) > value_of(report_->plain.value(), Measure::ripple))
      continue;
    EXPECT_GE(other.error.mean, choice->outcome.error.mean);
  }
}

TEST_P(MeasuredTrade, RequiresAGainMarginUnlessTheBudgetBoundsIt) {
  TradeReport report = *report_;
  for (Outcome& outcome : report.front) outcome.margin = 1.2;
  report.front.back().margin = 2;
  const auto choice = choose(report, parse_budget("error<=10mm, ripple<=100N"));
  ASSERT_TRUE(choice && choice->kept);
  EXPECT_EQ(choice->outcome.configuration, report.front.back().configuration);
  const auto daring = choose(report, parse_budget("error<=10mm, ripple<=100N, margin>=1.1"));
  ASSERT_TRUE(daring && daring->kept);
  EXPECT_EQ(daring->outcome.configuration, report.front.front().configuration);
}

TEST_P(MeasuredTrade, KeepsTheRippleOfThePlainLawWhereTheBudgetBoundsNone) {
  TradeReport report = *report_;
  ASSERT_TRUE(report.plain);
  EXPECT_EQ(report.plain->configuration.with, Compensations{});
  EXPECT_GE(report.plain->runs, 4U);
  for (Outcome& outcome : report.front) {
    outcome.margin = 2;
    outcome.ripple = {.mean = 10 * report.plain->ripple.mean};
  }
  report.front.back().ripple = {.mean = 0.5 * report.plain->ripple.mean};
  const Budget budget = parse_budget("error<=10mm");
  const auto choice = choose(report, budget);
  ASSERT_TRUE(choice && choice->kept);
  EXPECT_EQ(choice->outcome.configuration, report.front.back().configuration);
  EXPECT_THAT(text_of(*choice, budget), testing::HasSubstr("the ripple of the plain law"));
  const auto loud = choose(report, parse_budget("error<=10mm, ripple<=100N"));
  ASSERT_TRUE(loud && loud->kept);
  EXPECT_EQ(loud->outcome.configuration, report.front.front().configuration);
}

TEST_P(MeasuredTrade, FallsBackOnThePlainLawWhenTheFrontHasMoreRippleAndTheBudgetBoundsNone) {
  TradeReport report = *report_;
  report.plain->margin = 2;
  for (Outcome& outcome : report.front) {
    outcome.margin = 2;
    outcome.ripple = {.mean = 10 * report.plain->ripple.mean};
  }
  const auto choice = choose(report, parse_budget("error<=1m"));
  ASSERT_TRUE(choice);
  EXPECT_TRUE(choice->kept);
  EXPECT_EQ(choice->outcome.configuration, report.plain->configuration);
}

TEST_P(MeasuredTrade, HasAFrontWithEnoughRuns) {
  ASSERT_FALSE(report_->front.empty());
  for (const Outcome& outcome : report_->front) EXPECT_GE(outcome.runs, 4U);
}

TEST_P(MeasuredTrade, NamesTheTightestBoundOfTheChoice) {
  TradeReport report = *report_;
  report.front.resize(2);
  report.front[0].margin = 1.2;  // the margin rules out the cheaper outcome
  report.front[0].error = {.mean = 0.5e-3};
  report.front[1].margin = 4;
  report.front[1].error = {.mean = 0.9e-3};
  const Budget budget = parse_budget("error<=1mm, ripple<=100N");
  const auto choice = choose(report, budget);
  ASSERT_TRUE(choice && choice->kept);
  EXPECT_EQ(choice->binding, "error<=1mm");
  EXPECT_NEAR(choice->binding_ratio, 0.9, 1e-12);
  EXPECT_EQ(choice->excludes, "margin>=1.4");
  EXPECT_THAT(text_of(*choice, budget), testing::HasSubstr("the tightest bound is error<=1mm: 90 % of it is used"));
}

TEST_P(MeasuredTrade, ChoosesTheNearestWhenNothingKeepsTheBudget) {
  const Budget budget = parse_budget("error<=1um, ripple<=0.001N");
  const auto choice = choose(*report_, budget);
  ASSERT_TRUE(choice);
  EXPECT_FALSE(choice->kept);
  for (const Outcome& other : report_->front) {
    if (other.margin < kLeastMargin) continue;
    EXPECT_GE(budget.tightest(other)->ratio, budget.tightest(choice->outcome)->ratio);
  }
  EXPECT_THAT(text_of(*choice, budget), testing::HasSubstr("no configuration keeps"));
}

TEST_P(MeasuredTrade, ChoosesTheFastestStorageThatABoundOnBytesAllows) {
  TradeReport report = *report_;
  SideTrade storage{.knob = std::string(kStorageKnob), .what = {}, .columns = {}, .levels = {}};
  for (const StorageLevel& level : storage_levels())
    storage.levels.push_back({level.name, false, {4e8 / static_cast<double>(1 + storage.levels.size()), 0, 0, 0}, ""});
  report.sides = {storage};
  const auto loose = choose(report, parse_budget("bytes<=500MB/h"));
  ASSERT_TRUE(loose && loose->storage);
  EXPECT_EQ(loose->storage->name, "plain");
  const auto tight = choose(report, parse_budget("bytes<=40MB/h"));  // 250 Hz: the third level; 1000 Hz: no level
  ASSERT_TRUE(tight && tight->storage);
  EXPECT_TRUE(tight->kept);
  EXPECT_EQ(tight->storage->name, storage_levels()[2].name);
  EXPECT_EQ(tight->outcome.configuration.rate_hz, 250);
}

TEST_P(MeasuredTrade, KeepsPlainStorageWhenCoarserStorageDoesNotHelp) {
  TradeReport report = *report_;
  SideTrade storage{.knob = std::string(kStorageKnob), .what = {}, .columns = {}, .levels = {}};
  for (std::size_t i = 0; i < storage_levels().size(); ++i)
    storage.levels.push_back({storage_levels()[i].name, i == 0, {4e8 / static_cast<double>(1 + i), 0, 0, 0}, ""});
  report.sides = {storage};
  const auto choice = choose(report, parse_budget("bytes<=9000MB/h, error<=1um"));
  ASSERT_TRUE(choice && choice->storage);
  EXPECT_FALSE(choice->kept);
  EXPECT_EQ(choice->storage->name, "plain");
}

TEST_P(MeasuredTrade, ChoosesNothingBeforeItIsComplete) {
  TradeReport report = *report_;
  report.complete = false;
  EXPECT_FALSE(choose(report, parse_budget("error<=1mm")).has_value());
}

TEST_P(MeasuredTrade, WritesJsonAndTextAndDrawsAPicture) {
  const Budget budget = parse_budget("error<=1mm");
  const auto choice = choose(*report_, budget);
  const nlohmann::json json = to_json(*report_);
  EXPECT_EQ(json["front"].size(), report_->front.size());
  EXPECT_EQ(json["knobs"].size(), report_->sweeps.size());
  EXPECT_EQ(predicted_by(choice->outcome)["rms_error_m"], choice->outcome.rms_error.mean);
  EXPECT_THAT(text_of(*report_), testing::HasSubstr("the Pareto front"));
  EXPECT_THAT(text_of(*report_), testing::HasSubstr(GetParam() ? " MIPS\n" : " % of the time\n"));
  for (const Outcome& outcome : report_->tried) {
    if (outcome.ran()) {
      EXPECT_GT(outcome.load(), 0) << describe(outcome.configuration);
    }
  }
  EXPECT_EQ(figure_of(*report_, &*choice).rows.size(), 2U);
}

TEST(Trade, ExplainsTheBenefitOfEachTerm) {
  const Workbench bench(small_workplace());
  const Explanation explanation =
      explain(bench, full_configuration(), parse_budget("error<=1mm"), small_options(true, 1), StopRequest{});
  ASSERT_EQ(explanation.terms.size(), 4U);
  for (const TermPrice& price : explanation.terms) {
    EXPECT_TRUE(price.without.ran()) << price.term;
    if (price.term != "observer") continue;
    EXPECT_GT(price.error_change, 0);
    EXPECT_GT(price.instructions, 0);
  }
  // With a loose budget a term can be dropped; with a strict one none can.
  EXPECT_TRUE(std::any_of(explanation.terms.begin(), explanation.terms.end(),
                          [](const TermPrice& p) { return p.term == "inertia" && p.dispensable; }));
  const Explanation strict =
      explain(bench, full_configuration(), parse_budget("error<=1um"), small_options(false, 1), StopRequest{});
  for (const TermPrice& price : strict.terms) {
    if (price.term == "gravity") continue;  // constant along this circle, so the observer compensates for it too
    EXPECT_FALSE(price.dispensable) << price.term;
  }
}

TEST(Trade, VariesTheLawOfADeviceWhoseProfileHasLqgLaws) {
  Workplace place = small_workplace();
  place.profile->held = test::identified_in_a_hand().held;
  Workbench bench(place);
  EXPECT_TRUE(bench.has_laws(1000));
  EXPECT_FALSE(bench.has_laws(250));
  TradeOptions options = small_options(false, 2);
  options.search = false;
  const TradeReport report = measure_trade(bench, options, StopRequest{});
  const auto found = std::find_if(report.sweeps.begin(), report.sweeps.end(),
                                  [](const KnobSweep& sweep) { return sweep.knob == "law"; });
  ASSERT_NE(found, report.sweeps.end());
  std::map<std::string, double> ripple;
  for (const KnobLevel& level : found->levels) {
    EXPECT_TRUE(level.outcome.ran()) << level.level << ": " << level.outcome.refused;
    EXPECT_EQ(level.is_base, level.level == "as play chooses");
    EXPECT_TRUE(std::isfinite(level.outcome.price)) << level.level;
    ripple[level.level] = level.outcome.ripple.mean;
  }
  EXPECT_EQ(ripple.size(), 5U);
  EXPECT_LT(ripple["quiet"], ripple["normal"]);
  EXPECT_LT(ripple["normal"], ripple["exact"]);
  EXPECT_EQ(ripple["normal"], ripple["as play chooses"]);

  Configuration elsewhere = options.base;
  elsewhere.rate_hz = 250;
  elsewhere.law = "quiet";
  EXPECT_THAT(bench.judge(elsewhere, 1).refused, testing::HasSubstr("no LQG laws for 250 Hz"));
}

TEST(Trade, EndsWhenItIsStoppedWithAnIncompleteReport) {
  Workbench bench(small_workplace());
  StopRequest stop;
  stop.raise();
  const TradeReport report = measure_trade(bench, small_options(false, 2), stop);
  EXPECT_FALSE(report.complete);
  EXPECT_FALSE(choose(report, parse_budget("error<=1mm")).has_value());
}

TEST(Trade, WritesAConfigurationForEveryVerb) {
  Configuration configuration = full_configuration();
  configuration.rate_hz = 500;
  configuration.with.friction = false;
  configuration.thin = 10;
  const Storage storage{.deflate = 1, .precision = parse_precision("1um")};
  const nlohmann::json json = config_file(configuration, {}, "p.json", &storage);
  EXPECT_EQ(json["play"]["without"], nlohmann::json({"friction", "cogging", "learning"}));
  EXPECT_EQ(json["play"]["thin"], 10);
  EXPECT_FALSE(json["play"].contains("law"));
  configuration.law = "quiet";
  EXPECT_EQ(config_file(configuration, {}, "p.json", nullptr)["play"]["firmness"], "quiet");
  configuration.law = "observer";
  EXPECT_EQ(config_file(configuration, {}, "p.json", nullptr)["play"]["law"], "observer");
  EXPECT_EQ(play_options(configuration, {}).law, TrackingLaw::observer);
  for (const char* verb : {"play", "guide", "record"}) {
    EXPECT_EQ(json[verb]["rate"], 500) << verb;
    EXPECT_EQ(json[verb]["compress"], 1) << verb;
    EXPECT_EQ(parse_precision(json[verb]["precision"].get<std::string>()), storage.precision) << verb;
  }
  PlayOptions base;
  base.fit = true;
  base.smoothing = 0.01;
  base.playback.max_deviation = 0.05;
  const nlohmann::json plain = config_file({}, base, "", nullptr);
  EXPECT_EQ(plain["play"]["no-profile"], true);
  EXPECT_EQ(plain["play"]["max-deviation"], 0.05);
  for (const char* verb : {"play", "guide"}) {
    EXPECT_EQ(plain[verb]["fit"], true) << verb;
    EXPECT_EQ(plain[verb]["smoothing"], 0.01) << verb;
  }
}

}  // namespace
}  // namespace haptrace
