// Tests of the Novint Falcon through an unmodified libusb, with an emulated chip.
#include "control/velocity_estimator.h"
#include "devices/falcon/firmware.h"
#include "devices/falcon/usb_link.h"
#include "devices/loop/recovering_device.h"
#include "devices/loop/servo_loop.h"
#include "tests/devices/device_laws.h"
#include "tests/devices/falcon/usb_support.h"
#include "tests/devices/guardian_laws.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <filesystem>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <malloc.h>
#include <thread>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using namespace std::chrono_literals;

/// Exchanges at 1 kHz until `condition` holds, for at most 10 s; returns whether it does.
template <class Condition>
bool exchange_until(Device& device, const Vec3& force, DeviceState& state, Condition condition) {
  for (int k = 0; k < 10'000; ++k) {
    if (device.exchange({force, Vec3::Zero()}, 1e-3, state) != Device::Status::ok) return false;
    if (condition()) return true;
    std::this_thread::sleep_for(1ms);
  }
  return false;
}

class FalconUsb : public testing::Test {
 protected:
  FalconUsb() { in_real_time(); }

  TempFolder folder_;

  /// Opens a device whose options name a firmware file of the right size.
  std::unique_ptr<Device> open_with_firmware() {
    std::string image(FalconFirmware::kLeast, '\0');
    for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<char>(7 * i);
    return open_device("falcon:firmware=" + folder_.write("firmware.bin", image));
  }
};

TEST_F(FalconUsb, IsFoundWhereItIsPluggedIn) {
  plug_in(Start::homed);
  const auto& backends = device_backends();
  const auto backend = std::find_if(backends.begin(), backends.end(), [](const auto& b) { return b.name == "falcon"; });
  ASSERT_NE(backend, backends.end());
  const auto found = backend->find();
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(found[0].serial, "F1");
  EXPECT_EQ(found[0].where, "usb 1-1");
  EXPECT_EQ(found[0].obstacle, "");
  EXPECT_EQ(open_device(found[0].spec)->info().serial, "F1");

  bus().unplug();
  EXPECT_TRUE(backend->find().empty());
  EXPECT_THAT(open_error("falcon", Error::Kind::device), HasSubstr("no Novint Falcon"));
}

TEST_F(FalconUsb, IsLoadedHomedAndThenPushes) {
  plug_in(Start::switched_on);
  EXPECT_THAT(open_error("falcon", Error::Kind::device), HasSubstr("firmware=FILE"));
  const auto device = open_with_firmware();
  EXPECT_TRUE(bus().falcon([](const EmulatedFalcon& falcon) { return falcon.runs(); }));
  EXPECT_THAT(device->info().notes, ElementsAre(HasSubstr("not homed")));

  DeviceState state;
  bool pushed_unhomed = false;
  EXPECT_TRUE(exchange_until(*device, Vec3(2, 0, 0), state, [&] {
    if (!state.ready) pushed_unhomed = pushed_unhomed || pushes();
    return state.ready;
  }));
  EXPECT_FALSE(pushed_unhomed);
  EXPECT_TRUE(exchange_until(*device, Vec3(2, 0, 0), state, pushes));
  device->close();
  EXPECT_FALSE(pushes());

  const auto again = open_device("falcon");
  EXPECT_TRUE(exchange_until(*again, Vec3::Zero(), state, [&] { return state.ready; }));
  EXPECT_EQ(bus().falcon([](const EmulatedFalcon& falcon) { return falcon.loadings(); }), 1) << "once is enough";
}

TEST_F(FalconUsb, IsLoadedHoweverOftenItTakes) {
  plug_in(Start::switched_on, "bad_start:2+bad_echo:1");
  const auto device = open_with_firmware();
  EXPECT_EQ(bus().falcon([](const EmulatedFalcon& falcon) { return falcon.loadings(); }), 3);
}

