#include "devices/serial/serial_port.h"

#include "devices/serial/serial_ports.h"
#include "tests/devices/serial/support.h"
#include "tests/support/real_time.h"

#include <csignal>
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

namespace haptrace::test {
namespace {

using testing::HasSubstr;

/// Answers every byte with its successor.
class Successor final : public EmulatedBoard {
 public:
  void advance(std::int64_t) override {}
  void receive(std::uint8_t byte, std::vector<std::uint8_t>& answer) override {
    answer.push_back(static_cast<std::uint8_t>(byte + 1));
  }
  void power_cycle() override {}
};

class SerialPortTest : public testing::Test {
 protected:
  SerialPortTest() { in_real_time(); }

  EmulatedLine line_{std::make_unique<Successor>()};

  static std::string error_of_opening(const std::string& path, int baud = 115200) {
    return error_of([&] { const SerialPort port(path, baud); }, Error::Kind::device);
  }
};

TEST_F(SerialPortTest, PassesEveryByteUnchanged) {
  SerialPort port(line_.path(), 115200);
  for (int value = 0; value < 256; ++value) {
    const auto byte = static_cast<std::uint8_t>(value);
    ASSERT_TRUE(port.write(std::span(&byte, 1), 1));
    std::uint8_t answer = 0;
    ASSERT_EQ(port.read(std::span(&answer, 1), 1), 1U) << value;
    EXPECT_EQ(answer, static_cast<std::uint8_t>(value + 1));
  }
}

TEST_F(SerialPortTest, WaitsForTheFirstByteAndNoLonger) {
  SerialPort port(line_.path(), 115200);
  std::uint8_t answer = 0;
  EXPECT_EQ(port.read(std::span(&answer, 1), 0.01), 0U);
  EXPECT_EQ(port.read(std::span(&answer, 1), 0), 0U);
}

TEST_F(SerialPortTest, IsOpenedByOneProgramOnly) {
  const SerialPort port(line_.path(), 115200);
  EXPECT_THAT(error_of_opening(line_.path()), HasSubstr(line_.path() + ": in use by another program"));
  EXPECT_THAT(error_of_opening(line_.path()), HasSubstr("fuser"));
}

TEST_F(SerialPortTest, LeavesTheLineAsItWasFound) {
  const auto settings = [this] {
    const int fd = open(line_.path().c_str(), O_RDWR | O_NOCTTY);
    termios found{};
    tcgetattr(fd, &found);
    close(fd);
    return found;
  };
  const termios before = settings();
  {
    const SerialPort port(line_.path(), 9600);
    termios raw{};
    tcgetattr(port.descriptor(), &raw);
    EXPECT_EQ(cfgetospeed(&raw), static_cast<speed_t>(B9600));
    EXPECT_EQ(raw.c_lflag & static_cast<tcflag_t>(ICANON | ECHO | ISIG), 0U);
  }
  const termios after = settings();
  EXPECT_EQ(cfgetospeed(&after), cfgetospeed(&before));
  EXPECT_EQ(after.c_cflag, before.c_cflag);
  EXPECT_EQ(after.c_lflag, before.c_lflag);
}

TEST_F(SerialPortTest, ReportsAnUnpluggedCable) {
  SerialPort port(line_.path(), 115200);
  line_.unplug();
  const std::string error = error_of(
      [&] {
        std::uint8_t byte = 0;
        for (int k = 0; k < 5000; ++k) (void)port.read(std::span(&byte, 1), 0.001);
      },
      Error::Kind::device);
  EXPECT_THAT(error, HasSubstr(line_.path()));
  EXPECT_THAT(error, HasSubstr("cable"));
  const std::uint8_t byte = 1;
  EXPECT_THAT(error_of([&] { (void)port.write(std::span(&byte, 1), 0.01); }, Error::Kind::device), HasSubstr("cable"));
}

TEST_F(SerialPortTest, NamesPathCauseAndRemedy) {
  EXPECT_THAT(error_of_opening("/dev/ttyACM999"),
              testing::AllOf(HasSubstr("/dev/ttyACM999: No such file"), HasSubstr("serial ports on USB"),
                             HasSubstr("Check that the device is plugged in")));
  EXPECT_THAT(error_of_opening("/dev/null"),
              HasSubstr("/dev/null: Inappropriate ioctl for device; it is not a serial"));
  EXPECT_THAT(error_of_opening(line_.path(), 12345), HasSubstr("12345 baud is not a supported speed"));
}

// The machine has an Arduino Due on ttyACM0 and a tty that is not on USB.
TEST(UsbSerialPorts, AreFoundWithTheirIdsAndObstacles) {
  const TempFolder root;
  const auto usb = std::filesystem::path(root / "sys/devices/pci/usb1/1-2");
  std::filesystem::create_directories(usb / "1-2:1.0/tty/ttyACM0");
  std::filesystem::create_directories(root / "sys/class/tty/tty0");
  std::filesystem::create_directory_symlink(usb / "1-2:1.0/tty/ttyACM0", root / "sys/class/tty/ttyACM0");
  std::filesystem::create_directory_symlink(usb / "1-2:1.0", usb / "1-2:1.0/tty/ttyACM0/device");
  const auto write = [&](const char* name, const char* text) { std::ofstream(usb / name) << text << "\n"; };
  write("idVendor", "2341");
  write("idProduct", "003e");
  write("product", "Arduino Due");
  write("serial", "75330303035351");

  const auto any = [](const UsbSerialPort& port) { return port.vendor == "2341"; };
  auto found = found_on_serial_ports("haply2diy", "Haply 2DIY", any, root.path());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].spec, "haply2diy:port=/dev/ttyACM0");
  EXPECT_EQ(found[0].model, "Haply 2DIY (Arduino Due)");
  EXPECT_EQ(found[0].serial, "75330303035351");
  EXPECT_EQ(found[0].where, "usb 1-2");
  EXPECT_THAT(found[0].obstacle, HasSubstr("/dev/ttyACM0: No such file"));
  EXPECT_THAT(found[0].remedy, testing::AllOf(HasSubstr("dialout"), HasSubstr("2341")));

