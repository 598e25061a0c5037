// What every device keeps, whatever it is. A test program that is built with device_laws.cpp lists its devices.
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
  bool obeys_force = true;  ///< moves when pushed
  bool rests = true;        ///< nothing pulls at it when no force is sent
  bool virtual_time = true;
  double reach = 1.2;  ///< how far random forces move it at most, as a multiple of the workspace's farthest corner
};

void PrintTo(const Listed& device, std::ostream* out);

/// To be defined by the test program.
std::vector<Listed> listed_devices();

}  // namespace haptrace::test
