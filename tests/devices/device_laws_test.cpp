// What every device keeps, whatever it is. A device joins by being listed.
#include "devices/plugin_device.h"
#include "devices/recovering_device.h"
#include "devices/replay_device.h"
#include "devices/sim/presets.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <cstring>
#include <functional>
#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

struct Listed {
  std::string name;
  std::function<std::unique_ptr<Device>()> open;
  bool obeys_force = true;  ///< moves when pushed
  bool rests = true;        ///< nothing pulls at it when no force is sent
};

void PrintTo(const Listed& device, std::ostream* out) {
  *out << device.name;
}

std::unique_ptr<Device> open_replay() {
  ReplayDevice::Rows recording;
  for (int k = 0; k < 3000; ++k) {
    recording.time_ns.push_back(1'000'000LL * k);
    recording.position.emplace_back(0.05 * std::cos(0.002 * k), 0.05 * std::sin(0.002 * k), 0);
  }
  return std::make_unique<ReplayDevice>(DeviceInfo{.max_force = 5}, recording);
}

std::unique_ptr<Device> open_spec(const char* json) {
  return std::make_unique<SimDevice>(read_sim_spec(nlohmann::json::parse(json), "test"));
}

std::vector<Listed> listed() {
  std::vector<Listed> devices;
  for (const std::string& preset : device_preset_names()) {
    const bool rests = preset != "reference";
    devices.push_back({"sim_" + preset, [preset] { return open_device("sim:preset=" + preset); }, true, rests});
    devices.push_back(
        {"held_" + preset, [preset] { return open_device("sim:hand=firm,seed=3,preset=" + preset); }, true, false});
  }
  const auto spec = [&devices](const char* name, const char* json, bool rests = true) {
    devices.push_back({name, [json] { return open_spec(json); }, true, rests});
  };
  spec("spec_minimal", R"({"mass": 1, "max_force": 10})");
  spec("spec_rigid_friction", R"({"mass": 0.3, "max_force": 10, "coulomb": 1, "force_resolution": 0.1})");
  spec("spec_structure", R"({"mass": 0.3, "max_force": 10, "coulomb": 0.5, "backlash": 1e-4,
                             "structural_mode": {"frequency_hz": 40}, "hand": "tense"})",
       false);
  spec("spec_sensor", R"({"mass": 0.3, "max_force": 10, "force_sensor": true, "hand": "pinch",
                          "noise": {"position": 1e-5, "force": 0.01}})",
       false);
  devices.push_back({"plugin_mass", [] { return open_device("plugin:path=" MASS_PLUGIN); }});
  devices.push_back({"replay", open_replay, false, false});
  devices.push_back(
      {"recovering",
       [] { return std::make_unique<RecoveringDevice>([] { return open_device("plugin:path=" MASS_PLUGIN); }); }});
  return devices;
}

class DeviceLaws : public testing::TestWithParam<Listed> {
 protected:
  std::unique_ptr<Device> device_ = GetParam().open();
};

TEST_P(DeviceLaws, DescribesItselfCoherently) {
  const DeviceInfo& info = device_->info();
  EXPECT_FALSE(info.backend.empty());
  EXPECT_FALSE(info.model.empty() && info.backend != "replay");
  EXPECT_TRUE(is_finite(info.workspace_min) && is_finite(info.workspace_max));
  EXPECT_TRUE((info.workspace_min.array() < info.workspace_max.array()).all());
  EXPECT_GE(info.position_resolution, 0);
  EXPECT_GT(info.max_force, 0);
  EXPECT_LE(info.max_continuous_force, info.max_force);
  EXPECT_GT(info.nominal_rate, 0);
  EXPECT_TRUE(info.virtual_time);
  EXPECT_TRUE(info.force_axes[0] || info.force_axes[1] || info.force_axes[2]);
}

TEST_P(DeviceLaws, MeasuresWhatItSaysItMeasures) {
  exchange(*device_, Vec3::Zero(), 0);
  const DeviceState state = exchange(*device_, Vec3::Zero(), 1e-3);
  EXPECT_EQ(is_finite(state.force), device_->info().measures_force);
  EXPECT_EQ(is_finite(state.velocity), device_->info().measures_velocity);
  EXPECT_EQ(state.orientation.coeffs().allFinite(), device_->info().measures_orientation);
  EXPECT_TRUE(state.ready);
}

TEST_P(DeviceLaws, StandsStillWhileTimeDoes) {
  // Two devices, since a measurement may be noisy: a force without time changes nothing that comes after.
  const auto twin = GetParam().open();
  exchange(*device_, Vec3::Zero(), 0);
  exchange(*twin, Vec3::Zero(), 0);
  exchange(*device_, Vec3(3, -2, 1), 0);
  exchange(*twin, Vec3::Zero(), 0);
  for (int k = 0; k < 50; ++k)
    EXPECT_EQ(exchange(*device_, Vec3::Zero(), 1e-3).position, exchange(*twin, Vec3::Zero(), 1e-3).position);
}

TEST_P(DeviceLaws, DoesNotGoBackInTime) {
  const auto twin = GetParam().open();
  for (int k = 0; k < 50; ++k) {
    exchange(*device_, Vec3(1, 1, 1), k % 2 == 0 ? -1.0 : 0.0);
    exchange(*twin, Vec3(1, 1, 1), 0);
    EXPECT_EQ(exchange(*device_, Vec3(1, 1, 1), 1e-3).position, exchange(*twin, Vec3(1, 1, 1), 1e-3).position);
  }
}

TEST_P(DeviceLaws, StaysFiniteUnderRandomForces) {
  RandomForce force(11, device_->info().max_force);
  exchange(*device_, Vec3::Zero(), 0);
  double largest = 0;
  for (int k = 0; k < 2000; ++k) {
    const double dt = 1e-3 * (1 + 0.5 * std::sin(k));
    const DeviceState state = exchange(*device_, force(dt), dt);
    ASSERT_TRUE(is_finite(state.position)) << "tick " << k;
    largest = std::max(largest, state.position.norm());
  }
  EXPECT_LT(largest, 20);
}

TEST_P(DeviceLaws, MovesAlongTheForce) {
  if (!GetParam().obeys_force) return;
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

TEST_P(DeviceLaws, RestsWhenNothingPulls) {
  if (!GetParam().rests) return;
  const Vec3 start = exchange(*device_, Vec3::Zero(), 0).position;
  for (int k = 0; k < 200; ++k) EXPECT_EQ(exchange(*device_, Vec3::Zero(), 1e-3).position, start);
}

TEST_P(DeviceLaws, TakesAForceThatIsNotANumberForNone) {
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

TEST_P(DeviceLaws, RunsTwiceTheSame) {
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

TEST_P(DeviceLaws, IsLostAfterClose) {
  DeviceState state;
  exchange(*device_, Vec3::Zero(), 0);
  device_->close();
  EXPECT_EQ(device_->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device_->lost_reason(), testing::HasSubstr("closed"));
  device_->close();
  EXPECT_EQ(device_->exchange({}, 1e-3, state), Device::Status::lost);
}

INSTANTIATE_TEST_SUITE_P(All, DeviceLaws, testing::ValuesIn(listed()), [](const auto& device) {
  std::string name = device.param.name;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
});

}  // namespace
}  // namespace haptrace::test