  std::filesystem::create_directories(root / "dev");
  std::ofstream(root / "dev/ttyACM0") << "";
  found = found_on_serial_ports("haply2diy", "Haply 2DIY", any, root.path());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].obstacle + found[0].remedy, "");
  EXPECT_TRUE(found_on_serial_ports(
                  "hapkit", "Hapkit", [](const auto&) { return false; }, root.path())
                  .empty());
  EXPECT_EQ(describe(usb_serial_ports(root.path())), "the serial ports on USB are /dev/ttyACM0 (Arduino Due)");

  const DeviceSpec bare = DeviceSpec::parse("haply2diy"), named = DeviceSpec::parse("haply2diy:port=/dev/ttyS9");
  const DeviceSpec same = DeviceSpec::parse("haply2diy:port=/dev/ttyACM0");
  EXPECT_EQ(chosen_port(bare, found).path, "/dev/ttyACM0");
  EXPECT_EQ(chosen_port(bare, found).serial, "75330303035351");
  EXPECT_EQ(chosen_port(same, found).serial, "75330303035351");
  EXPECT_EQ(chosen_port(named, found).path, "/dev/ttyS9");
  EXPECT_EQ(chosen_port(named, found).serial, "") << "USB does not know this port";
  EXPECT_THAT(error_of([&] { chosen_port(bare, {}); }, Error::Kind::device), HasSubstr("haply2diy:port=/dev/..."));
  EXPECT_THAT(error_of([&] { chosen_port(bare, {found[0], found[0]}); }, Error::Kind::device), HasSubstr("several"));
}

// ---- location of the guardian ----

TEST(GuardianProgram, IsSearchedForBesideTheProgramThenWhereItWasInstalled) {
  const auto places = guardian_places("/opt/haptrace/bin/haptrace");
  ASSERT_EQ(places.size(), 2U);
  EXPECT_THAT(places[0], testing::MatchesRegex("/opt/haptrace/lib.*/haptrace/haptrace-guardian"));
  EXPECT_THAT(places[1], testing::EndsWith("/haptrace/haptrace-guardian"));
}

TEST(GuardianProgram, IsThatOfTheBuildFolderForAProgramOfTheBuildFolderAlone) {
  const std::string self = std::filesystem::read_symlink("/proc/self/exe");
  const auto places = guardian_places(self);
  ASSERT_EQ(places.size(), 3U);
  EXPECT_EQ(places[1], guardian_program());
  EXPECT_TRUE(std::filesystem::exists(places[1]));
  EXPECT_THAT(guardian_places("/elsewhere" + self), testing::Not(testing::Contains(places[1])));
}

// ---- a host that dies ----

class HoldingHost : public testing::Test {
 protected:
  void SetUp() override {
    in_real_time();
    std::string program = HOLDING_HOST, port = bench_.line->path();
    char* const arguments[] = {program.data(), port.data(), nullptr};
    // On a busy machine the board may answer so late that its host considers it lost and ends.
    bool ended = true;
    for (int hosts = 0; ended && hosts < 10; ++hosts) {
      ASSERT_EQ(posix_spawn(&host_, program.c_str(), nullptr, nullptr, arguments, environ), 0);
      ended = false;
      wait_until([&] {
        ended = waitpid(host_, nullptr, WNOHANG) == host_;
        return ended || bench_.board->torque() > 0.01;
      });
    }
    ASSERT_GT(bench_.board->torque(), 0.01);
  }
  void TearDown() override {
    kill(host_, SIGKILL);
    waitpid(host_, nullptr, 0);
  }

  TwoDiyBench bench_;
  pid_t host_ = -1;
};

TEST_F(HoldingHost, LeavesNoTorqueBehindWhenItIsKilled) {
  kill(host_, SIGKILL);
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
  // The port is free for the next host once the guardian has ended.
  bool opened = false;
  for (int k = 0; k < 100 && !opened; ++k) {
    std::this_thread::sleep_for(50ms);
    opened = error_of([&] { (void)bench_.driver(); }, Error::Kind::device) == "no error";
  }
  EXPECT_TRUE(opened);
}

TEST_F(HoldingHost, LeavesNoTorqueBehindWhenItIsStopped) {
  kill(host_, SIGSTOP);
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
}

}  // namespace
}  // namespace haptrace::test
