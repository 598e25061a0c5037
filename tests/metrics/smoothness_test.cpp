#include "metrics/smoothness.h"

#include "tests/metrics/support.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>

namespace haptrace {
namespace {

using test::error_of;

/// Returns the example of SPARC's reference implementation: a Gaussian from -1 s to 1 s, without the end.
std::vector<double> gaussian(double rate_hz) {
  std::vector<double> speed;
  for (int i = 0; i < std::lround(2 * rate_hz); ++i) {
    const double t = i / rate_hz - 1;
    speed.push_back(std::exp(-5 * t * t));
  }
  return speed;
}

std::vector<double> min_jerk(double duration, double rate_hz, double amplitude = 1) {
  std::vector<double> speed;
  const auto steps = std::lround(duration * rate_hz);
  for (int i = 0; i <= steps; ++i)
    speed.push_back(amplitude / duration * MinJerk::at(static_cast<double>(i) / static_cast<double>(steps)).ds);
  return speed;
}

TEST(Smoothness, IsTheSameForEveryAmplitude) {
  const auto one = min_jerk(1, 1000);
  for (const double amplitude : {1e-160, 1e-6, 0.3, 1e6, 1e160}) {
    const auto speed = min_jerk(1, 1000, amplitude);
    EXPECT_NEAR(*sparc(speed, 1000), *sparc(one, 1000), 1e-12) << amplitude;
    EXPECT_NEAR(*log_dimensionless_jerk(speed, 1000), *log_dimensionless_jerk(one, 1000), 1e-9) << amplitude;
  }
}

TEST(Smoothness, IsTheSameForEveryDurationAndRate) {
  for (const double duration : {0.5, 1.0, 2.0, 4.0}) {
    const auto speed = min_jerk(duration, 1000);
    EXPECT_NEAR(*sparc(speed, 1000), -1.4024, 2e-3) << duration;
    EXPECT_NEAR(*log_dimensionless_jerk(speed, 1000), -5.320, 3e-3) << duration;
  }
  for (const double rate : {250.0, 700.0, 1000.0, 4000.0}) {
    const auto speed = min_jerk(1, rate);
    EXPECT_NEAR(*sparc(speed, rate), -1.4024, 6e-3) << rate;
    EXPECT_NEAR(*log_dimensionless_jerk(speed, rate), -5.322, 0.01) << rate;
  }
}

TEST(Smoothness, IsTheSameBackwards) {
  auto speed = min_jerk(1, 1000);
  for (std::size_t i = 0; i < speed.size(); ++i) speed[i] *= 1 + 0.3 * std::sin(0.02 * static_cast<double>(i));
  const std::vector<double> backwards(speed.rbegin(), speed.rend());
  EXPECT_NEAR(*sparc(speed, 1000), *sparc(backwards, 1000), 1e-9);
  EXPECT_NEAR(*log_dimensionless_jerk(speed, 1000), *log_dimensionless_jerk(backwards, 1000), 1e-9);
}

TEST(Smoothness, FallsWithEveryFurtherStroke) {
  double smoothest_sparc = 0, smoothest_jerk = 0;
  for (const int strokes : {1, 2, 3, 5, 8}) {
    std::vector<double> speed;
    for (int k = 0; k < strokes; ++k) {
      const auto one = min_jerk(2.0 / strokes, 1000);
      speed.insert(speed.end(), one.begin(), one.end());
    }
    const double arc = *sparc(speed, 1000), jerk = *log_dimensionless_jerk(speed, 1000);
    EXPECT_LT(arc, smoothest_sparc - 0.1) << strokes;
    EXPECT_LT(jerk, smoothest_jerk - 0.1) << strokes;
    smoothest_sparc = arc;
    smoothest_jerk = jerk;
  }
}

// The values at 100 Hz are from the authors' own code, those at 1 kHz from an independent program.
TEST(Smoothness, HasTheReferenceValues) {
  EXPECT_NEAR(*sparc(gaussian(100), 100), -1.41403, 5e-6);
  EXPECT_NEAR(*dimensionless_jerk(gaussian(100), 100), -335.74684, 5e-6);
  EXPECT_NEAR(*log_dimensionless_jerk(gaussian(100), 100), -5.81636, 5e-6);

  EXPECT_NEAR(*sparc(gaussian(1000), 1000), -1.413980, 5e-7);
  EXPECT_NEAR(*dimensionless_jerk(gaussian(1000), 1000), -335.944487, 5e-7);
  EXPECT_NEAR(*log_dimensionless_jerk(gaussian(1000), 1000), -5.816946, 5e-7);

  EXPECT_NEAR(*sparc(min_jerk(1, 1000), 1000), -1.402426, 5e-7);
  EXPECT_NEAR(*dimensionless_jerk(min_jerk(1, 1000), 1000), -204.3900, 5e-5);
  EXPECT_NEAR(*log_dimensionless_jerk(min_jerk(1, 1000), 1000), -5.320030, 5e-7);

  EXPECT_NEAR(*sparc(min_jerk(1, 100), 100), -1.405829, 5e-7);
  EXPECT_NEAR(*dimensionless_jerk(min_jerk(1, 100), 100), -200.6643, 5e-5);
  EXPECT_NEAR(*log_dimensionless_jerk(min_jerk(1, 100), 100), -5.301633, 5e-7);
}

TEST(Smoothness, TendsToTheClosedFormOfTheMinimumJerkMovement) {
  EXPECT_NEAR(*dimensionless_jerk(min_jerk(1, 1e5), 1e5), -720 / (1.875 * 1.875), 5e-3);
  EXPECT_NEAR(*log_dimensionless_jerk(min_jerk(1, 1e5), 1e5), -5.322034, 3e-5);
}

TEST(Smoothness, ConvertsToTheOtherNormalisationsOfAMinimumJerkMovement) {
  const double jerk = -*dimensionless_jerk(min_jerk(1, 1e5), 1e5), peak = 1.875;  // of amplitude and duration 1
  const double by_amplitude = jerk * peak * peak;                                 // T^5 / A^2 instead of T^3 / v_peak^2
  EXPECT_NEAR(jerk, 204.8, 0.01);
  EXPECT_NEAR(std::log(jerk), 5.322034, 5e-5);
  EXPECT_NEAR(by_amplitude, 720, 0.05);
  EXPECT_NEAR(std::log(by_amplitude), 6.579251, 5e-5);
  EXPECT_NEAR(by_amplitude / 2, 360, 0.03);
  EXPECT_NEAR(std::log(by_amplitude / 2), 5.886104, 5e-5);
  EXPECT_NEAR(std::sqrt(by_amplitude / 2), 18.97367, 1e-3);
  EXPECT_NEAR(0.5 * std::log(by_amplitude / 2), 2.943052, 5e-5);
}

TEST(Smoothness, HasTwoFormsOfTheLogJerkThatDifferWhereThePathTurns) {
  const int steps = 20'000;
  std::vector<Vec3> straight, lap, even;
  std::vector<double> speed;
  for (int i = 0; i <= steps; ++i) {
    const MinJerk at = MinJerk::at(static_cast<double>(i) / steps);
    const double turned = 2 * std::numbers::pi * at.s, turning = 2 * std::numbers::pi * i / steps;
    speed.push_back(at.ds);
    straight.push_back(at.ds * Vec3(0.6, 0, 0.8));
    lap.push_back(at.ds * Vec3(-std::sin(turned), std::cos(turned), 0));
    even.emplace_back(-std::sin(turning), std::cos(turning), 0);
  }
  EXPECT_NEAR(*log_dimensionless_jerk(speed, steps), -5.32203, 2e-4);
  EXPECT_NEAR(*log_dimensionless_jerk(std::span<const Vec3>(straight), steps), -5.32203, 2e-4);
  EXPECT_NEAR(*log_dimensionless_jerk(std::span<const Vec3>(lap), steps), -8.98897, 5e-4);
  // At constant speed the speed form has no jerk, and the vector form has (2 pi)^4.
  EXPECT_FALSE(log_dimensionless_jerk(std::vector<double>(1001, 0.5), 1000));
  EXPECT_NEAR(*log_dimensionless_jerk(std::span<const Vec3>(even), steps), -4 * std::log(2 * std::numbers::pi), 1e-3);
}

TEST(Smoothness, HasTheValuesOfTwoMovementsInARow) {
  const auto two = [](std::size_t apart, std::size_t size) {
    std::vector<double> speed(size, 0);
    const std::vector<double> one = min_jerk(0.5, 1000);
    for (const std::size_t begin : {std::size_t{0}, apart})
      for (std::size_t i = 0; i < one.size(); ++i) speed[begin + i] += one[i];
    return speed;
  };
  const auto expect = [](const std::vector<double>& speed, double arc, double jerk) {
    EXPECT_NEAR(*sparc(speed, 1000), arc, 1e-6) << speed.size();
    EXPECT_NEAR(*log_dimensionless_jerk(speed, 1000), jerk, 1e-6) << speed.size();
  };
  expect(two(500, 1001), -2.246183, -8.092609);
  expect(two(700, 1201), -2.994294, -8.636578);
  expect(two(250, 751), -1.620618, -6.411275);
}

TEST(Smoothness, OfTheJerkDependsOnTheRuleOfOnsetAndEndAndSparcDoesNot) {
  const std::vector<double> whole = min_jerk(1, 1000);
  std::vector<double> rested(1000, 0), cropped;
  rested.insert(rested.end(), whole.begin(), whole.end());
  rested.insert(rested.end(), 1000, 0);
  const double slow = 0.05 * *std::max_element(whole.begin(), whole.end());
  for (const double v : whole)
    if (v >= slow) cropped.push_back(v);
  EXPECT_EQ(cropped.size(), 881U);
  EXPECT_NEAR(*sparc(rested, 1000), -1.40676, 1e-5);
  EXPECT_NEAR(*log_dimensionless_jerk(rested, 1000), -8.616, 1e-3);
  EXPECT_NEAR(*sparc(cropped, 1000), -1.402422, 1e-6);
  EXPECT_NEAR(*log_dimensionless_jerk(cropped, 1000), -4.39985, 1e-4);
}

TEST(Smoothness, SparcUsesItsPadLevelCutOffAndThreshold) {
  const auto speed = gaussian(100);
  // A finer spectrum changes the arc little; a spectrum that ends earlier has a shorter or equal arc.
  EXPECT_NEAR(*sparc(speed, 100, {.pad_level = 6}), *sparc(speed, 100), 5e-3);
  EXPECT_NE(*sparc(speed, 100, {.pad_level = 0}), *sparc(speed, 100));
  EXPECT_NE(*sparc(speed, 100, {.cutoff_hz = 1}), *sparc(speed, 100));
  EXPECT_NE(*sparc(speed, 100, {.threshold = 0.2}), *sparc(speed, 100));
  // Above half the rate the spectrum is only the mirror image.
  EXPECT_EQ(*sparc(speed, 100, {.cutoff_hz = 50, .threshold = 0}),
            *sparc(speed, 100, {.cutoff_hz = 5000, .threshold = 0}));
}

TEST(Smoothness, AcceptsAnyNumberOfSamples) {
  const auto whole = min_jerk(1, 1000);
  for (const std::size_t size : {3U, 5U, 511U, 512U, 513U, 997U}) {
    std::vector<double> speed;
    for (std::size_t i = 0; i < size; ++i)
      speed.push_back(MinJerk::at(static_cast<double>(i) / static_cast<double>(size - 1)).ds + 0.01);
    EXPECT_TRUE(sparc(speed, static_cast<double>(size))) << size;
    EXPECT_TRUE(log_dimensionless_jerk(speed, static_cast<double>(size))) << size;
  }
  // Zeros after a movement change only the number of lines in its padded spectrum.
  auto longer = whole;
  longer.resize(4096, 0);
  EXPECT_NEAR(*sparc(longer, 1000, {.pad_level = 2}), *sparc(whole, 1000, {.pad_level = 4}), 1e-10);
}

TEST(Smoothness, IsUndefinedWithoutMovementOrFiniteSamples) {
  const std::vector<double> rest(100, 0.0), two{0, 1}, one{1}, none;
  for (const auto& speed : {rest, two, one, none}) {
    EXPECT_FALSE(sparc(speed, 1000));
    EXPECT_FALSE(dimensionless_jerk(speed, 1000));
    EXPECT_FALSE(log_dimensionless_jerk(speed, 1000));
  }
  for (const double bad : {kNaN, std::numeric_limits<double>::infinity()}) {
    auto speed = min_jerk(1, 1000);
    speed[500] = bad;
    EXPECT_FALSE(sparc(speed, 1000));
    EXPECT_FALSE(dimensionless_jerk(speed, 1000));
  }
  const std::vector<double> steady(100, 0.2);
  EXPECT_EQ(*dimensionless_jerk(steady, 1000), 0);
  EXPECT_FALSE(log_dimensionless_jerk(steady, 1000));
}

TEST(Smoothness, RejectsInvalidSpeedsAndRates) {
  auto speed = min_jerk(1, 1000);
  speed[41] = -0.1;
  EXPECT_THAT(error_of([&] { return sparc(speed, 1000); }), testing::HasSubstr("sample 42"));
  EXPECT_THAT(error_of([&] { return dimensionless_jerk(speed, 1000); }), testing::HasSubstr("component"));
  EXPECT_THAT(error_of([] { return sparc(min_jerk(1, 100), 0); }), testing::HasSubstr("rate"));
  EXPECT_THAT(error_of([] { return sparc(min_jerk(1, 100), 100, {.pad_level = 40}); }),
              testing::HasSubstr("pad level"));
}

TEST(Smoothness, TakesAMillionSamples) {
  const auto speed = min_jerk(1000, 1000);
  EXPECT_NEAR(*log_dimensionless_jerk(speed, 1000), -5.322, 1e-3);
  EXPECT_NEAR(*sparc(speed, 1000), -1.402, 0.014);  // 1 %
}

}  // namespace
}  // namespace haptrace
