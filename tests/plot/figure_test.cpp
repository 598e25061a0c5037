#include "plot/figure.h"

#include "plot/axis.h"
#include "tests/formats/support.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace haptrace {
namespace {

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

Series noise(std::size_t n) {
  Series series{.label = "noise"};
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (std::size_t i = 0; i < n; ++i) {
    series.x.push_back(0.001 * static_cast<double>(i));
    series.y.push_back(normal(random));
  }
  return series;
}

Figure figure_with(Series series) {
  Panel panel;
  panel.title = "panel";
  panel.x_label = "time [s]";
  panel.y_label = "force [N]";
  panel.series.push_back(std::move(series));
  Figure figure;
  figure.title = "title";
  figure.caption = "caption";
  figure.rows = {{panel}};
  return figure;
}

TEST(Decimate, KeepsPeaksEndsAndOrder) {
  Series series = noise(100'000);
  series.y[43'210] = 99;
  series.y[43'211] = -77;
  for (const std::size_t points : {4u, 100u, 1001u, 50'000u}) {
    const Series thin = decimate(series, points);
    ASSERT_EQ(thin.x.size(), thin.y.size());
    EXPECT_LE(thin.x.size(), points);
    EXPECT_GE(thin.x.size(), points / 2);
    EXPECT_EQ(thin.x.front(), series.x.front());
    EXPECT_EQ(thin.y.front(), series.y.front());
    EXPECT_EQ(thin.x.back(), series.x.back());
    EXPECT_EQ(thin.y.back(), series.y.back());
    EXPECT_EQ(*std::max_element(thin.y.begin(), thin.y.end()), 99);
    EXPECT_EQ(*std::min_element(thin.y.begin(), thin.y.end()), -77);
    EXPECT_TRUE(std::is_sorted(thin.x.begin(), thin.x.end()));
    EXPECT_EQ(thin.label, series.label);
  }
}

TEST(Decimate, KeepsThePositionsOfItsPoints) {
  const Series series = noise(10'000), thin = decimate(series, 200);
  for (std::size_t i = 0; i < thin.x.size(); ++i) {
    const auto at = static_cast<std::size_t>(std::lround(1000 * thin.x[i]));
    EXPECT_EQ(thin.y[i], series.y[at]);
  }
}

TEST(Decimate, LeavesAShortLineAsItIs) {
  const Series series = noise(100), same = decimate(series, 100);
  EXPECT_EQ(same.x, series.x);
  EXPECT_EQ(same.y, series.y);
  EXPECT_TRUE(decimate({}, 10).x.empty());
}

TEST(Decimate, KeepsBreaksAndStaysBoundedWithManyOfThem) {
  Series series = noise(10'000);
  for (std::size_t i = 4000; i < 6000; ++i) series.y[i] = kMissing;
  const Series thin = decimate(series, 400);
  EXPECT_TRUE(std::any_of(thin.y.begin(), thin.y.end(), [](double y) { return std::isnan(y); }));
  for (std::size_t i = 1; i < thin.x.size(); ++i)
    if (std::isfinite(thin.y[i]) && std::isfinite(thin.y[i - 1])) {
      EXPECT_LT(thin.x[i] - thin.x[i - 1], 1.0);
    }

  for (std::size_t i = 0; i < series.y.size(); i += 2) series.y[i] = kMissing;
  EXPECT_LE(decimate(series, 400).x.size(), 500u);
}

TEST(Ticks, AreRoundAndWithinTheRange) {
  for (const auto& [low, high] :
       {std::pair{0.0, 1.0}, {-3.7, 12.4}, {1e9, 1e9 + 3}, {-2e-9, 1e-9}, {0.0999, 0.1001}, {1e-9, 1e9}})
    for (std::size_t most = 2; most < 20; ++most) {
      const std::vector<double> ticks = tick_values(low, high, most);
      ASSERT_LE(ticks.size(), most);
      ASSERT_GE(ticks.size(), 1u);
      const double slack = 1e-8 * (high - low);
      EXPECT_GE(ticks.front(), low - slack);
      EXPECT_LE(ticks.back(), high + slack);
      if (ticks.size() < 2) continue;
      const double step = ticks[1] - ticks[0], digit = step / std::pow(10, std::floor(std::log10(step) + 1e-4));
      EXPECT_LE(std::min({std::abs(digit - 1), std::abs(digit - 2), std::abs(digit - 5)}), 1e-4) << step;
    }
}

TEST(Ticks, AreOneTwoOrFiveTimesAPowerOfTen) {
  EXPECT_EQ(tick_values(0, 10, 6), (std::vector<double>{0, 2, 4, 6, 8, 10}));
  EXPECT_EQ(tick_values(-40, 40, 5), (std::vector<double>{-40, -20, 0, 20, 40}));
  EXPECT_EQ(tick_values(0, 1, 3), (std::vector<double>{0, 0.5, 1}));
}

TEST(Ticks, AreAbsentWithoutARange) {
  EXPECT_TRUE(tick_values(1, 1, 5).empty());
  EXPECT_TRUE(tick_values(2, 1, 5).empty());
  EXPECT_TRUE(tick_values(kMissing, 1, 5).empty());
  EXPECT_TRUE(tick_values(0, 1, 0).empty());
  EXPECT_TRUE(tick_values(-1e308, 1e308, 5).empty());
}

TEST(Figure, HasTheFormatOfItsEnding) {
  const TempFolder folder;
  const Figure figure = figure_with(noise(1000));
  save_figure(figure, folder / "a.png", false);
  save_figure(figure, folder / "a.svg", false);
  save_figure(figure, folder / "a.pdf", false);
  EXPECT_EQ(read_bytes(folder / "a.png").substr(0, 8), "\x89PNG\r\n\x1a\n");
  EXPECT_NE(read_bytes(folder / "a.svg").substr(0, 300).find("<svg"), std::string::npos);
  EXPECT_EQ(read_bytes(folder / "a.pdf").substr(0, 5), "%PDF-");
}

TEST(Figure, HasTwiceItsSizeInPixels) {
  const TempFolder folder;
  Figure figure = figure_with(noise(10));
  figure.width = 300;
  figure.height = 200;
  save_figure(figure, folder / "a.png", false);
  const std::string header = read_bytes(folder / "a.png").substr(16, 8);
  EXPECT_EQ(header, std::string("\0\0\x02\x58\0\0\x01\x90", 8));  // 600 x 400
}

TEST(Figure, DrawsAnyValues) {
  const double inf = std::numeric_limits<double>::infinity(), most = std::numeric_limits<double>::max();
  const TempFolder folder;
  const std::vector<Series> odd{{},
                                {.x = {1}, .y = {2}},
                                {.x = {1, 2, 3}, .y = {0, 0, 0}},
                                {.x = {1, 2, 3}, .y = {1e9, 1e9, 1e9}},
                                {.x = {1, 1, 1}, .y = {1, 2, 3}, .dashed = true},
                                {.x = {1, 2, 3}, .y = {kMissing, kMissing, kMissing}},
                                {.x = {1, 2, 3, 4}, .y = {1, kMissing, inf, -inf}, .color = -3},
                                {.x = {1, 2, 3}, .y = {most, -most, 0}, .color = 1000},
                                {.x = {1e-9, 1, 1e9}, .y = {1e-9, 1, 1e9}, .dashed = true},
                                {.x = {0, 1e-300}, .y = {0, 1e-300}},
                                {.x = {1, 2, 3}, .y = {1}},
                                {.label = std::string(500, 'w'), .x = {1, 2}, .y = {1e99, -1e99}}};
  Figure all;
  all.title = std::string(1000, 'T');
  all.caption = std::string(1000, 'c') + " two\nlines";
  for (const Series& series : odd) {
    for (const bool equal : {false, true}) {
      Figure figure = figure_with(series);
      figure.rows[0][0].equal_scale = equal;
      figure.rows[0][0].log_x = figure.rows[0][0].log_y = !equal;
      all.rows.push_back(figure.rows[0]);
      EXPECT_NO_THROW(save_figure(figure, folder / "a.png", true));
      EXPECT_NO_THROW(save_figure(figure, folder / "a.svg", true));
    }
  }
  EXPECT_NO_THROW(save_figure(all, folder / "all.png", true)) << "panels without room";
  EXPECT_NO_THROW(save_figure(Figure{}, folder / "none.pdf", true));
  Figure ranges = figure_with(noise(100));
  ranges.rows[0][0].x_range = {5, 5};
  ranges.rows[0][0].y_range = {-1e-9, 1e-9};
  EXPECT_NO_THROW(save_figure(ranges, folder / "a.png", true));
}

TEST(Figure, DrawsLogarithmicAxesLikeTheLogarithms) {
  // Without labels both have the same margins, so that the lines are drawn alike.
  const auto drawn = [](bool log) {
    const TempFolder folder;
    Figure figure = figure_with({.x = {}, .y = {}});
    Panel& panel = figure.rows[0][0];
    for (int i = 0; i <= 8; ++i) {
      panel.series[0].x.push_back(log ? std::pow(10, i) : i);
      panel.series[0].y.push_back(log ? std::pow(10, std::sin(i)) : std::sin(i));
    }
    panel.log_x = panel.log_y = log;
    panel.x_range = log ? std::pair{1.0, 1e8} : std::pair{0.0, 8.0};
    panel.y_range = log ? std::pair{0.1, 10.0} : std::pair{-1.0, 1.0};
    save_figure(figure, folder / "a.svg", false);
    const std::string svg = read_bytes(folder / "a.svg");
    // The line is the only path in the palette's first colour.
    const std::size_t line = svg.find("rgb(0%,44");
    EXPECT_NE(line, std::string::npos);
    const std::size_t path = svg.find(" d=\"", line);
    std::vector<double> heights;
    const char* at = svg.c_str() + path + 4;
    for (int i = 0; i <= 8; ++i) {
      char* end = nullptr;
      while (*at == 'M' || *at == 'L' || *at == ' ') ++at;
      (void)std::strtod(at, &end);
      at = end;
      heights.push_back(std::strtod(at, &end));
      at = end;
    }
    return heights;
  };
  const std::vector<double> logarithmic = drawn(true), linear = drawn(false);
  for (std::size_t i = 0; i < linear.size(); ++i) EXPECT_NEAR(logarithmic[i], linear[i], 1e-3) << i;
  EXPECT_GT(linear[5] - linear[2], 10);
}

TEST(Figure, StaysSmallWithManyPoints) {
  const TempFolder folder;
  save_figure(figure_with(noise(300'000)), folder / "a.svg", false);
  EXPECT_LT(read_bytes(folder / "a.svg").size(), 1'000'000u);
}

TEST(Figure, ReplacesAFileOnlyWhenAllowed) {
  const TempFolder folder;
  const std::string file = folder.write("a.png", "mine");
  expect_error([&] { save_figure(figure_with(noise(10)), file, false); }, Error::Kind::input,
               {"a.png", "exists already"});
  EXPECT_EQ(read_bytes(file), "mine");
  save_figure(figure_with(noise(10)), file, true);
  EXPECT_EQ(read_bytes(file).substr(1, 3), "PNG");
  const std::filesystem::directory_iterator files(folder.path());
  EXPECT_EQ(std::distance(begin(files), end(files)), 1) << "something was left beside it";
}

TEST(Figure, NamesTheReasonWhenItCannotBeSaved) {
  const TempFolder folder;
  const Figure figure = figure_with(noise(10));
  expect_error([&] { save_figure(figure, folder / "a.jpg", false); }, Error::Kind::input,
               {"a.jpg", "must end in .png, .svg or .pdf"});
  expect_error([&] { save_figure(figure, folder / "figure", false); }, Error::Kind::input, {"must end in .png"});
  expect_error([&] { save_figure(figure, folder / "missing/a.png", false); }, Error::Kind::input,
               {"missing", "does not exist"});
  for (const double width : {0.0, -1.0, 1e6, kMissing}) {
    Figure wrong = figure;
    wrong.width = width;
    expect_error([&] { save_figure(wrong, folder / "a.png", false); }, Error::Kind::input,
                 {"each must be 200 to 10000"});
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "a.png"));
}

}  // namespace
}  // namespace haptrace
