#include "view/history.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>
#include <random>

namespace haptrace {
namespace {

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();
constexpr std::int64_t kPeriod = 1'000'000;  // [ns]

/// Rows of two columns, all of them, as a history is to summarise them.
struct AllRows {
  ViewRows rows{2};

  /// Returns the bin of [from, to) of a column.
  [[nodiscard]] PyramidBin bin(std::int64_t from, std::int64_t to, std::size_t channel) const {
    PyramidBin result;
    std::size_t first = rows.size(), min = 0, max = 0;
    for (std::size_t row = 0; row < rows.size(); ++row) {
      const float value = rows.planes[channel][row];
      if (rows.time_ns[row] < from || rows.time_ns[row] >= to || std::isnan(value)) continue;
      if (first == rows.size()) {
        first = min = max = row;
        result.cell.first = value;
      }
      if (value < rows.planes[channel][min]) min = row;
      if (value > rows.planes[channel][max]) max = row;
      result.cell.last = value;
    }
    if (first == rows.size()) return result;
    result.cell.min = rows.planes[channel][min];
    result.cell.max = rows.planes[channel][max];
    result.min_first = min <= max;
    return result;
  }
};

void expect_same(const PyramidBin& bin, const PyramidBin& expected) {
  const auto same = [](float a, float b) { return a == b || (std::isnan(a) && std::isnan(b)); };
  EXPECT_TRUE(same(bin.cell.first, expected.cell.first)) << bin.cell.first << " " << expected.cell.first;
  EXPECT_TRUE(same(bin.cell.min, expected.cell.min)) << bin.cell.min << " " << expected.cell.min;
  EXPECT_TRUE(same(bin.cell.max, expected.cell.max)) << bin.cell.max << " " << expected.cell.max;
  EXPECT_TRUE(same(bin.cell.last, expected.cell.last)) << bin.cell.last << " " << expected.cell.last;
  if (!std::isnan(expected.cell.min) && expected.cell.min < expected.cell.max) {
    EXPECT_EQ(bin.min_first, expected.min_first);
  }
}

/// Appends `count` rows with gaps, missing values and equal values.
void append_random(std::mt19937& random, std::size_t count, History& history, AllRows& all) {
  std::int64_t time = all.rows.size() > 0 ? all.rows.time_ns.back() : 0;
  std::uniform_int_distribution<int> dice(0, 9999);
  for (std::size_t i = 0; i < count; ++i) {
    const int what = dice(random);
    time += kPeriod;
    if (what < 30) time += kPeriod * dice(random);
    if (what == 31) time += 70'000 * kPeriod;
    const std::vector<float> values{what % 7 == 0 ? kMissing : static_cast<float>(what % 100),
                                    static_cast<float>(dice(random))};
    history.append(time, values);
    all.rows.add(time, values);
  }
}

TEST(History, BinsOfRandomRowsEqualThoseOfASearchThroughAllRows) {
  std::mt19937 random(1);
  for (int round = 0; round < 6; ++round) {
    History history(2, kPeriod);
    AllRows all;
    for (int query = 0; query < 12; ++query) {
      append_random(random, 1 + random() % 30'000, history, all);
      const std::int64_t end = all.rows.time_ns.back();
      std::uniform_int_distribution<std::int64_t> times(-kPeriod, end + kPeriod);
      const std::int64_t a = times(random), b = times(random);
      const std::size_t pixels = 1 + random() % 40;
      const std::int64_t width = history.bin_width(std::min(a, b), std::max(a, b), pixels);
      const std::vector<std::size_t> channels{1, 0};
      const ViewBins bins = history.bins(std::min(a, b), std::max(a, b), width, channels);
      EXPECT_LE(bins.count, pixels + 2);
      EXPECT_LE(bins.first_ns, std::min(a, b));
      EXPECT_GT(bins.first_ns + static_cast<std::int64_t>(bins.count) * bins.width_ns, std::max(a, b));
      EXPECT_EQ(bins.first_ns % bins.width_ns, 0) << "bins are anchored in absolute time";
      for (std::size_t k = 0; k < bins.count; ++k) {
        const std::int64_t from = bins.first_ns + static_cast<std::int64_t>(k) * bins.width_ns;
        for (std::size_t i = 0; i < channels.size(); ++i)
          expect_same(bins.channels[i][k], all.bin(from, from + bins.width_ns, channels[i]));
      }
    }
  }
}

TEST(History, ASpikeOfOneRowIsInTheBinsOfEveryWidth) {
  History history(1, kPeriod);
  constexpr std::int64_t kSpike = 654'321;
  for (std::int64_t row = 0; row < 1'000'000; ++row)
    history.append(row * kPeriod, std::vector<float>{row == kSpike ? 9.F : 1.F});
  for (std::int64_t width = 1; width <= 1'048'576; width *= 2) {
    const std::int64_t from = std::max<std::int64_t>(0, kSpike - 100 * width) * kPeriod;
    const std::int64_t to = std::min<std::int64_t>(999'999, kSpike + 100 * width) * kPeriod;
    const ViewBins bins = history.bins(from, to, width, std::vector<std::size_t>{0});
    std::size_t spikes = 0;
    for (const PyramidBin& bin : bins.channels[0]) spikes += bin.cell.max == 9 ? 1 : 0;
    EXPECT_EQ(spikes, 1U) << "at a width of " << width;
  }
}

TEST(History, MemoryStaysWithinItsBoundsAndTheNewestRowsStay) {
  constexpr History::Bounds kBounds{.rows = 4U << 20U, .cells = 1U << 20U};
  History history(4, kPeriod, kBounds);
  constexpr std::int64_t kRows = 2'000'000;
  const std::vector<float> values{1, 2, 3, 4};
  PyramidBlock block(4);
  block.add(0, values);
  for (std::int64_t row = 0; row < kRows; ++row) {
    history.append(row * kPeriod, values);
    ASSERT_LE(history.row_memory(), kBounds.rows);
    // The block that grows keeps its cells.
    ASSERT_LE(history.cell_memory(), kBounds.cells + block.bytes());
  }
  bool cut = true;
  EXPECT_EQ(history.rows((kRows - 10'000) * kPeriod, kRows * kPeriod, 1U << 20U, cut).size(), 10'000U);
  EXPECT_FALSE(cut);
  EXPECT_EQ(history.rows(0, 10'000 * kPeriod, 1U << 20U, cut).size(), 0U);
  EXPECT_TRUE(cut) << "the first rows are no longer kept";
  const ViewBins bins = history.bins(0, kRows * kPeriod, 1024, std::vector<std::size_t>{2});
  for (std::size_t k = 0; k + 1 < bins.count; ++k) ASSERT_EQ(bins.channels[0][k].cell.max, 3);
}

TEST(History, RowsOfAStretchComeInOrderUpToTheMostAsked) {
  History history(1, kPeriod);
  for (std::int64_t row = 0; row < 200'000; ++row)
    history.append(row * kPeriod, std::vector<float>{static_cast<float>(row)});
  bool cut = false;
  const ViewRows rows = history.rows(65'000 * kPeriod, 66'999 * kPeriod, 20'000, cut);
  EXPECT_FALSE(cut);
  ASSERT_EQ(rows.size(), 2000U) << "over the border of two blocks";
  for (std::size_t i = 0; i < rows.size(); ++i) ASSERT_EQ(rows.planes[0][i], static_cast<float>(65'000 + i));
  EXPECT_EQ(history.rows(0, 199'999 * kPeriod, 20'000, cut).size(), 20'000U);
  EXPECT_TRUE(cut);
}

TEST(History, RowsWhoseTimeDoesNotIncreaseAreIgnored) {
  History history(1, kPeriod);
  history.append(5 * kPeriod, std::vector<float>{1});
  history.append(5 * kPeriod, std::vector<float>{2});
  history.append(4 * kPeriod, std::vector<float>{3});
  bool cut = false;
  const ViewRows rows = history.rows(0, 10 * kPeriod, 100, cut);
  ASSERT_EQ(rows.size(), 1U);
  EXPECT_EQ(rows.planes[0][0], 1);
}

TEST(History, ABlockThatWasReadFromAFileAnswersLikeOneThatGrew) {
  std::mt19937 random(2);
  History grown(2, kPeriod), put(2, kPeriod);
  AllRows all;
  append_random(random, 300'000, grown, all);
  const std::int64_t last = grown.block_of(all.rows.time_ns.back());
  for (std::int64_t block = last; block >= 0; --block) {  // in another order
    ViewRows rows(2);
    for (std::size_t row = 0; row < all.rows.size(); ++row)
      if (put.block_of(all.rows.time_ns[row]) == block) rows.add(all.rows, row, 1);
    put.put(block, std::move(rows));
    EXPECT_TRUE(put.has_cells(block, 256));
  }
  const std::vector<std::size_t> channels{0, 1};
  for (const std::int64_t width : {4, 256, 4096, 65536, 262144}) {
    const ViewBins a = grown.bins(0, all.rows.time_ns.back(), width, channels);
    const ViewBins b = put.bins(0, all.rows.time_ns.back(), width, channels);
    ASSERT_EQ(a.count, b.count);
    for (std::size_t i = 0; i < channels.size(); ++i)
      for (std::size_t k = 0; k < a.count; ++k) expect_same(b.channels[i][k], a.channels[i][k]);
  }
}

}  // namespace
}  // namespace haptrace
