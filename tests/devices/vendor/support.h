// Common parts of the tests of vendors' devices.
#pragma once

#include "devices/vendor/shared_library.h"
#include "tests/devices/support.h"
#include "tests/devices/vendor/fake_libraries.h"

#include <chrono>
#include <memory>
#include <string>
#include <thread>

namespace haptrace::test {

inline FakeDrd& fake_drd() {
  static const SharedLibrary library("fake", FAKE_DRD, SharedLibrary::Unload::never);
  static FakeDrd* (*const fake)() = library.function("fake_drd");
  return *fake();
}

inline FakeHd& fake_hd() {
  static const SharedLibrary library("fake", FAKE_HD, SharedLibrary::Unload::never);
  static FakeHd* (*const fake)() = library.function("fake_hd");
  return *fake();
}

/// Resets a fake to its initial state. No device may be open.
template <class Fake>
Fake& renew(Fake& fake) {
  std::destroy_at(&fake);
  return *std::construct_at(&fake);
}

/// Exchanges every millisecond with this wrench until `condition` holds, about 3 s at most. If it does not, the test's
/// next expectation fails.
template <class Condition>
DeviceState exchange_until(Device& device, const Wrench& wrench, Condition condition) {
  DeviceState state;
  for (int k = 0; k < 3000; ++k) {
    const Device::Status status = device.exchange(wrench, 1e-3, state);
    if (condition(status, state)) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return state;
}

inline bool is_ready(Device::Status status, const DeviceState& state) {
  return status == Device::Status::ok && state.ready;
}

/// Adds a USB device, plugged in as 1-1, to a root folder.
inline void plug_usb(const TempFolder& root, const std::string& vendor, const std::string& product) {
  namespace fs = std::filesystem;
  const auto put = [&root](const std::string& file, const std::string& text) {
    fs::create_directories(fs::path(root / file).parent_path());
    (void)root.write(file, text + "\n");
  };
  put("sys/bus/usb/devices/1-1/idVendor", vendor);
  put("sys/bus/usb/devices/1-1/idProduct", product);
  put("sys/bus/usb/devices/1-1/busnum", "1");
  put("sys/bus/usb/devices/1-1/devnum", "4");
  put("dev/bus/usb/001/004", "");
  put("sys/bus/usb/devices/1-1/1-1:1.0/tty/ttyACM0/dev", "");
  put("dev/ttyACM0", "");
}

}  // namespace haptrace::test
