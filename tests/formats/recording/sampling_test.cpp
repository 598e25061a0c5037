#include "formats/recording/sampling.h"

#include "tests/formats/support.h"

#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

/// Returns the sample at `t` [s] of a hand on a circle, with true position and velocity. The force comes from a sensor
/// of rate `sensor_hz`; 0 means a continuous force.
Sample at(double t, double sensor_hz = 0) {
  const double w = 2 * std::numbers::pi * 0.7;
  const double felt = sensor_hz > 0 ? std::floor(t * sensor_hz + 1e-6) / sensor_hz : t;
  Sample sample;
  sample.time_ns = std::llround(t * 1e9);
  sample.position = 0.05 * Vec3(std::cos(w * t), std::sin(w * t), 0.3 * std::cos(3 * w * t));
  sample.velocity = 0.05 * w * Vec3(-std::sin(w * t), std::cos(w * t), -0.9 * std::sin(3 * w * t));
  sample.force = Vec3(1 + std::cos(5 * felt), std::sin(7 * felt), 2 + std::sin(felt));
  return sample;
}

/// Returns the sampling report for rows at these stamps [ms].
Sampling sampling_of(const std::vector<double>& stamps_ms, double sensor_hz = 0) {
  SamplingReport report;
  for (const double ms : stamps_ms) report.add(at(1e-3 * ms, sensor_hz));
  return report.result();
}

std::vector<double> stamps(const std::vector<double>& steps_ms, std::size_t rows) {
  std::vector<double> all{0};
  while (all.size() < rows) all.push_back(all.back() + steps_ms[(all.size() - 1) % steps_ms.size()]);
  return all;
}

std::string all_notes(const Sampling& sampling) {
  std::string all;
  for (const std::string& note : notes(sampling)) all += note + "\n";
  return all;
}

void expect_steps(const std::vector<double>& found, const std::vector<double>& expected_ms) {
  ASSERT_EQ(found.size(), expected_ms.size());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(1e3 * found[i], expected_ms[i], 0.02) << i;
}

TEST(Sampling, ReportsNothingForAnEvenLog) {
  for (const double step : {0.05, 1.0, 10.0 / 7, 33.3}) {
    const Sampling found = sampling_of(stamps({step}, 3000));
    EXPECT_TRUE(found.even);
    EXPECT_EQ(all_notes(found), "");
    EXPECT_NEAR(found.mean_rate, 1000 / step, 1e-3 / step);
    EXPECT_NEAR(found.median_step, 1e-3 * step, 2e-8);
    EXPECT_NEAR(found.motion_ratio, 1, 1e-2);
  }
}

TEST(Sampling, FindsTheStepsThatRepeatWhereverTheyBeginAndTheClockTheyComeFrom) {
  std::vector<double> pattern{1, 2, 1, 2, 1, 1, 2};
  for (std::size_t turn = 0; turn < pattern.size(); ++turn) {
    std::rotate(pattern.begin(), pattern.begin() + 1, pattern.end());
    const Sampling found = sampling_of(stamps(pattern, 2000));
    expect_steps(found.pattern, {1, 2, 1, 2, 1, 1, 2});
    EXPECT_GT(found.pattern_share, 0.95);
    EXPECT_NEAR(found.clock_period, 1e-3, 1e-9);
    EXPECT_NEAR(found.missing, 0.3, 1e-9);
    EXPECT_NEAR(found.mean_rate, 700, 1);
  }
  expect_steps(sampling_of(stamps({1, 2}, 500)).pattern, {1, 2});
  expect_steps(sampling_of(stamps({1, 1, 1, 5}, 500)).pattern, {1, 1, 1, 5});
}