TEST_F(FalconUsb, ReportsItsPositionToACountAndPushesInTheCommandedDirection) {
  const FalconCalibration calibration;
  const FalconKinematics kinematics;
  // A heavy handle in a steady hand.
  const std::string plant = folder_.write("calm.json", R"({
      "mass": 20, "max_force": 20, "workspace": {"min": -0.05, "max": 0.05},
      "hand": {"mass": 1, "grip_stiffness": 2000, "grip_damping": 50, "intent_stiffness": 2000, "intent_damping": 100}})");
  SplitMix64 random(2, 2);
  double worst_angle = 0, worst_count = 0, worst_force = 0;
  for (int k = 0; k < 10; ++k) {
    const Vec3 place = 0.035 * Vec3(random.symmetric(), random.symmetric(), random.symmetric());
    const std::string path = folder_.write(
        "place.csv", fmt::format("t,x,y,z\n0,{0},{1},{2}\n60,{0},{1},{2}\n", place.x(), place.y(), place.z()));
    plug_in(Start::homed, nullptr, fmt::format("spec={},intent={}", plant, path));
    const auto device = open_device("falcon");
    DeviceState state;
    ASSERT_TRUE(exchange_until(*device, Vec3::Zero(), state, [&] { return state.ready; }));
    const auto truth = kinematics.at_position(
        calibration.origin + bus().falcon([](const EmulatedFalcon& falcon) { return falcon.position(); }));
    const auto told = kinematics.at_position(calibration.origin + state.position);
    ASSERT_TRUE(truth && told);
    const Vec3 counts = (told->angles - truth->angles).cwiseProduct(calibration.counts_per_rad);
    worst_count = std::max(worst_count, counts.cwiseAbs().maxCoeff());

    const Vec3 asked = 4 * Vec3(random.symmetric(), random.symmetric(), random.symmetric()).normalized();
    ASSERT_TRUE(exchange_until(*device, asked, state, pushes));
    const Vec3 force = bus().falcon([](const EmulatedFalcon& falcon) { return falcon.force(); });
    const double angle = std::atan2(force.cross(asked).norm(), force.dot(asked)) * 180 / std::numbers::pi;
    worst_angle = std::max(worst_angle, angle);
    worst_force = std::max(worst_force, std::abs(force.norm() / asked.norm() - 1));
  }
  EXPECT_LE(worst_count, 0.51);
  EXPECT_LE(worst_angle, 0.1);
  EXPECT_LE(worst_force, 0.002);
  RecordProperty("worst_count", fmt::format("{:.3f}", worst_count));
  RecordProperty("worst_angle_deg", fmt::format("{:.4f}", worst_angle));
}

TEST_F(FalconUsb, BelongsToOneProgramAtATime) {
  plug_in(Start::homed);
  const auto device = open_device("falcon");
  EXPECT_THAT(open_error("falcon", Error::Kind::device), HasSubstr("another program uses it"));
  DeviceState state;
  EXPECT_TRUE(exchange_until(*device, Vec3::Zero(), state, [&] { return state.ready; }));
}

TEST_F(FalconUsb, IsFreeOfForceWhenExchangesStop) {
  plug_in(Start::homed);
  const auto device = open_device("falcon");
  DeviceState state;
  EXPECT_TRUE(exchange_until(*device, Vec3(0, 3, 0), state, pushes));
  for (int k = 0; k < 1000 && pushes(); ++k) std::this_thread::sleep_for(1ms);
  EXPECT_FALSE(pushes());
}

/// Pushes to and fro with 6 N, which moves a hand; calls `happening` after 0.2 s.
class Shaking final : public Controller {
 public:
  explicit Shaking(std::function<void()> happening, std::uint64_t ticks = 1200)
      : happening_(std::move(happening)), ticks_(ticks) {}

  void resume(const State& first) noexcept override { resumed_ = first.tick; }

