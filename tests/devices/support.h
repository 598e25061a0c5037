// Common parts of the tests of devices.
#pragma once

#include "devices/sim/noise.h"
#include "devices/sim/sim_device.h"
#include "tests/support/errors.h"
#include "tests/support/temp_folder.h"

#include <gtest/gtest.h>
#include <stdexcept>
#include <string>

namespace haptrace::test {

/// Exchanges once and returns the state; throws if the device is lost, so that the test fails at once.
inline DeviceState exchange(Device& device, const Vec3& force, double dt) {
  DeviceState state;
  if (device.exchange({force, Vec3::Zero()}, dt, state) != Device::Status::ok)
    throw std::runtime_error("the device was lost: " + device.lost_reason());
  return state;
}

/// A random force, constant for 20 ms at a time; each axis is at most `largest` [N].
class RandomForce {
 public:
  RandomForce(std::uint64_t seed, double largest) : random_(seed, 7), largest_(largest) {}

  Vec3 operator()(double dt) {
    if ((left_ -= dt) <= 0) {
      left_ = 0.02;
      force_ = (0.5 * largest_ * random_.vector()).cwiseMax(-largest_).cwiseMin(largest_);
    }
    return force_;
  }

 private:
  Gaussian random_;
  double largest_, left_ = 0;
  Vec3 force_ = Vec3::Zero();
};

inline std::string open_error(const std::string& spec, Error::Kind kind = Error::Kind::input) {
  return error_of([&] { (void)open_device(spec); }, kind);
}

}  // namespace haptrace::test