TEST(Sampling, FindsThePatternInALogThatIsEvenWhereTheHandRestsAndHasStampsToTheMicrosecond) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> jitter(-0.02, 0.02);
  std::vector<double> all = stamps({10.0 / 7}, 1500);
  const std::vector<double> pattern{1, 2, 1, 2, 1, 1, 2};
  for (std::size_t i = 0; i < 1500; ++i) all.push_back(all.back() + pattern[i % 7]);
  for (std::size_t i = 0; i < 1000; ++i) all.push_back(all.back() + 10.0 / 7);
  for (double& ms : all) ms += jitter(random);
  const Sampling found = sampling_of(all);
  ASSERT_EQ(found.pattern.size(), 7U);
  EXPECT_NEAR(found.pattern_share, 1500.0 / 4000, 0.02);
  EXPECT_NEAR(found.missing, 0.3, 1e-9);
  EXPECT_NE(all_notes(found).find("they repeat 1, 2, 1, 2, 1, 1, 2 ms; that is the pattern of a clock of "),
            std::string::npos)
      << all_notes(found);
}

TEST(Sampling, FindsTheClockOfALogThatLostRowsAtRandomAndNoPattern) {
  std::mt19937_64 random(5);
  std::vector<double> all{0};
  while (all.size() < 4000) all.push_back(all.back() + (random() % 4 == 0 ? 2 : 1));
  const Sampling found = sampling_of(all);
  EXPECT_TRUE(found.pattern.empty());
  EXPECT_NEAR(found.clock_period, 1e-3, 1e-9);
  EXPECT_NEAR(found.missing, 0.2, 0.02);
  EXPECT_NE(all_notes(found).find("they are multiples of a clock of 1000 Hz that lacks 20 % of its ticks"),
            std::string::npos)
      << all_notes(found);
}

TEST(Sampling, MakesUpNoClockAndNoPatternForNoise) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> step(0.5, 3);
  std::vector<double> all{0};
  while (all.size() < 4000) all.push_back(all.back() + step(random));
  const Sampling found = sampling_of(all);
  EXPECT_TRUE(found.pattern.empty());
  EXPECT_EQ(found.clock_period, 0);
  EXPECT_FALSE(found.even);
}

TEST(Sampling, ReportsNothingForAClockThatMerelyJitters) {
  std::mt19937_64 random(9);
  std::exponential_distribution<double> late(1 / 0.06);  // lateness of a tick [ms]
  std::vector<double> all;
  for (int i = 0; i < 8000; ++i) all.push_back(i + std::min(late(random), 0.9));
  const Sampling found = sampling_of(all);
  EXPECT_FALSE(found.even);
  EXPECT_TRUE(found.steady);
  EXPECT_TRUE(found.pattern.empty());
  EXPECT_EQ(all_notes(found), "");
  for (double& ms : all)
    if (std::fmod(std::floor(ms), 25) == 7) ms += 0.8;  // every 25th row late by most of a step
  EXPECT_FALSE(sampling_of(all).steady);
}

TEST(Sampling, CountsGapsDuplicatesAndStampsThatGoBack) {
  std::vector<double> all = stamps({1}, 1000);
  for (std::size_t i = 500; i < all.size(); ++i) all[i] += 40;
  all[700] = all[699];
  all[800] = all[798];
  const Sampling found = sampling_of(all);
  EXPECT_EQ(found.gaps, 1U);
  EXPECT_NEAR(found.longest_step, 0.041, 1e-9);
  EXPECT_EQ(found.longest_at, 501U);
  EXPECT_EQ(found.duplicates, 1U);
  EXPECT_EQ(found.backward, 1U);
  EXPECT_NE(all_notes(found).find("1 gap longer than 5 median steps, the longest 0.041 s before sample 501"),
            std::string::npos)
      << all_notes(found);
}

TEST(Sampling, FindsASensorThatIsSlowerThanTheRowsAndItsRate) {
  for (const double hz : {100.0, 250.0, 500.0}) {
    const Sampling found = sampling_of(stamps({1, 2, 1, 2, 1, 1, 2}, 4000), hz);
    ASSERT_EQ(found.held.size(), 1U) << hz;
    EXPECT_EQ(found.held[0].name, "force");
    EXPECT_NEAR(found.held[0].rate, hz, 0.03 * hz);
    EXPECT_NEAR(found.held[0].share, 1 - hz / 700, 0.02);
  }
  EXPECT_TRUE(sampling_of(stamps({1}, 4000), 1000).held.empty());
}

