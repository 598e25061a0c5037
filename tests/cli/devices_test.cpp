#include "devices/check/connected_devices.h"
#include "devices/check/usb_devices.h"
#include "tests/cli/command.h"

#include <csignal>
#include <filesystem>

namespace haptrace {

void PrintTo(const FoundDevice& found, std::ostream* out) {
  *out << found.spec << " " << found.model << " " << found.where << ": " << found.obstacle;
}

bool operator==(const FoundDevice& a, const FoundDevice& b) {
  return a.spec == b.spec && a.model == b.model && a.serial == b.serial && a.where == b.where &&
         a.obstacle == b.obstacle && a.remedy == b.remedy;
}

namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

const FoundDevice kArm{"arm", "An Arm", "7", "ws://localhost:1", "", ""};
const FoundDevice kTeensy{"teensy", "A Teensy", "", "usb 1-2", "", ""};

std::vector<FoundDevice> find_arm() {
  return {kArm};
}
std::vector<FoundDevice> find_teensy() {
  return {kTeensy};
}

DeviceBackend backend(const char* name, std::vector<FoundDevice> (*find)()) {
  return {.name = name, .summary = "", .options = {}, .presets = {}, .open = nullptr, .find = find};
}

/// A machine with one USB device: a WoodenHaptics, or a board with the same ids.
class Machine {
 public:
  Machine() {
    put("idVendor", "16c0\n");
    put("idProduct", "0486\n");
    put("serial", "1234\n");
  }
  [[nodiscard]] const std::string& root() const { return folder_.path(); }

 private:
  void put(const std::string& file, const std::string& content) {
    const std::string device = "sys/bus/usb/devices/1-2/";
    std::filesystem::create_directories(folder_ / device);
    (void)folder_.write(device + file, content);
  }
  TempFolder folder_;
};

TEST(ConnectedDevices, IncludeTheDevicesOfEveryFinder) {
  const TempFolder nothing_plugged;
  EXPECT_THAT(connected_devices({backend("sim", nullptr), backend("arm", find_arm), backend("teensy", find_teensy)},
                                nothing_plugged.path()),
              ElementsAre(kArm, kTeensy));
  EXPECT_THAT(connected_devices({backend("sim", nullptr)}, nothing_plugged.path()), IsEmpty());
}

TEST(ConnectedDevices, IncludeKnownDevicesWithoutADriverAndSuggestAPlugIn) {
  const Machine machine;
  const auto connected = connected_devices({backend("arm", find_arm)}, machine.root());
  ASSERT_EQ(connected.size(), 2U);
  EXPECT_EQ(connected[0], kArm);
  EXPECT_THAT(connected[1].model, HasSubstr("WoodenHaptics"));
  EXPECT_EQ(connected[1].spec, "");
  EXPECT_EQ(connected[1].serial, "1234");
  EXPECT_EQ(connected[1].where, "usb 1-2");
  EXPECT_THAT(connected[1].obstacle, HasSubstr("no driver"));
  EXPECT_THAT(connected[1].remedy, AllOf(HasSubstr("devices/plugin.h"), HasSubstr("plugin:path=")));

  EXPECT_THAT(connected_devices({backend("teensy", find_teensy)}, machine.root()), ElementsAre(kTeensy))
      << "a device of a finder is not listed twice";
}

TEST(PluggedUsbDevices, SayWhyTheyCannotBeOpened) {
  const Machine machine;
  const auto plugged = plugged_usb_devices(machine.root());
  ASSERT_EQ(plugged.size(), 1U);
  EXPECT_EQ(plugged[0].ids, "16c0:0486");
  EXPECT_THAT(plugged[0].obstacle, HasSubstr("no driver has created a device file"));
  EXPECT_THAT(plugged[0].remedy, HasSubstr("udevadm trigger"));
}

std::vector<std::pair<std::string, std::string>> changes(const std::vector<FoundDevice>& before,
                                                         const std::vector<FoundDevice>& after) {
  std::vector<std::pair<std::string, std::string>> told;
  for (const DeviceChange& change : device_changes(before, after))
    told.emplace_back(to_string(change.kind), change.device.model);
  return told;
}

TEST(DeviceChanges, ListFoundGoneAndChangedDevices) {
  FoundDevice blocked = kArm;
  blocked.obstacle = "not calibrated";
  EXPECT_THAT(changes({}, {kArm, kTeensy}), ElementsAre(Pair("found", "An Arm"), Pair("found", "A Teensy")));
  EXPECT_THAT(changes({kArm, kTeensy}, {kTeensy, kArm}), IsEmpty());
  EXPECT_THAT(changes({kArm}, {blocked, kTeensy}), ElementsAre(Pair("changed", "An Arm"), Pair("found", "A Teensy")));
  EXPECT_THAT(changes({kTeensy, blocked}, {kArm}), ElementsAre(Pair("gone", "A Teensy"), Pair("changed", "An Arm")));
  FoundDevice elsewhere = kTeensy;
  elsewhere.where = "usb 1-3";
  EXPECT_THAT(changes({kTeensy}, {elsewhere}), ElementsAre(Pair("gone", "A Teensy"), Pair("found", "A Teensy")));
}

TEST(TheDevicesVerb, ListsConnectedDevicesAndBackends) {
  const Answer text = haptrace("devices");
  EXPECT_EQ(text.exit_code, 0);
  EXPECT_THAT(text.out, AllOf(testing::StartsWith("connected:"), HasSubstr("\nsim "), HasSubstr("\ninverse3 ")));
  const nlohmann::json json = haptrace("devices", "--json").json();
  EXPECT_TRUE(json["connected"].is_array());
  EXPECT_EQ(json["devices"][0]["name"], "sim");
}

TEST(TheDevicesVerb, WatchesUntilCtrlC) {
  Command watching({"devices", "--watch", "--json"});
  ASSERT_TRUE(watching.says("Ctrl+C"));
  kill(watching.pid(), SIGINT);
  const Answer answer = watching.wait();
  EXPECT_EQ(answer.exit_code, 0);
  // A line for each device of this machine, if it has any.
  std::istringstream lines(answer.out);
  for (std::string line; std::getline(lines, line);)
    EXPECT_EQ(nlohmann::json::parse(line).value("change", ""), "found") << line;
  EXPECT_EQ(haptrace("devices", "sim", "--watch").exit_code, 2);
}

}  // namespace
}  // namespace haptrace
