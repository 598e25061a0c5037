// holding_host PORT: a program that holds a force until a test kills it.
#include "devices/registry.h"

#include <chrono>
#include <thread>

int main(int count, char** arguments) {
  if (count != 2) return 2;
  const auto device = haptrace::open_device(std::string("haply2diy:homed=true,port=") + arguments[1]);
  haptrace::DeviceState state;
  while (device->exchange({haptrace::Vec3(0, 1, 0), haptrace::Vec3::Zero()}, 1e-3, state) ==
         haptrace::Device::Status::ok)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return 1;
}
