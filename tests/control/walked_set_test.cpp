#include "control/walked_set.h"

#include <gtest/gtest.h>
#include <random>
#include <vector>

namespace haptrace {
namespace {

TEST(WalkedSet, CountsEveryPartOnceWhateverTheOrderAndDirection) {
  WalkedSet walked;
  EXPECT_NEAR(walked.add(0, 0.1), 0.1, 1e-12);
  EXPECT_NEAR(walked.add(0.1, 0.05), 0, 1e-12) << "back";
  EXPECT_NEAR(walked.add(0.3, 0.4), 0.1, 1e-12) << "after a skipped part";
  EXPECT_EQ(walked.intervals(), 2U);
  EXPECT_NEAR(walked.add(0.35, 0.08), 0.2, 1e-12) << "the skipped part, backwards";
  EXPECT_EQ(walked.intervals(), 1U);
  walked.clear();
  EXPECT_NEAR(walked.add(0, 0.4), 0.4, 1e-12);
}

TEST(WalkedSet, AgreesWithAMapOfCells) {
  std::mt19937 random(4);
  std::uniform_int_distribution<int> cell(0, 99);
  for (int round = 0; round < 100; ++round) {
    WalkedSet walked;
    std::vector<bool> cells(100, false);
    for (int i = 0; i < 30; ++i) {
      const int a = cell(random), b = std::min(a + cell(random) / 10, 100);
      int fresh = 0;
      for (int k = a; k < b; ++k) {
        fresh += cells[static_cast<std::size_t>(k)] ? 0 : 1;
        cells[static_cast<std::size_t>(k)] = true;
      }
      ASSERT_NEAR(walked.add(a, b), fresh, 1e-9);
    }
  }
}

TEST(WalkedSet, JoinsTheClosestIntervalsWhenThereAreTooMany) {
  WalkedSet walked;
  for (int i = 0; i < 100; ++i) (void)walked.add(10 * i + (i == 7 ? -8 : 0), 10 * i + 1);
  EXPECT_LE(walked.intervals(), 32U);
  EXPECT_EQ(walked.add(61, 62), 0) << "the smallest gap counts as walked";
}

}  // namespace
}  // namespace haptrace