  [[nodiscard]] Command update(const State& state) noexcept override {
    Command command;
    command.phase = Phase::run;
    command.wrench.force.x() = state.tick / 50 % 2 == 0 ? 6 : -6;
    if (state.tick >= 200 && happening_) {
      std::exchange(happening_, nullptr)();
      happened_ = true;
    }
    if (resumed_ > 0 && state.tick > resumed_ + 100) pushed_after_ = pushed_after_ || pushes();
    if (state.tick >= ticks_ + resumed_) command.status = Command::Status::finished;
    return command;
  }

  [[nodiscard]] bool happened() const { return happened_; }
  [[nodiscard]] bool pushed_after() const { return pushed_after_; }

 private:
  std::function<void()> happening_;
  std::uint64_t ticks_, resumed_ = 0;
  bool happened_ = false, pushed_after_ = false;
};

ServoReport run_session(Device& device, Controller& controller, double away_timeout = 0) {
  ServoOptions options{.realtime = false, .away_timeout = away_timeout};
  options.limits.soft_start = 0.02;
  options.limits.release = 0.02;
  const auto estimator = make_velocity_estimator("lowpass", 1000, 0);
  return ServoLoop(device, controller, *estimator, {}, options).run(StopRequest());
}

struct UsbFault {
  const char* text;
  StopCause cause;
  const char* told;  ///< part of the report's detail
};

TEST_F(FalconUsb, HasNoForceInItsMotorsAfterAnyFault) {
  const UsbFault faults[] = {
      {"stall:0", StopCause::finished, ""},
      {"silent:0", StopCause::device_lost, "did not answer"},
      {"frozen:0", StopCause::device_lost, "encoder"},
      {"power:0", StopCause::device_lost, "power"},
      {"lost:0.01", StopCause::finished, ""},
      {"garbage:0.01", StopCause::finished, ""},
      {"flipped:0.001", StopCause::finished, ""},
      {"slow_chip", StopCause::finished, ""},
  };
  for (const UsbFault& fault : faults) {
    SCOPED_TRACE(fault.text);
    plug_in(Start::homed);
    const auto device = open_device("falcon");
    bool pushed = false;
    Shaking controller([&] {
      pushed = pushes();
      set_faults(fault.text);
    });
    const ServoReport report = run_session(*device, controller);
    EXPECT_TRUE(pushed);
    EXPECT_EQ(report.cause, fault.cause) << report.detail;
    EXPECT_THAT(report.detail, HasSubstr(fault.told));
    device->close();
    EXPECT_FALSE(pushes());
  }
}

TEST_F(FalconUsb, EndsWhenItsChipHangs) {
  // No zero force can reach the motors then. It is not known whether the firmware switches them off by itself.
  plug_in(Start::homed);
  const auto device = open_device("falcon");
  Shaking controller([] { set_faults("hang:0"); });
  const ServoReport report = run_session(*device, controller);
  EXPECT_EQ(report.cause, StopCause::device_lost);
  EXPECT_THAT(report.detail, HasSubstr("did not answer"));
}

TEST_F(FalconUsb, IsLostWithItsCable) {
  plug_in(Start::homed);
  const auto device = open_device("falcon");
  Shaking controller([] { bus().unplug(); });
  const ServoReport report = run_session(*device, controller);
  EXPECT_EQ(report.cause, StopCause::device_lost);
  EXPECT_THAT(report.detail, AllOf(HasSubstr("unplugged"), HasSubstr("plug it in again")));
  EXPECT_FALSE(pushes());
}

TEST_F(FalconUsb, ContinuesWhenItsCableIsPluggedInAgain) {
  plug_in(Start::homed);
  RecoveringDevice device([] { return open_device("falcon"); });
  std::thread somebody;
  Shaking controller(
      [&] {
        somebody = std::thread([] {
          bus().unplug();
          std::this_thread::sleep_for(300ms);
          bus().plug_in_again();
        });
      },
      500);
  const ServoReport report = run_session(device, controller, 20);
  somebody.join();
  EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
  EXPECT_EQ(report.returns, 1);
  EXPECT_GE(report.away, 0.2);
  EXPECT_TRUE(controller.pushed_after());
  device.close();
  EXPECT_FALSE(pushes());
}

