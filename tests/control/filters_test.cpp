#include "control/filters.h"

#include <gtest/gtest.h>

namespace haptrace {
namespace {

/// Returns the gain at `hz`, measured from the settled response to a sine.
double gain(Butterworth2 filter, double hz, double rate) {
  double power = 0;
  const int settle = static_cast<int>(rate), total = settle + static_cast<int>(rate);
  for (int i = 0; i < total; ++i) {
    const double y = filter.update(std::sin(2 * std::numbers::pi * hz * i / rate));
    if (i >= settle) power += y * y;
  }
  return std::sqrt(2 * power / (total - settle));
}

/// Returns the theoretical gain: |H| of the bilinear transform is the analogue filter's at the prewarped frequency.
double theory(Butterworth2::Kind kind, double hz, double cutoff, double rate) {
  const double u = std::tan(std::numbers::pi * hz / rate) / std::tan(std::numbers::pi * cutoff / rate);
  return (kind == Butterworth2::Kind::low_pass ? 1 : u * u) / std::sqrt(1 + std::pow(u, 4));
}

TEST(Butterworth2, HasTheGainOfTheory) {
  for (const auto kind : {Butterworth2::Kind::low_pass, Butterworth2::Kind::high_pass})
    for (const double rate : {250.0, 1000.0, 20000.0})
      for (const double cutoff : {5.0, 25.0, 100.0})
        for (const double hz : {3.0, 25.0, 61.0, 100.0})
          EXPECT_NEAR(gain(Butterworth2(kind, cutoff, rate), hz, rate), theory(kind, hz, cutoff, rate), 5e-3)
              << rate << " " << cutoff << " " << hz;
}

TEST(Butterworth2, PassesAndStopsAConstant) {
  Butterworth2 low(Butterworth2::Kind::low_pass, 20, 1000), high(Butterworth2::Kind::high_pass, 20, 1000);
  low.reset(3);
  high.reset(3);
  EXPECT_NEAR(low.update(3), 3, 1e-12);
  EXPECT_NEAR(high.update(3), 0, 1e-12);
}

TEST(Butterworth2, StaysStableWithACutoffBeyondNyquistAndNextToZero) {
  for (const double cutoff : {1e-12, 499.0, 500.0, 1e6}) {
    Butterworth2 filter(Butterworth2::Kind::low_pass, cutoff, 1000);
    for (int i = 0; i < 100000; ++i) ASSERT_LE(std::abs(filter.update(i % 2 ? 1 : -1)), 1.5) << cutoff;
  }
}

TEST(Butterworth2, IgnoresValuesThatAreNotFinite) {
  Butterworth2 filter(Butterworth2::Kind::low_pass, 20, 1000);
  for (int i = 0; i < 100; ++i) filter.update(1);
  const double before = filter.update(1);
  EXPECT_EQ(filter.update(std::nan("")), before);
  EXPECT_EQ(filter.update(HUGE_VAL), before);
  EXPECT_NEAR(filter.update(1), before, 0.01);
}

}  // namespace
}  // namespace haptrace
