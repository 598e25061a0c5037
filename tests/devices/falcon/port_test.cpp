#include "devices/check/usb_devices.h"
#include "devices/falcon/usb_link.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// Provides a root folder with the files of a machine.
class FalconPorts : public testing::Test {
 protected:
  TempFolder root_;

  void put(const std::string& file, const std::string& content) {
    fs::create_directories(fs::path(root_ / file).parent_path());
    (void)root_.write(file, content);
  }
  void plug(const std::string& port, int address, const std::string& serial, const std::string& product = "cb48") {
    const std::string device = "sys/bus/usb/devices/" + port + "/";
    put(device + "idVendor", "0403\n");
    put(device + "idProduct", product + "\n");
    put(device + "busnum", "1\n");
    put(device + "devnum", std::to_string(address) + "\n");
    if (!serial.empty()) put(device + "serial", serial + "\n");
    put(fmt::format("dev/bus/usb/001/{:03}", address), "");
  }
  [[nodiscard]] std::vector<FalconPort> ports() const { return find_falcon_ports(root_.path()); }
  [[nodiscard]] std::string refusal(const std::string& serial, const std::string& port) const {
    return error_of([&] { (void)choose_falcon_port(ports(), serial, port); }, Error::Kind::device);
  }
};

TEST_F(FalconPorts, AreFoundInTheFilesOfTheKernel) {
  EXPECT_THAT(ports(), IsEmpty());
  plug("1-1.2", 5, "FA1B");
  plug("1-3", 6, "", "6001");
  ASSERT_EQ(ports().size(), 1);
  const FalconPort port = ports().front();
  EXPECT_EQ(port.port, "1-1.2");
  EXPECT_EQ(port.serial, "FA1B");
  EXPECT_EQ(port.bus, 1);
  EXPECT_EQ(port.address, 5);
  EXPECT_EQ(port.node, "/dev/bus/usb/001/005");
  EXPECT_EQ(port.driver, "");
  EXPECT_EQ(port.refused, 0);
  fs::create_directories(root_ / "sys/bus/usb/devices/1-1.2/1-1.2:1.0");
  fs::create_symlink("../../../../bus/usb/drivers/ftdi_sio", root_ / "sys/bus/usb/devices/1-1.2/1-1.2:1.0/driver");
  EXPECT_EQ(ports().front().driver, kFtdiDriver);
  EXPECT_NO_THROW(expect_open_falcon_port(ports().front()));
}

TEST_F(FalconPorts, AreChosenBySerialNumberOrPort) {
  EXPECT_THAT(refusal("", ""), AllOf(HasSubstr("no Novint Falcon (USB 0403:cb48)"), HasSubstr("power supply")));
  plug("1-2", 7, "B");
  EXPECT_EQ(choose_falcon_port(ports(), "", "").serial, "B");
  EXPECT_THAT(refusal("A", ""), HasSubstr("with serial=A is plugged in. Use one that is: falcon"));
  plug("1-1", 5, "A");
  EXPECT_EQ(choose_falcon_port(ports(), "A", "").port, "1-1");
  EXPECT_EQ(choose_falcon_port(ports(), "", "1-2").serial, "B");
  EXPECT_THAT(refusal("", ""),
              HasSubstr("2 Novint Falcons are plugged in; select one: falcon:serial=A, falcon:serial=B"));
  EXPECT_THAT(refusal("A", "1-2"), HasSubstr("with serial=A port=1-2"));
}

TEST_F(FalconPorts, AreNamedSoThatEachCanBeSelected) {
  const auto specs = [this] {
    std::vector<std::string> names;
    for (const FoundDevice& found : found_falcons(ports())) names.push_back(found.spec);
    return names;
  };
  plug("1-1", 5, "A");
  EXPECT_THAT(specs(), ElementsAre("falcon"));
  plug("1-2", 6, "");
  plug("1-3", 7, "A");
  plug("1-4", 8, "B");
  EXPECT_THAT(specs(), ElementsAre("falcon:port=1-1", "falcon:port=1-2", "falcon:port=1-3", "falcon:serial=B"));
  for (const FoundDevice& found : found_falcons(ports())) {
    const DeviceSpec spec = DeviceSpec::parse(found.spec);
    const auto option = [&](const char* key) { return spec.options.contains(key) ? spec.options.at(key) : ""; };
    EXPECT_EQ("usb " + choose_falcon_port(ports(), option("serial"), option("port")).port, found.where);
    EXPECT_EQ(found.obstacle, "");
  }
}

