#include "tests/devices/device_laws.h"

#include "tests/devices/conformance.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"
#include "tests/support/real_time.h"

#include <cstring>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {
namespace {

class DeviceLaws : public testing::TestWithParam<Listed> {
 protected:
  DeviceLaws() {
    if (!GetParam().virtual_time) in_real_time();
    device_ = GetParam().open();
  }

  std::unique_ptr<Device> device_;

  /// Exchanges once; in real time it then sleeps for `dt`.
  static DeviceState step(Device& device, const Vec3& force, double dt) {
    const DeviceState state = exchange(device, force, dt);
    if (!device.info().virtual_time) std::this_thread::sleep_for(std::chrono::duration<double>(dt));
    return state;
  }

  /// Returns the position at rest without force, or the position after 0.5 s.
  static Vec3 settled(Device& device) {
    constexpr int kStill = 10, kMost = 500;
    Vec3 last = step(device, Vec3::Zero(), 1e-3).position;
    for (int k = 0, still = 0; k < kMost && still < kStill; ++k) {
      const Vec3 position = step(device, Vec3::Zero(), 1e-3).position;
      still = (position - last).norm() <= 2 * device.info().position_resolution ? still + 1 : 0;
      last = position;
    }
    return last;
  }
};

// Laws that hold for some devices only.
class VirtualDeviceLaws : public DeviceLaws {};
class RealTimeDeviceLaws : public DeviceLaws {};
class VirtualForceLaws : public DeviceLaws {};
class RealTimeForceLaws : public DeviceLaws {};
class RestLaws : public DeviceLaws {};

TEST_P(DeviceLaws, DescribesItselfCoherently) {
  const DeviceInfo& info = device_->info();
  EXPECT_EQ(info.virtual_time, GetParam().virtual_time) << "else it is listed for the wrong laws";
  EXPECT_FALSE(info.backend.empty());
  EXPECT_FALSE(info.model.empty() && info.backend != "replay");
  EXPECT_TRUE(is_finite(info.workspace_min) && is_finite(info.workspace_max));
  EXPECT_TRUE((info.workspace_min.array() < info.workspace_max.array()).all());
  EXPECT_GE(info.position_resolution, 0);
  EXPECT_GT(info.max_force, 0);
  EXPECT_LE(info.max_continuous_force, info.max_force);
  EXPECT_GT(info.nominal_rate, 0);
  EXPECT_TRUE(info.force_axes[0] || info.force_axes[1] || info.force_axes[2]);
}

TEST_P(DeviceLaws, MeasuresTheQuantitiesThatItStates) {
  step(*device_, Vec3::Zero(), 0);
  const DeviceState state = step(*device_, Vec3::Zero(), 1e-3);
  EXPECT_EQ(is_finite(state.force), device_->info().measures_force);
  EXPECT_EQ(is_finite(state.velocity), device_->info().measures_velocity);
  EXPECT_EQ(state.orientation.coeffs().allFinite(), device_->info().measures_orientation);
  EXPECT_TRUE(state.ready);
}

TEST_P(VirtualDeviceLaws, StandsStillWhileTimeStandsStill) {
  // A force without time must not change later states. This needs two devices, since measurements may be noisy.
  const auto twin = GetParam().open();
  exchange(*device_, Vec3::Zero(), 0);
  exchange(*twin, Vec3::Zero(), 0);
  exchange(*device_, Vec3(3, -2, 1), 0);
  exchange(*twin, Vec3::Zero(), 0);
  for (int k = 0; k < 50; ++k)
    EXPECT_EQ(exchange(*device_, Vec3::Zero(), 1e-3).position, exchange(*twin, Vec3::Zero(), 1e-3).position);
}

TEST_P(VirtualDeviceLaws, DoesNotGoBackInTime) {
  const auto twin = GetParam().open();
  for (int k = 0; k < 50; ++k) {
    exchange(*device_, Vec3(1, 1, 1), k % 2 == 0 ? -1.0 : 0.0);
    exchange(*twin, Vec3(1, 1, 1), 0);
    EXPECT_EQ(exchange(*device_, Vec3(1, 1, 1), 1e-3).position, exchange(*twin, Vec3(1, 1, 1), 1e-3).position);
  }
}

TEST_P(DeviceLaws, StaysWithinItsReachUnderRandomForces) {
  RandomForce force(11, device_->info().max_force);
  step(*device_, Vec3::Zero(), 0);
  double largest = 0;
  const int ticks = GetParam().virtual_time ? 2000 : 500;
  for (int k = 0; k < ticks; ++k) {
    const double dt = 1e-3 * (1 + 0.5 * std::sin(k));
    const DeviceState state = step(*device_, force(dt), dt);
    ASSERT_TRUE(is_finite(state.position)) << "tick " << k;
    largest = std::max(largest, state.position.norm());
  }
  const DeviceInfo& info = device_->info();
  const double corner = info.workspace_min.cwiseAbs().cwiseMax(info.workspace_max.cwiseAbs()).norm();
  EXPECT_LT(largest, GetParam().reach * corner);
}

TEST_P(VirtualForceLaws, MovesAlongTheForce) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      const auto pushed = GetParam().open(), left = GetParam().open();
      const Vec3 force = sign * 0.6 * device_->info().max_force * Vec3::Unit(axis);
      Vec3 moved = Vec3::Zero();
      for (int k = 0; k < 30; ++k)
        moved = exchange(*pushed, force, 1e-3).position - exchange(*left, Vec3::Zero(), 1e-3).position;
      if (device_->info().force_axes[static_cast<std::size_t>(axis)])
        EXPECT_GT(sign * moved[axis], 1e-4) << "axis " << axis;
      else
        EXPECT_EQ(moved.norm(), 0) << "axis " << axis;
    }
  }
}

