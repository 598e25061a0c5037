#include "control/gain_profile.h"

#include <cmath>
#include <gtest/gtest.h>
#include <limits>

namespace haptrace {
namespace {

GainTable table() {
  return {
      .step = 0.5,
      .gains = {
          {Vec3(100, 200, 0), Vec3(1, 2, 3)}, {Vec3(300, 200, 0), Vec3(3, 2, 1)}, {Vec3(0, 200, 0), Vec3(0, 2, 2)}}};
}

TEST(GainTable, IsLinearBetweenItsStepsAndConstantBeyondThem) {
  const GainTable gains = table();
  EXPECT_EQ(gains.at(-1).kp, Vec3(100, 200, 0));
  EXPECT_EQ(gains.at(kNaN).kp, Vec3(100, 200, 0));
  EXPECT_EQ(gains.at(0.25).kp, Vec3(200, 200, 0));
  EXPECT_EQ(gains.at(0.75).kd, Vec3(1.5, 2, 1.5));
  EXPECT_EQ(gains.at(1).kp, Vec3(0, 200, 0));
  EXPECT_EQ(gains.at(1e9).kp, Vec3(0, 200, 0));
  EXPECT_EQ(gains.at(std::numeric_limits<double>::infinity()).kp, Vec3(0, 200, 0));
  EXPECT_EQ(gains.largest().kp, Vec3(300, 200, 0));
  EXPECT_EQ(gains.largest().kd, Vec3(3, 2, 3));
}

TEST(GainSchedule, ScalesTheGainsOfTheTuningByTheSharesOfTheTable) {
  GainSchedule schedule(table());
  const PdGains tuned{Vec3::Constant(600), Vec3::Constant(6)};
  const PdGains start = schedule.advance(tuned, 0, 0);
  EXPECT_EQ(start.kp, Vec3(200, 600, 600)) << "an axis without a gain keeps that of the tuning";
  EXPECT_EQ(start.kd, Vec3(2, 6, 6));
  PdGains later;
  for (int tick = 0; tick < 1000; ++tick) later = schedule.advance(tuned, 0.5, 1e-3);
  EXPECT_NEAR(later.kp.x(), 600, 1e-3);
  EXPECT_NEAR(later.kd.z(), 2, 1e-3);
}

TEST(GainSchedule, MakesNoStepWhenThePathJumps) {
  GainSchedule schedule(table());
  const PdGains tuned{Vec3::Constant(300), Vec3::Constant(3)};
  double before = schedule.advance(tuned, 0, 0).kp.x();
  for (int tick = 0; tick < 3000; ++tick) {
    const double now = schedule.advance(tuned, tick % 1000 < 500 ? 0.5 : 1.0, 1e-3).kp.x();
    EXPECT_LE(std::abs(now - before), 300 * 0.0199);
    before = now;
  }
  EXPECT_EQ(schedule.advance(tuned, 0.5, 0).kp.x(), before) << "no time, no change";
  schedule.reset(0.5);
  EXPECT_EQ(schedule.advance(tuned, 0.5, 0).kp.x(), 300);
}

}  // namespace
}  // namespace haptrace
