#include "devices/plugin/plugin_device.h"

#include "tests/devices/support.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string faulty(const std::string& fault, int tick = 0) {
  return fmt::format(R"(plugin:path={},options={{"fault":"{}","tick":{}}})", FAULTY_PLUGIN, fault, tick);
}

std::string refused_plugin(const std::string& spec) {
  return open_error(spec, Error::Kind::device);
}

TEST(PluginDevice, DescribesThePlugin) {
  const auto device = open_device("plugin:path=" MASS_PLUGIN R"(,options={"mass":0.5})");
  EXPECT_EQ(device->info().backend, "plugin");
  EXPECT_EQ(device->info().model, "point mass");
  EXPECT_EQ(device->info().serial, "0.5 kg");
  EXPECT_EQ(device->info().max_force, 20);
  EXPECT_TRUE(device->info().virtual_time);
  EXPECT_FALSE(device->info().takes_torque());
  EXPECT_FALSE(device->info().measures_velocity);
}

TEST(PluginDevice, FollowsItsOptions) {
  const auto device = open_device("plugin:path=" MASS_PLUGIN R"(,options={"mass": 0.5, "viscous": 0})");
  DeviceState state = exchange(*device, Vec3::Zero(), 0);
  for (int k = 0; k < 100; ++k) state = exchange(*device, Vec3(1, 0, -2), 1e-3);
  EXPECT_NEAR(state.position.x(), 0.5 * 1 / 0.5 * 0.01, 1e-12);
  EXPECT_NEAR(state.position.z(), 0.5 * -2 / 0.5 * 0.01, 1e-12);
}

TEST(PluginDevice, ReadsItsOptionsFromAFile) {
  const TempFolder folder;
  const std::string file = folder.write("mass.json", "{ // heavy\n \"mass\": 2 }");
  EXPECT_EQ(open_device("plugin:path=" MASS_PLUGIN ",options=@" + file)->info().serial, "2 kg");
}

TEST(PluginDevice, RefusesOptionsThatAreNotAnObject) {
  const std::string path = "plugin:path=" MASS_PLUGIN ",options=";
  EXPECT_THAT(open_error(path + "{mass:1}"), HasSubstr("options: "));
  EXPECT_THAT(open_error(path + "[1]"), HasSubstr("expected a JSON object"));
  EXPECT_THAT(open_error(path + "@/no/such.json"), HasSubstr("/no/such.json: cannot be read"));
}

TEST(PluginDevice, ShowsTheMessageOfAPluginThatRefuses) {
  EXPECT_THAT(refused_plugin("plugin:path=" MASS_PLUGIN R"(,options={"mass":-1})"),
              HasSubstr("mass must be greater than 0"));
  EXPECT_THAT(refused_plugin(faulty("open")),
              AllOf(HasSubstr(FAULTY_PLUGIN), HasSubstr("the cable is not plugged in")));
  EXPECT_THAT(refused_plugin(faulty("silent")), HasSubstr("refuses to open (-3) and gives no reason"));
}

TEST(PluginDevice, RejectsALibraryThatIsNotAPlugin) {
  const TempFolder folder;
  EXPECT_THAT(open_error("plugin"), HasSubstr("plugin:path=./libmine.so"));
  EXPECT_THAT(refused_plugin("plugin:path=./nowhere.so"), HasSubstr("path: there is no file './nowhere.so'"));
  EXPECT_THAT(refused_plugin("plugin:path=" + folder.write("text.so", "not a library")), HasSubstr("cannot be loaded"));
  EXPECT_THAT(refused_plugin("plugin:path=" WRONG_ABI_PLUGIN), HasSubstr("uses version 2 of the plug-in ABI"));
  EXPECT_THAT(refused_plugin("plugin:path=" MISSING_SYMBOL_PLUGIN),
              HasSubstr("does not export 'haptrace_plugin_exchange'"));
}

TEST(PluginDevice, RejectsAnInvalidDescription) {
  EXPECT_THAT(refused_plugin(faulty("info")), HasSubstr("workspace_min must lie below workspace_max"));
  EXPECT_THAT(refused_plugin(faulty("force")), HasSubstr("max_force must be finite and greater than 0"));
}

TEST(PluginDevice, TerminatesStringsThatThePluginDoesNotTerminate) {
  const auto device = open_device(faulty("names"));
  EXPECT_EQ(device->info().model, std::string(63, 'm'));
  EXPECT_EQ(device->info().serial, std::string(63, 's'));
}

TEST(PluginDevice, KnowsTheQuantitiesThatThePluginMeasures) {
  const auto device = open_device(faulty("measures"));
  EXPECT_TRUE(device->info().measures_velocity);
  EXPECT_TRUE(device->info().measures_orientation);
  EXPECT_TRUE(device->info().measures_force);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 0).orientation.w(), 1);
}

TEST(PluginDevice, StaysLostOnceThePluginIsGone) {
  const auto device = open_device(faulty("lost", 3));
  DeviceState state;
  for (int k = 0; k < 2; ++k) exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("exchange returned -5"));
  EXPECT_THAT(refused_plugin(faulty("lost", 0)), HasSubstr("exchange returned -5"));
}

TEST(PluginDevice, PassesOnTheStatesOfThePlugin) {
  const auto broken = open_device(faulty("nan", 2));
  EXPECT_TRUE(is_finite(exchange(*broken, Vec3::Zero(), 1e-3).position));
  EXPECT_FALSE(is_finite(exchange(*broken, Vec3::Zero(), 1e-3).position));
  const auto jumping = open_device(faulty("jump", 2));
  EXPECT_EQ(exchange(*jumping, Vec3::Zero(), 1e-3).position.x(), 0);
  EXPECT_EQ(exchange(*jumping, Vec3::Zero(), 1e-3).position.x(), 0.03);
  const auto homing = open_device(faulty("not_ready", 2));
  EXPECT_FALSE(exchange(*homing, Vec3::Zero(), 1e-3).ready);
  EXPECT_TRUE(exchange(*homing, Vec3::Zero(), 1e-3).ready);
  const auto backwards = open_device(faulty("backwards"));
  EXPECT_LT(exchange(*backwards, Vec3(1, 0, 0), 1e-3).position.x(), 0);
}

TEST(PluginDevice, PassesOnTheSequenceNumberOfAState) {
  const auto device = open_device(faulty("repeats", 4));
  std::vector<std::uint64_t> numbers;
  for (int k = 0; k < 8; ++k) {
    const DeviceState state = exchange(*device, Vec3(1, 0, 0), 1e-3);
    numbers.push_back(state.sequence);
    EXPECT_NEAR(state.age, 1e-3 * ((k + 1) % 4), 1e-12);
  }
  EXPECT_EQ(numbers, (std::vector<std::uint64_t>{1, 1, 1, 5, 5, 5, 5, 9}));
  const DeviceState silent = exchange(*open_device("plugin:path=" MASS_PLUGIN), Vec3::Zero(), 0);
  EXPECT_EQ(silent.sequence, 0U) << "a plug-in without the function: every exchange is a new sample";
  EXPECT_EQ(silent.age, 0);
}

TEST(PluginDevice, KnowsAPluginThatRunsInRealTime) {
  EXPECT_FALSE(open_device(faulty("clock"))->info().virtual_time);
}

}  // namespace
}  // namespace haptrace::test
