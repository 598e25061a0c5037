#include "metrics/smoothness.h"

#include "tests/metrics/support.h"
#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