TEST(Sampling, ReportsStampsThatDisagreeWithTheMovement) {
  SamplingReport report;
  const std::vector<double> true_ms = stamps({1, 2, 1, 2, 1, 1, 2}, 5000);
  for (std::size_t i = 0; i < true_ms.size(); ++i) {
    Sample sample = at(1e-3 * true_ms[i]);
    sample.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    report.add(sample);
  }
  EXPECT_NEAR(report.result().motion_ratio, 10.0 / 7, 0.01);
  EXPECT_NE(all_notes(report.result()).find("at a mean rate of 700 Hz instead of 1000 Hz they would agree"),
            std::string::npos)
      << all_notes(report.result());
}

TEST(Sampling, DistinguishesConstantChannelsFromChannelsThatStop) {
  SamplingReport report;
  for (int i = 0; i < 6000; ++i) {
    Sample sample = at(1e-3 * i);
    sample.position.z() = 0.1;
    if (i >= 2000 && i < 4000) sample.force.y() = 0.25;
    report.add(sample);
  }
  const Sampling found = report.result();
  EXPECT_EQ(found.constant, std::vector<std::string>{"z"});
  ASSERT_EQ(found.stuck.size(), 1U);
  EXPECT_EQ(found.stuck[0].name, "fy");
  EXPECT_NEAR(found.stuck[0].from, 2, 0.002);
  EXPECT_NEAR(found.stuck[0].duration, 2, 0.002);
  EXPECT_NE(all_notes(found).find("fy does not change for 2 s from 2.000 s on"), std::string::npos);
}

TEST(Sampling, DoesNotTakeASideOfASquareForAStuckSensor) {
  for (const char* shape : {"square", "rectangle", "sharp square"}) {
    SCOPED_TRACE(shape);
    const bool sharp = shape == std::string("sharp square");  // the velocity jumps in its corners
    for (const double repeated : {1, 3}) {
      SamplingReport report;
      const double side = 0.08, seconds = 2;
      for (int i = 0; i < 8000 * static_cast<int>(repeated); ++i) {
        const double t = std::fmod(1e-3 * i, 4 * seconds), s = std::fmod(t, seconds) / seconds;
        const double along = sharp ? s * (1.5 - 0.5 * s) : s * s * s * (10 + s * (-15 + 6 * s));
        const double speed = (sharp ? 1.5 - s : 30 * s * s * (1 - s) * (1 - s)) / seconds;
        const int leg = static_cast<int>(t / seconds);
        const Vec3 corners[]{{0, 0, 0},
                             {side, 0, 0},
                             {side, shape[0] != 'r' ? side : 0.5 * side, 0},
                             {0, shape[0] != 'r' ? side : 0.5 * side, 0},
                             {0, 0, 0}};
        Sample sample;
        sample.time_ns = std::int64_t{1'000'000} * i;
        sample.position = corners[leg] + along * (corners[leg + 1] - corners[leg]);
        sample.velocity = speed * (corners[leg + 1] - corners[leg]);
        report.add(sample);
      }
      EXPECT_TRUE(report.result().stuck.empty()) << all_notes(report.result());
    }
  }
}

TEST(Sampling, FindsAPositionThatFreezesAndThenJumps) {
  SamplingReport report;
  for (int i = 0; i < 6000; ++i) {
    Sample sample = at(1e-3 * i);
    if (i >= 2000 && i < 2700) sample.position.x() = at(1.999).position.x();
    report.add(sample);
  }
  ASSERT_EQ(report.result().stuck.size(), 1U) << all_notes(report.result());
  EXPECT_EQ(report.result().stuck[0].name, "x");
}

