#include "devices/loop/watchdog.h"

#include "tests/support/point_mass.h"

#include <chrono>
#include <gtest/gtest.h>
#include <thread>

namespace haptrace {
namespace {

/// Enters a tick that does not return for a while.
void hang_for(std::chrono::milliseconds time, bool virtual_time) {
  TickPulse pulse;
  test::PointMass device;
  StopRequest stop;
  const Watchdog watchdog({.pulse = pulse, .device = device, .stop = stop, .keep = {}, .virtual_time = virtual_time});
  pulse.at(TickPulse::Place::controller);
  std::this_thread::sleep_for(time);
}

TEST(WatchdogDeath, EndsAProcessWhoseTickHangsInRealTime) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(hang_for(std::chrono::minutes(10), false), testing::ExitedWithCode(1),
              "the controller has not returned for 0.5 s");
}

TEST(Watchdog, WaitsLongerInVirtualTimeWhereNoMotorWaitsForTheTick) {
  hang_for(std::chrono::milliseconds(1500), true);
}

}  // namespace
}  // namespace haptrace