TEST_P(RealTimeForceLaws, MovesAlongTheForce) {
  const DeviceInfo info = device_->info();
  for (int axis = 0; axis < 3; ++axis) {
    if (!info.force_axes[static_cast<std::size_t>(axis)]) continue;
    // Start from rest and push until it moves: on a busy machine, a step may take any time.
    for (const double sign : {-1.0, 1.0}) {
      device_.reset();
      device_ = GetParam().open();
      const Vec3 start = settled(*device_), force = sign * 0.6 * info.max_force * Vec3::Unit(axis);
      Vec3 moved = Vec3::Zero();
      for (int k = 0; k < 500 && moved.norm() < 1e-3; ++k) moved = step(*device_, force, 1e-3).position - start;
      EXPECT_GT(sign * moved[axis], 1e-4) << "axis " << axis;
      EXPECT_GT(sign * moved[axis], 0.7 * moved.norm()) << "axis " << axis << ": " << moved.transpose();
    }
  }
}

TEST_P(RestLaws, RestsWithoutForces) {
  const Vec3 start = step(*device_, Vec3::Zero(), 0).position;
  for (int k = 0; k < 200; ++k) EXPECT_EQ(step(*device_, Vec3::Zero(), 1e-3).position, start);
}

TEST_P(RealTimeDeviceLaws, AnswersWithRecentStates) {
  // Other tests on the machine delay some states; a driver that does not keep up delays most.
  std::vector<double> ages;
  for (int k = 0; k < 500; ++k) {
    DeviceState state;
    ASSERT_EQ(device_->exchange({}, 1e-3, state), Device::Status::ok) << device_->lost_reason();
    ages.push_back(state.age);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::nth_element(ages.begin(), ages.begin() + 250, ages.end());
  EXPECT_GE(ages.front(), 0);
  EXPECT_LT(ages[250], 0.01);
}

TEST_P(VirtualDeviceLaws, TreatsAForceThatIsNotFiniteAsZero) {
  const auto twin = GetParam().open();
  const double infinity = std::numeric_limits<double>::infinity();
  const Vec3 bad[] = {nan3(), Vec3(infinity, 0, 0), Vec3(0, -infinity, kNaN)};
  for (int k = 0; k < 60; ++k) {
    const Vec3 force = k % 2 == 0 ? Vec3(0.5, 0.5, 0.5) : Vec3::Zero();
    const DeviceState state = exchange(*device_, k % 2 == 0 ? force : bad[k / 2 % 3], 1e-3);
    ASSERT_TRUE(is_finite(state.position));
    EXPECT_EQ(state.position, exchange(*twin, force, 1e-3).position);
  }
}

TEST_P(VirtualDeviceLaws, RunsIdenticallyTwice) {
  const auto twin = GetParam().open();
  RandomForce force(5, device_->info().max_force), same(5, device_->info().max_force);
  for (int k = 0; k < 1000; ++k) {
    const double dt = k % 7 == 0 ? 1.3e-3 : 1e-3;
    const DeviceState a = exchange(*device_, force(dt), dt), b = exchange(*twin, same(dt), dt);
    ASSERT_EQ(std::memcmp(a.position.data(), b.position.data(), sizeof(Vec3)), 0) << "tick " << k;
    ASSERT_EQ(std::memcmp(a.force.data(), b.force.data(), sizeof(Vec3)), 0) << "tick " << k;
  }
}

TEST_P(DeviceLaws, AllocatesNothingInExchange) {
  Device& device = *device_;
  DeviceState state;
  const std::size_t before = allocations();
  bool ok = true;
  for (int k = 0; k < 100; ++k) {
    const double dt = k == 0 ? 0 : k % 10 == 0 ? 0.02 : 1e-3;
    ok = device.exchange({Vec3(1, k, kNaN), Vec3::Zero()}, dt, state) == Device::Status::ok && ok;
  }
  EXPECT_EQ(allocations(), before);
  EXPECT_TRUE(ok);
}

TEST_P(DeviceLaws, ConfirmsThatItsForceIsZeroAfterTheLastExchangeAndAfterItsClose) {
  step(*device_, Vec3::Zero(), 0);
  for (int k = 0; k < 20; ++k) step(*device_, Vec3(0.3, 0.2, 0.1), 1e-3);
  step(*device_, Vec3::Zero(), 1e-3);
  EXPECT_EQ(device_->zero_force(), ZeroForce::confirmed);
  device_->close();
  EXPECT_EQ(device_->zero_force(), ZeroForce::confirmed);
}

TEST_P(DeviceLaws, IsLostAfterClose) {
  DeviceState state;
  exchange(*device_, Vec3::Zero(), 0);
  device_->close();
  EXPECT_EQ(device_->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device_->lost_reason(), testing::HasSubstr("closed"));
  device_->close();
  EXPECT_EQ(device_->exchange({}, 1e-3, state), Device::Status::lost);
}

TEST_P(DeviceLaws, PassesTheConformanceTest) {
  ConformanceOptions options = hasty_options();
  // No hand is in danger here, and a larger force overcomes friction.
  options.max_force = std::min(0.6 * device_->info().max_force, 3.0);
  ConsentingUser user;
  // In real time, the tests above check the directions of the other axes.
  if (!GetParam().virtual_time) user.refused = {"force along y", "force along z"};
  device_->close();
  const ConformanceReport report = test_conformance(GetParam().open, options, user, StopRequest());
  EXPECT_TRUE(report.kept()) << describe(report);
}

std::string name_of_device(const testing::TestParamInfo<Listed>& device) {
  std::string name = device.param.name;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
}

template <class Applies>
auto devices_that(Applies applies) {
  std::vector<Listed> devices = listed_devices();
  devices.erase(std::remove_if(devices.begin(), devices.end(), [&](const Listed& d) { return !applies(d); }),
                devices.end());
  return testing::ValuesIn(devices);
}

INSTANTIATE_TEST_SUITE_P(All, DeviceLaws, testing::ValuesIn(listed_devices()), name_of_device);
INSTANTIATE_TEST_SUITE_P(All, VirtualDeviceLaws, devices_that([](const Listed& d) { return d.virtual_time; }),
                         name_of_device);
INSTANTIATE_TEST_SUITE_P(All, RealTimeDeviceLaws, devices_that([](const Listed& d) { return !d.virtual_time; }),
                         name_of_device);
INSTANTIATE_TEST_SUITE_P(All, VirtualForceLaws,
                         devices_that([](const Listed& d) { return d.virtual_time && d.obeys_force; }), name_of_device);
INSTANTIATE_TEST_SUITE_P(All, RealTimeForceLaws,
                         devices_that([](const Listed& d) { return !d.virtual_time && d.obeys_force; }),
                         name_of_device);
INSTANTIATE_TEST_SUITE_P(All, RestLaws, devices_that([](const Listed& d) { return d.rests; }), name_of_device);

// A test program may list only one kind of device.
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(VirtualDeviceLaws);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RealTimeDeviceLaws);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(VirtualForceLaws);
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RealTimeForceLaws);

}  // namespace

void PrintTo(const Listed& device, std::ostream* out) {
  *out << device.name;
}

}  // namespace haptrace::test