TEST_F(FalconPorts, NameTheObstacleAndTheRemedy) {
  plug("1-1", 5, "A");
  fs::remove(root_ / "dev/bus/usb/001/005");
  std::vector<FalconPort> found = ports();
  const auto obstacle = [&] { return found_falcons(found).front(); };
  EXPECT_THAT(obstacle().obstacle, HasSubstr("/dev/bus/usb/001/005 cannot be opened: No such file"));
  EXPECT_THAT(obstacle().remedy, HasSubstr("udevadm trigger"));

  found.front().refused = EACCES;
  EXPECT_THAT(obstacle().obstacle, HasSubstr("cannot be opened by this user"));
  EXPECT_THAT(obstacle().remedy, HasSubstr(known_usb_devices().front().udev_rule()));
  EXPECT_THAT(error_of([&] { (void)open_usb_falcon_link(found.front()); }, Error::Kind::device),
              AllOf(HasSubstr("Novint Falcon at usb 1-1: "), HasSubstr("70-haptrace.rules")));

  found.front().refused = 0;
  found.front().driver = "falcon_hid";
  EXPECT_THAT(obstacle().obstacle, HasSubstr("the kernel's driver falcon_hid uses it"));
  EXPECT_THAT(obstacle().remedy, HasSubstr("echo '1-1:1.0' | sudo tee /sys/bus/usb/drivers/falcon_hid/unbind"));
  found.front().driver = "usbfs";
  EXPECT_EQ(obstacle().obstacle, "") << "whoever has it may let go of it";
}

TEST(FtdiStatus, IsTakenOutOfEveryPacketOfATransfer) {
  for (std::size_t size = 0; size <= 200; ++size) {
    std::vector<std::uint8_t> bytes, payload;
    for (std::size_t i = 0; i < size; ++i) {
      bytes.push_back(static_cast<std::uint8_t>(i % 64 < 2 ? 0xee : i));
      if (i % 64 >= 2) payload.push_back(bytes.back());
    }
    bytes.resize(strip_ftdi_status(bytes, 64));
    ASSERT_EQ(bytes, payload) << size;
  }
}

TEST(FalconBackend, RejectsInvalidOptionsBeforeItOpensADevice) {
  EXPECT_THAT(open_error("falcon:serail=3"), HasSubstr("did you mean 'serial'?"));
  EXPECT_THAT(open_error("falcon:firmware=/nonexistent.bin"), HasSubstr("/nonexistent.bin: there is no such file"));
  EXPECT_THAT(open_error("falcon:calibration=/nonexistent.json"), HasSubstr("/nonexistent.json"));
  const TempFolder folder;
  EXPECT_THAT(open_error("falcon:calibration=" + folder.write("my.json", R"({"max_forse": 3})")),
              HasSubstr("did you mean 'max_force'?"));
  EXPECT_THAT(open_error("falcon:emulated=true,serial=3"), HasSubstr("serial: this option is for a real device"));
  EXPECT_THAT(open_error("falcon:fault=silent"),
              HasSubstr("fault: this option is for an emulated device; add emulated=true"));
  EXPECT_THAT(open_error("falcon:hand=relaxed"),
              HasSubstr("hand: this option is for an emulated device; add emulated=true"));
}

TEST(FalconBackend, OpensAnEmulatedDeviceThatIsReadyOnceItWasHomed) {
  in_real_time();
  const auto device = open_device("falcon:emulated=true,hand=relaxed");
  EXPECT_EQ(device->info().model, "Novint Falcon, emulated");
  DeviceState state = exchange(*device, Vec3::Zero(), 0);
  EXPECT_FALSE(state.ready);
  for (int k = 0; k < 20'000 && !state.ready; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    state = exchange(*device, Vec3(1, 0, 0), 1e-3);
    ASSERT_TRUE(state.ready || state.position == Vec3::Zero());
  }
  ASSERT_TRUE(state.ready);
  // The simulated user who homed it may still be moving back.
  for (int k = 0; k < 500; ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    state = exchange(*device, Vec3::Zero(), 1e-3);
  }
  EXPECT_LT(state.position.norm(), 0.02);
}

}  // namespace
}  // namespace haptrace::test