TEST_F(FalconUsb, DoesNotContinueWithAnotherDevice) {
  plug_in(Start::homed);
  RecoveringDevice device([] { return open_device("falcon"); });
  std::thread somebody;
  Shaking controller([&] { somebody = std::thread([] { plug_in(Start::homed, nullptr, "hand=relaxed", "F2"); }); });
  const ServoReport report = run_session(device, controller, 20);
  somebody.join();
  EXPECT_EQ(report.cause, StopCause::device_lost);
  // The emulated bus may show the device before its serial number is readable. It counts as another device then, too.
  EXPECT_THAT(report.detail, AllOf(HasSubstr("another device answers in its place"), HasSubstr("serial number F1")));
  EXPECT_FALSE(pushes());
}

TEST_F(FalconUsb, IsEmulatedWithoutUsbAsWell) {
  bus().unplug();
  RecoveringDevice device([] { return open_device("falcon:emulated=true,hand=relaxed,seed=3,fault=unplug:2:0.2"); });
  DeviceState state;
  EXPECT_TRUE(exchange_until(device, Vec3::Zero(), state, [&] { return state.ready; })) << "its user homes it";
  Shaking controller(nullptr, 3000);
  const ServoReport report = run_session(device, controller, 20);
  EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
  EXPECT_EQ(report.returns, 1);
}

/// Resources of this process: open files, threads and allocated memory.
struct Belongings {
  std::size_t files = 0, threads = 0, bytes = 0;

  static Belongings now() {
    const auto entries = [](const char* folder) {
      return static_cast<std::size_t>(
          std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator()));
    };
    return {entries("/proc/self/fd"), entries("/proc/self/task"), mallinfo2().uordblks};
  }
};

TEST_F(FalconUsb, KeepsNothingWhenItIsClosed) {
  plug_in(Start::homed);
  const auto cycle = [] {
    const auto link = open_usb_falcon_link(choose_falcon_port(find_falcon_ports(), "", ""));
    link->control(FalconLink::Request::purge, 1);
  };
  for (int k = 0; k < 20; ++k) cycle();
  const Belongings before = Belongings::now();
  for (int k = 0; k < 1000; ++k) cycle();
  // The emulated bus closes its end in its own thread.
  Belongings after = Belongings::now();
  for (int k = 0; k < 2000 && (after.threads > before.threads || after.files > before.files); ++k) {
    std::this_thread::sleep_for(1ms);
    after = Belongings::now();
  }
  EXPECT_EQ(after.files, before.files);
  EXPECT_EQ(after.threads, before.threads);
  EXPECT_LT(after.bytes, before.bytes + 50'000) << "which is 50 bytes for each cycle";
  EXPECT_EQ(bus().open_handles(), 0);
}

}  // namespace

std::vector<Listed> listed_devices() {
  return {{"falcon_usb",
           [] {
             plug_in(Start::homed, nullptr, "seed=1");
             return open_device("falcon");
           },
           true, true, false}};
}

namespace {

class UsbBench final : public GuardedBench {
 public:
  GuardedPort port() override { return *link_->guarded_port(); }
  std::vector<std::uint8_t> heard() override { return bus().heard_from_guardians(); }

 private:
  static std::unique_ptr<FalconLink> open() {
    plug_in(Start::homed);
    return open_usb_falcon_link(choose_falcon_port(find_falcon_ports(), "", ""));
  }

  std::unique_ptr<FalconLink> link_ = open();
};

}  // namespace

std::vector<ListedPort> listed_ports() {
  return {{"usb", [] { return std::make_unique<UsbBench>(); }}};
}

}  // namespace haptrace::test

int main(int argc, char** argv) {
  if (argc > 1 && argv[1] == haptrace::test::kHoldForce) return haptrace::test::hold_force();
  return haptrace::test::run_tests(argc, argv, [](const std::function<int()>& run) {
    const haptrace::test::UsbBus bus;
    return run();
  });
}
