// Laws of the order of reaches, over many seeds.
#include "player/programme/reach_order.h"

#include "tests/support/errors.h"

#include <algorithm>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <set>

namespace haptrace {
namespace {

using test::error_of;
using testing::HasSubstr;

ReachTask task_of(std::size_t targets, std::vector<ReachBlock> blocks) {
  ReachTask task;
  task.targets.assign(targets, Vec3(0.08, 0, 0));
  task.blocks = std::move(blocks);
  return task;
}

std::vector<PlannedReach> drawn(const ReachTask& task, std::uint64_t seed) {
  OrderDraw draw(seed);
  return order_of_reaches(task, draw);
}

TEST(ReachOrder, ReachesEveryTargetOnceACycleAndNoneTwiceInARow) {
  for (const std::size_t targets : {2U, 3U, 8U})
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
      const auto reaches = drawn(task_of(targets, {{.reaches = static_cast<int>(5 * targets)}}), seed);
      for (std::size_t cycle = 0; cycle < 5; ++cycle) {
        std::set<int> seen;
        for (std::size_t i = 0; i < targets; ++i) seen.insert(reaches[cycle * targets + i].target);
        EXPECT_EQ(seen.size(), targets);
      }
      for (std::size_t i = 1; i < reaches.size(); ++i) EXPECT_NE(reaches[i].target, reaches[i - 1].target);
    }
}

TEST(ReachOrder, SpreadsClampsAndCatchTrialsByTheRulesOfAdaptationStudies) {
  const ReachTask task = task_of(8, {{.name = "field", .reaches = 40, .field = true, .clamps = 0.15, .catches = 0.1}});
  std::set<std::size_t> places;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    const auto reaches = drawn(task, seed);
    int clamps = 0, catches = 0;
    for (std::size_t i = 0; i < reaches.size(); ++i) {
      if (reaches[i].kind == ReachKind::plain) continue;
      clamps += reaches[i].kind == ReachKind::clamp ? 1 : 0;
      catches += reaches[i].kind == ReachKind::catch_trial ? 1 : 0;
      EXPECT_GE(i, 5U) << "none among the first five";
      EXPECT_EQ(reaches[i - 1].kind, ReachKind::plain) << "no two in a row";
      places.insert(i);
    }
    EXPECT_EQ(clamps, 6);
    EXPECT_EQ(catches, 4);
  }
  EXPECT_EQ(places.size(), 35U) << "every other place is possible";
}

TEST(ReachOrder, FollowsTheBlocksAndDrawsTheHoldBetweenItsBounds) {
  ReachTask task = task_of(4, {{.name = "a", .reaches = 6}, {.name = "b", .reaches = 7, .field = true}});
  task.least_start_hold = 0.5;
  task.most_start_hold = 1;
  double least = 2, most = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const auto reaches = drawn(task, seed);
    ASSERT_EQ(reaches.size(), 13U);
    for (std::size_t i = 0; i < reaches.size(); ++i) {
      EXPECT_EQ(reaches[i].block, i < 6 ? 0 : 1);
      least = std::min(least, reaches[i].start_hold);
      most = std::max(most, reaches[i].start_hold);
    }
    EXPECT_EQ(reaches, drawn(task, seed)) << "a seed gives one order";
  }
  EXPECT_NEAR(least, 0.5, 0.01);
  EXPECT_NEAR(most, 1, 0.01);
  EXPECT_NE(drawn(task, 1), drawn(task, 2));
}

TEST(ReachOrder, RefusesABlockWithoutRoomForItsClamps) {
  EXPECT_EQ(drawn(task_of(4, {{.reaches = 14, .clamps = 0.36}}), 1).size(), 14U) << "five clamps just fit";
  EXPECT_THAT(error_of([] { (void)drawn(task_of(4, {{.name = "short", .reaches = 10, .clamps = 0.5}}), 1); }),
              HasSubstr("'short' has no room for 5 clamps and 0 catch trials among 10 reaches"));
}

}  // namespace
}  // namespace haptrace
