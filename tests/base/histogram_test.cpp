#include "base/histogram.h"

#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <random>
#include <vector>

namespace haptrace {
namespace {

TEST(DurationHistogram, IsEmptyAtFirst) {
  const DurationHistogram histogram;
  EXPECT_EQ(histogram.count(), 0U);
  EXPECT_EQ(histogram.quantile(0.5), 0);
  EXPECT_EQ(histogram.max(), 0);
}

TEST(DurationHistogram, QuantilesAreTheExactOnesRoundedUpByAtMostOneThirtySecond) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> exponent(0, 11);
  DurationHistogram histogram;
  std::vector<std::int64_t> values;
  for (int i = 0; i < 20000; ++i) {
    values.push_back(std::llround(std::pow(10, exponent(random))));
    histogram.record(values.back());
  }
  std::sort(values.begin(), values.end());
  for (const double q : {0.001, 0.1, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size()))) - 1;
    const double exact = 1e-9 * static_cast<double>(values[rank]);
    EXPECT_GE(histogram.quantile(q), exact * (1 - 1e-12)) << q;
    EXPECT_LE(histogram.quantile(q), exact * (1 + 1.0 / 32) + 1e-9) << q;
  }
  EXPECT_EQ(histogram.max(), 1e-9 * static_cast<double>(values.back()));
}

TEST(DurationHistogram, MergesAsIfRecordedHere) {
  std::mt19937_64 random(4);
  std::uniform_int_distribution<std::int64_t> duration(0, 1'000'000);
  DurationHistogram whole, first, second;
  for (int i = 0; i < 1000; ++i) {
    const std::int64_t value = duration(random);
    const std::uint64_t times = random() % 3;
    for (std::uint64_t n = 0; n < times; ++n) whole.record(value);
    (i % 3 == 0 ? first : second).record(value, times);
  }
  first.merge(second);
  EXPECT_EQ(first.count(), whole.count());
  EXPECT_EQ(first.max(), whole.max());
  for (const double q : {0.0, 0.1, 0.5, 0.9, 0.99, 1.0}) EXPECT_EQ(first.quantile(q), whole.quantile(q)) << q;
  first.merge({});
  EXPECT_EQ(first.count(), whole.count());
}

TEST(DurationHistogram, AcceptsNegativeZeroAndInfiniteDurations) {
  DurationHistogram histogram;
  histogram.record(-5);
  histogram.record(0);
  EXPECT_EQ(histogram.quantile(1), 0);
  histogram.record(INT64_MAX);
  EXPECT_EQ(histogram.count(), 3U);
  EXPECT_EQ(histogram.max(), 1e-9 * static_cast<double>(INT64_MAX));
  EXPECT_EQ(histogram.quantile(0.1), 0);
}

}  // namespace
}  // namespace haptrace
