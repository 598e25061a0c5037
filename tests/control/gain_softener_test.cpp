#include "control/gain_softener.h"

#include "tests/support/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace haptrace {
namespace {

const OscillationVerdict kVerdict{.energy = 0.01, .frequency_hz = 30, .amplitude = 1e-3};

TEST(GainSoftener, LeavesAQuietLoopAlone) {
  GainSoftener softener;
  for (int k = 0; k < 5000; ++k) EXPECT_FALSE(softener.update(std::nullopt, 1e-3));
  EXPECT_EQ(softener.share(), 1);
}

TEST(GainSoftener, HalvesWithinTwentyMillisecondsWithoutAStep) {
  GainSoftener softener;
  const auto event = softener.update(kVerdict, 1e-3);
  ASSERT_TRUE(event);
  EXPECT_EQ(event->code, EventCode::oscillation);
  EXPECT_EQ(event->values, (std::array{1e-3, 30.0, 0.5}));
  EXPECT_EQ(describe(*event), "oscillates at 30 Hz, 1.00 mm: gains softened to 50 %");
  double previous = 1;
  for (int k = 0; k < 20; ++k) {
    EXPECT_LE(previous - softener.share(), 0.0251);
    previous = softener.share();
    EXPECT_FALSE(softener.update(std::nullopt, 1e-3));
  }
  EXPECT_NEAR(softener.share(), 0.5, 1e-12);
  for (int k = 0; k < 100000; ++k) (void)softener.update(std::nullopt, 1e-3);
  EXPECT_NEAR(softener.share(), 0.5, 1e-12) << "what was taken stays taken";
}

TEST(GainSoftener, HalvesAgainOnlyWhenTheMonitorCanHaveSeenTheFirst) {
  GainSoftener softener;
  double t = 0, last = -1;
  double expected = 0.5;
  int stays = 0;
  for (int k = 0; k < 3000; ++k, t += 1e-3) {
    const auto event = softener.update(kVerdict, 1e-3);
    if (!event) continue;
    EXPECT_GE(t - last, 0.2 - 1e-9);
    last = t;
    EXPECT_DOUBLE_EQ(event->values[2], std::max(expected, 0.05));
    expected *= 0.5;
    if (event->code == EventCode::oscillation_stays) ++stays;
  }
  EXPECT_EQ(softener.share(), 0.05);
  EXPECT_EQ(stays, 1) << "told once";
  EXPECT_TRUE(softener.exhausted());
}

TEST(GainSoftener, RecoversSlowlyWhenItIsToldTo) {
  GainSoftener softener({.recover_after = 1, .recover_time = 10});
  (void)softener.update(kVerdict, 1e-3);
  for (int k = 0; k < 1000; ++k) (void)softener.update(std::nullopt, 1e-3);
  EXPECT_NEAR(softener.share(), 0.5, 1e-3);
  for (int k = 0; k < 2500; ++k) (void)softener.update(std::nullopt, 1e-3);
  EXPECT_NEAR(softener.share(), 0.75, 1e-3);
  for (int k = 0; k < 5000; ++k) (void)softener.update(std::nullopt, 1e-3);
  EXPECT_EQ(softener.share(), 1);
  EXPECT_TRUE(softener.update(kVerdict, 1e-3)) << "and takes again";
}

TEST(GainSoftener, NamesTheOptionThatIsWrong) {
  const auto error_of = [](const GainSoftenerOptions& options) { return test::error_of([&] { validate(options); }); };
  EXPECT_EQ(error_of({}), "no error");
  EXPECT_THAT(error_of({.factor = 1}), testing::HasSubstr("the factor is 1"));
  EXPECT_THAT(error_of({.least = 0}), testing::HasSubstr("the least share is 0"));
  EXPECT_THAT(error_of({.ramp = 0.5}), testing::HasSubstr("the wait [s] is 0.2; it must be from 0.5"));
}

}  // namespace
}  // namespace haptrace