TEST(Sampling, FindsAPositionThatFreezesWhileItsVelocityGoesOn) {
  for (const bool all : {true, false})
    for (const int rows : {150, 300, 700}) {
      SCOPED_TRACE(rows);
      SamplingReport report;
      for (int i = 0; i < 6000; ++i) {
        Sample sample = at(1e-3 * i);
        const Vec3 frozen = at(1.999).position;
        if (i >= 2000 && i < 2000 + rows)
          sample.position = all ? frozen : Vec3(frozen.x(), sample.position.y(), sample.position.z());
        report.add(sample);
      }
      const Sampling found = report.result();
      ASSERT_GE(found.stuck.size(), 1U);
      EXPECT_EQ(found.stuck[0].name, "x");
      EXPECT_NEAR(found.stuck[0].from, 2, 0.002);
      EXPECT_NEAR(found.stuck[0].duration, 1e-3 * rows, 0.002);
      EXPECT_EQ(found.stuck.size() > 1, all);
    }
}

TEST(Sampling, TakesNoCoarseOrSlowPositionForAStuckOne) {
  for (const double count : {1e-5, 1e-4, 1e-3})
    for (const int every : {1, 10, 50}) {
      SCOPED_TRACE(count);
      SCOPED_TRACE(every);
      SamplingReport report;
      for (int i = 0; i < 6000; ++i) {
        Sample sample = at(1e-3 * i);
        const Vec3 seen = at(1e-3 * (i - i % every)).position / count;
        sample.position = count * Vec3(std::round(seen.x()), std::round(seen.y()), std::round(seen.z()));
        report.add(sample);
      }
      EXPECT_TRUE(report.result().stuck.empty()) << all_notes(report.result());
    }
}

TEST(Sampling, TakesNoConstantSpeedForASlowSensor) {
  const Vec3 corners[]{{0, 0, 0}, {0.05, 0, 0}, {0.05, 0.05, 0}, {0, 0.05, 0}, {0, 0, 0}};
  const auto report_of = [&](double velocity_factor) {
    SamplingReport report;
    for (int i = 0; i < 4000; ++i) {
      const Vec3 along = corners[i / 1000 + 1] - corners[i / 1000];
      Sample sample;
      sample.time_ns = std::int64_t{1'000'000} * i;
      sample.position = corners[i / 1000] + 1e-3 * (i % 1000) * along;
      sample.velocity = velocity_factor * along;
      report.add(sample);
    }
    return report.result();
  };
  EXPECT_TRUE(report_of(1).held.empty()) << all_notes(report_of(1));
  EXPECT_FALSE(report_of(0.5).held.empty()) << "a velocity that the movement contradicts is doubted";
}

TEST(Sampling, FindsANoisyChannelThatStopsForGood) {
  SamplingReport report;
  for (int i = 0; i < 6000; ++i) {
    Sample sample = at(1e-3 * i);
    const int noise = i * 7919 % 13;
    sample.force.y() = i < 3000 ? 0.01 * noise : 0.01 * (2999 * 7919 % 13);
    report.add(sample);
  }
  ASSERT_EQ(report.result().stuck.size(), 1U) << all_notes(report.result());
  EXPECT_EQ(report.result().stuck[0].name, "fy");
}

TEST(Sampling, IgnoresADeviceAtRest) {
  SamplingReport report;
  for (int i = 0; i < 4000; ++i) {
    Sample sample = at(i < 2000 ? 1e-3 * i : 2);
    sample.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    sample.velocity = i < 2000 ? sample.velocity : Vec3(Vec3::Zero());
    report.add(sample);
  }
  EXPECT_EQ(all_notes(report.result()), "");
}

TEST(Sampling, IsAJsonObjectWithTheSameValues) {
  const Sampling found = sampling_of(stamps({1, 2}, 500), 100);
  const nlohmann::json json = json_of(found);
  EXPECT_EQ(json["rows"], 500);
  EXPECT_NEAR(json["clock_hz"].get<double>(), 1000, 1e-3);
  EXPECT_EQ(json["pattern_s"].size(), 2U);
  EXPECT_EQ(json["held"][0]["name"], "force");
  EXPECT_EQ(json_of(SamplingReport().result())["rows"], 0);
}

}  // namespace
}  // namespace haptrace
