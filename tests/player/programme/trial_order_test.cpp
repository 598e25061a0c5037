// Tests of random orders: laws over many seeds, and the order of one seed, bit by bit.
#include "player/programme/trial_order.h"

#include "player/programme/programme_session.h"
#include "tests/support/errors.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <map>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using testing::HasSubstr;

/// Returns a programme with these repetitions of each exercise; a negative number makes catch trials.
json ordered_programme(const std::string& order, const std::vector<int>& repetitions, int seed, int rounds = 1) {
  json programme{{"haptrace_programme", 1}, {"order", order}, {"rounds", rounds}, {"exercises", json::array()}};
  if (order != "listed") programme["seed"] = seed;
  for (const int count : repetitions)
    programme["exercises"].push_back(
        {{"shape", {{"kind", "circle"}}}, {"mode", "free"}, {"catch", count < 0}, {"repetitions", std::abs(count)}});
  return programme;
}

/// Returns the order of such a programme, without reading it from JSON.
std::vector<ScheduledTrial> scheduled_order(TrialOrder order, const std::vector<int>& repetitions, int seed,
                                            int rounds = 1) {
  Programme programme{.rounds = rounds, .order = order, .seed = static_cast<std::uint64_t>(seed)};
  for (const int count : repetitions)
    programme.exercises.push_back({.repetitions = std::abs(count), .catch_trial = count < 0});
  return schedule(programme);
}

std::string letters(const std::vector<ScheduledTrial>& trials) {
  std::string text;
  for (const ScheduledTrial& trial : trials) text += static_cast<char>('A' + trial.exercise);
  return text;
}

TEST(TrialOrder, IsThatOfTheFileIfItIsListed) {
  EXPECT_EQ(letters(scheduled_order(TrialOrder::listed, {2, 1, 3}, 0, 2)), "AABCCCAABCCC");
}

TEST(TrialOrder, IsTheSameOnEveryPlatform) {
  // The generator is defined by the C++ standard, and so is its ten thousandth number: 9981545732273789042.
  OrderDraw draw(std::mt19937_64::default_seed);
  std::uint64_t last = 0;
  for (int i = 0; i < 10'000; ++i) last = draw.below(std::uint64_t{1} << 63);
  EXPECT_EQ(last, 9981545732273789042U % (std::uint64_t{1} << 63));
  // From an independent implementation of the generator and the shuffle.
  EXPECT_EQ(letters(scheduled_order(TrialOrder::interleaved, {4, 4, 4}, 7)), "BCABCACABCAB");
  EXPECT_EQ(letters(scheduled_order(TrialOrder::blocked, {3, 3, 3, 3}, 7)), "BBBCCCAAADDD");
}

TEST(TrialOrder, KeepsBlocksTogetherAndEveryOrderOfThemIsEquallyLikely) {
  std::map<std::string, int> counts;
  constexpr int kSeeds = 6000;
  for (int seed = 0; seed < kSeeds; ++seed) ++counts[letters(scheduled_order(TrialOrder::blocked, {2, 1, 2}, seed))];
  EXPECT_EQ(counts.size(), 6U);
  for (const auto& [order, count] : counts) EXPECT_NEAR(count, kSeeds / 6, 150) << order;
}

TEST(TrialOrder, InterleavesInCyclesWithoutAnImmediateRepeat) {
  for (int seed = 0; seed < 500; ++seed) {
    const std::string order = letters(scheduled_order(TrialOrder::interleaved, {5, 5, 5, 5}, seed));
    ASSERT_EQ(order.size(), 20U);
    for (std::size_t i = 0; i < order.size(); i += 4) {
      std::string cycle = order.substr(i, 4);
      std::sort(cycle.begin(), cycle.end());
      ASSERT_EQ(cycle, "ABCD");
    }
    ASSERT_EQ(std::adjacent_find(order.begin(), order.end()), order.end()) << order;
  }
}

TEST(TrialOrder, CountsTheRepetitionsOfEveryExerciseInTheirOrder) {
  for (const TrialOrder kind : {TrialOrder::blocked, TrialOrder::interleaved})
    for (int seed = 0; seed < 100; ++seed) {
      std::map<std::pair<std::size_t, int>, int> last;
      for (const ScheduledTrial& trial : scheduled_order(kind, {3, 1, 6, -2}, seed, 2)) {
        int& before = last[{trial.exercise, trial.round}];
        if (trial.exercise < 3) {
          ASSERT_EQ(trial.repetition, before + 1);
        }
        before = std::max(before, trial.repetition);
      }
      for (const int round : {1, 2}) {
        EXPECT_EQ((last[{0, round}]), 3);
        EXPECT_EQ((last[{1, round}]), 1);
        EXPECT_EQ((last[{2, round}]), 6);
        EXPECT_EQ((last[{3, round}]), 2);
      }
    }
}

TEST(TrialOrder, ScattersCatchTrialsButNotAmongTheFirstFiveNorInARow) {
  std::array<int, 24> at{};
  for (int seed = 0; seed < 2000; ++seed) {
    const std::string order = letters(scheduled_order(TrialOrder::interleaved, {10, 10, -4}, seed));
    ASSERT_EQ(order.size(), 24U);
    ASSERT_EQ(std::count(order.begin(), order.end(), 'C'), 4);
    ASSERT_EQ(order.substr(0, 5).find('C'), std::string::npos) << order;
    ASSERT_EQ(order.find("CC"), std::string::npos) << order;
    for (std::size_t i = 0; i < order.size(); ++i) at[i] += order[i] == 'C' ? 1 : 0;
  }
  for (std::size_t i = 5; i < at.size(); ++i) EXPECT_GT(at[i], 250) << "no place is left out: " << i;
}

TEST(TrialOrder, RefusesWhatCannotBeOrdered) {
  const auto error = [](const json& programme) {
    return error_of([&] { (void)schedule(programme_from_json(programme, "p.json")); });
  };
  EXPECT_THAT(error(ordered_programme("interleaved", {6, -3}, 1)), HasSubstr("3 catch trials have no room"));
  EXPECT_EQ(error(ordered_programme("interleaved", {6, -2}, 1)), "no error");
  EXPECT_THAT(error(ordered_programme("listed", {6, -1}, 1)), HasSubstr("catch trials lie at random places"));
  EXPECT_THAT(error(ordered_programme("random", {6}, 1)), HasSubstr("order"));
  json seeded = ordered_programme("listed", {6}, 1);
  seeded["seed"] = 1;
  EXPECT_THAT(error(seeded), HasSubstr("seed: the order 'listed' is not random"));
}

TEST(TrialOrder, GetsASeedFromTheSystemIfThereIsNone) {
  json programme = ordered_programme("interleaved", {2, 2}, 1);
  EXPECT_EQ(with_seed(programme, "p.json")["seed"], 1);
  programme.erase("seed");
  const json drawn = with_seed(programme, "p.json");
  EXPECT_TRUE(programme_from_json(drawn, "p.json").seed);
  EXPECT_FALSE(with_seed(ordered_programme("listed", {2}, 1), "p.json").contains("seed"));
}

}  // namespace
}  // namespace haptrace
