// Common parts of the tests of a Falcon on the emulated USB bus.
#pragma once

#include "tests/devices/falcon/usb_bus.h"

#include <string_view>

namespace haptrace::test {

using Start = EmulatedFalcon::Start;

inline UsbBus& bus() {
  return UsbBus::instance();
}

inline void plug_in(Start start, const char* faults = nullptr, const std::string& plant = "hand=relaxed,seed=3",
                    const std::string& serial = "F1") {
  bus().plug_in(std::make_unique<EmulatedFalcon>(
                    FalconCalibration(), open_live_plant(DeviceSpec::parse("falcon:" + plant), "falcon"), start,
                    faults != nullptr ? FalconFaults::parse(faults, "test") : FalconFaults()),
                serial);
}

inline void set_faults(const char* faults) {
  bus().falcon([&](EmulatedFalcon& falcon) { falcon.set_faults(FalconFaults::parse(faults, "test")); });
}

inline std::array<std::int16_t, 3> motors() {
  return bus().falcon([](const EmulatedFalcon& falcon) { return falcon.motors(); });
}

inline bool pushes() {
  return motors() != std::array<std::int16_t, 3>{};
}

/// With this argument, the test program acts as a host that holds a force until its device is lost or it is killed.
inline constexpr std::string_view kHoldForce = "--hold-force";

int hold_force();

}  // namespace haptrace::test
