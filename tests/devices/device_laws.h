// Laws that every device obeys. A test program links device_laws.cpp and lists its devices.
#pragma once

#include "devices/device.h"

#include <functional>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

namespace haptrace::test {

struct Listed {
  std::string name;
  std::function<std::unique_ptr<Device>()> open;
  bool obeys_force = true;  ///< a force moves it
  bool rests = true;        ///< without force it stays at rest
  bool virtual_time = true;
  double reach = 1.2;  ///< maximum distance under random forces, as a multiple of the workspace's farthest corner
};

void PrintTo(const Listed& device, std::ostream* out);

/// Returns the devices to test; the test program defines it.
std::vector<Listed> listed_devices();

}  // namespace haptrace::test
