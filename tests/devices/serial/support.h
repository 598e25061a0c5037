// Common parts of the tests of serial devices.
#pragma once

#include "devices/device_spec.h"
#include "devices/hapkit/emulated_hapkit.h"
#include "devices/hapkit/hapkit.h"
#include "devices/haply/emulated_two_diy.h"
#include "devices/haply/two_diy.h"
#include "tests/devices/support.h"

#include <filesystem>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {

using namespace std::chrono_literals;

/// Waits about 5 s at most until `condition` holds; if it does not, the test's next expectation fails.
template <class Condition>
void wait_until(const Condition& condition) {
  for (int k = 0; k < 5000 && !condition(); ++k) std::this_thread::sleep_for(1ms);
}

inline LivePlant plant_of(const char* preset) {
  return open_live_plant(DeviceSpec::parse("emulated"), preset);
}

/// An emulated board on its own line; the test has access to both.
struct TwoDiyBench {
  explicit TwoDiyBench(const TwoDiyCalibration& calibration = {two_diy_calibration("gen3", "test")},
                       bool velocities = false)
      : truth(calibration) {
    auto made = std::make_unique<EmulatedTwoDiy>(plant_of("haply2diy"), truth, velocities);
    board = made.get();
    line = std::make_unique<EmulatedLine>(std::move(made));
  }
  /// Opens a driver. With `homed`, the arms are in their stops while it opens.
  [[nodiscard]] std::unique_ptr<TwoDiyDriver> driver(bool homed = true) const {
    return std::make_unique<TwoDiyDriver>(
        truth, TwoDiyOptions{.name = "bench", .port = line->path(), .serial = "", .homed = homed});
  }

  TwoDiyCalibration truth;
  EmulatedTwoDiy* board = nullptr;
  std::unique_ptr<EmulatedLine> line;
};

struct HapkitBench {
  HapkitBench() {
    auto made = std::make_unique<EmulatedHapkit>(plant_of("hapkit"), truth);
    board = made.get();
    line = std::make_unique<EmulatedLine>(std::move(made));
  }
  [[nodiscard]] std::unique_ptr<HapkitDriver> driver() const {
    return std::make_unique<HapkitDriver>(truth, HapkitOptions{.name = "bench", .port = line->path(), .serial = ""});
  }

  HapkitCalibration truth;
  EmulatedHapkit* board = nullptr;
  std::unique_ptr<EmulatedLine> line;
};

/// Exchanges until a round is answered, at most 200 times; returns the number of rounds without an answer.
inline int answered(DeviceDriver& driver, const Vec3& force, DeviceState& state) {
  int failed = 0;
  while (!driver.round({force, Vec3::Zero()}, state) && failed < 200) ++failed;
  EXPECT_LT(failed, 200) << "no answer";
  return failed;
}

inline std::size_t open_files() {
  return static_cast<std::size_t>(
      std::distance(std::filesystem::directory_iterator("/proc/self/fd"), std::filesystem::directory_iterator()));
}

}  // namespace haptrace::test
