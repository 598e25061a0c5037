#include "devices/loop/recovering_device.h"

#include "base/error.h"
#include "control/velocity_estimator.h"
#include "devices/loop/servo_loop.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"

#include <cstring>
#include <future>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// A cable between a device and the tests, and the properties of the device at its end.
struct Cable {
  std::atomic<bool> out{false};
  std::atomic<int> openings{0};
  std::atomic<int> open{0};         ///< number of devices not yet closed
  std::string serial = "7";         ///< serial number of the device
  double natural_duration = 0;      ///< [s]
  bool ready = true;                ///< whether opened devices are ready
  std::vector<Vec3> first_forces;   ///< first force sent to each opened device [N]
  std::vector<double> first_steps;  ///< dt of those exchanges [s]
};

/// Returns the number of its opening as its position, until the cable is out.
class Plugged final : public Device {
 public:
  explicit Plugged(Cable& cable) : cable_(cable) {
    if (cable.out) throw device_error("nothing is plugged in");
    info_.backend = "test";
    info_.model = "plugged";
    info_.serial = cable.serial;
    info_.natural_duration = cable.natural_duration;
    number_ = ++cable.openings;
    ++cable.open;
    cable.first_forces.reserve(100);
    cable.first_steps.reserve(100);
  }
  ~Plugged() override { close(); }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    if (closed_ || (lost_ = lost_ || cable_.out)) return Status::lost;
    if (!exchanged_) {
      cable_.first_forces.push_back(wrench.force);
      cable_.first_steps.push_back(dt);
    }
    exchanged_ = true;
    state = {};
    state.position.x() = number_;
    state.ready = cable_.ready;
    return Status::ok;
  }
  void close() noexcept override {
    if (!closed_) --cable_.open;
    closed_ = true;
  }
  [[nodiscard]] std::string lost_reason() const override { return "the cable is out"; }

 private:
  Cable& cable_;
  DeviceInfo info_;
  int number_ = 0;
  bool lost_ = false, closed_ = false, exchanged_ = false;
};

RecoveringDevice plugged(Cable& cable) {
  return RecoveringDevice([&cable] { return std::make_unique<Plugged>(cable); });
}

/// Runs one tick of a session in virtual time, with a force.
Device::Status tick(Device& device, DeviceState& state, bool may_wait = true) {
  const Device::Status status = device.exchange({Vec3(1, 2, 3), Vec3::Zero()}, 1e-3, state);
  device.between_ticks(may_wait);
  return status;
}

TEST(RecoveringDevice, IsTheDeviceBitForBitWhileNothingIsLost) {
  const char* spec = "sim:preset=falcon,hand=firm,seed=5";
  RecoveringDevice wrapped([spec] { return open_device(spec); });
  const auto bare = open_device(spec);
  EXPECT_EQ(wrapped.info().name, bare->info().name);
  EXPECT_EQ(wrapped.info().serial, bare->info().serial);
  RandomForce force(2, 8), same(2, 8);
  DeviceState a, b;
  for (int k = 0; k < 2000; ++k) {
    ASSERT_EQ(wrapped.exchange({force(1e-3), Vec3::Zero()}, k == 0 ? 0 : 1e-3, a), Device::Status::ok);
    ASSERT_EQ(bare->exchange({same(1e-3), Vec3::Zero()}, k == 0 ? 0 : 1e-3, b), Device::Status::ok);
    wrapped.between_ticks(true);
    bare->between_ticks(true);
    ASSERT_EQ(std::memcmp(a.position.data(), b.position.data(), sizeof(Vec3)), 0) << "tick " << k;
  }
}

TEST(RecoveringDevice, IsAwayUntilTheSameDeviceIsBack) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  EXPECT_EQ(tick(device, state), Device::Status::ok);
  cable.out = true;
  for (int k = 0; k < 500; ++k) ASSERT_EQ(tick(device, state), Device::Status::away);
  EXPECT_EQ(cable.open, 0) << "the dead device is closed";
  EXPECT_THAT(device.lost_reason(), AllOf(HasSubstr("the cable is out"), HasSubstr("nothing is plugged in")));
  cable.out = false;
  int away = 0;
  while (tick(device, state) == Device::Status::away) ASSERT_LE(++away, 1e3 * RecoveringDevice::kRetry + 1);
  EXPECT_EQ(state.position.x(), 2) << "opened for the second time";
  EXPECT_EQ(tick(device, state), Device::Status::ok);
}

TEST(RecoveringDevice, SendsZeroForceAndNoTimeFirstToADeviceThatIsFound) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  for (int loss = 0; loss < 5; ++loss) {
    for (int k = 0; k < 10; ++k) ASSERT_EQ(tick(device, state), Device::Status::ok);
    cable.out = true;
    ASSERT_EQ(tick(device, state), Device::Status::away);
    cable.out = false;
    for (int k = 0; k < 200; ++k) (void)tick(device, state);
  }
  ASSERT_EQ(cable.first_forces.size(), 6U);
  EXPECT_EQ(cable.first_forces[0], Vec3(1, 2, 3)) << "the first is the session's own";
  for (std::size_t i = 1; i < 6; ++i) {
    EXPECT_EQ(cable.first_forces[i], Vec3::Zero());
    EXPECT_EQ(cable.first_steps[i], 0);
  }
}

TEST(RecoveringDevice, RejectsAnotherDeviceInItsPlaceAndDoesNotOpenItAgain) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  cable.out = true;
  EXPECT_EQ(tick(device, state), Device::Status::away);
  cable.serial = "8";
  cable.out = false;
  for (int k = 0; k < 1000; ++k) (void)tick(device, state);
  EXPECT_EQ(tick(device, state), Device::Status::lost);
  EXPECT_EQ(cable.openings, 2) << "opening may move it: once is enough";
  EXPECT_EQ(cable.open, 0);
  EXPECT_EQ(cable.first_forces.size(), 0U) << "and nothing is ever sent to it";
  EXPECT_THAT(device.lost_reason(), AllOf(HasSubstr("test plugged, serial number 8"), HasSubstr("serial number 7"),
                                          HasSubstr("is rejected")));
}

TEST(RecoveringDevice, IsLostForGoodWhenOpeningItWouldRestartIt) {
  Cable cable;
  cable.natural_duration = 3;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  EXPECT_EQ(tick(device, state), Device::Status::ok);
  cable.out = true;
  EXPECT_EQ(tick(device, state), Device::Status::lost);
  cable.out = false;
  EXPECT_EQ(tick(device, state), Device::Status::lost);
  EXPECT_EQ(cable.openings, 1);
  EXPECT_THAT(device.lost_reason(), HasSubstr("the cable is out"));
}

TEST(RecoveringDevice, IsOpenedNoMoreOftenThanItStates) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  for (int k = 0; k < 1000; ++k) {
    cable.out = k / 7 % 2 == 0;  // a loose contact
    (void)tick(device, state);
  }
  EXPECT_LE(cable.openings, 1 + 1.0 / RecoveringDevice::kRetry + 1);
  EXPECT_GE(cable.openings, 3);
}

TEST(RecoveringDevice, ReportsThatADeviceThatIsFoundIsNotReadyYet) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  cable.out = true;
  (void)tick(device, state);
  cable.out = cable.ready = false;
  while (tick(device, state) != Device::Status::ok) {
  }
  EXPECT_FALSE(state.ready);
  cable.ready = true;
  EXPECT_EQ(tick(device, state), Device::Status::ok);
  EXPECT_TRUE(state.ready);
}

TEST(RecoveringDevice, AllocatesNothingInExchangeNorBetweenTicksAcrossLossAndReturn) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  std::size_t allocated = 0;
  for (int k = 0; k < 2000; ++k) {
    cable.out = k % 500 > 200;
    const std::size_t before = allocations();
    (void)tick(device, state);
    allocated += allocations() - before;
  }
  EXPECT_GE(cable.openings, 4);
  EXPECT_EQ(allocated, 0U);
}

TEST(RecoveringDevice, ClosesWhereverTheDeviceIs) {
  for (const int ticks : {0, 1, 2, 50, 400}) {
    Cable cable;
    RecoveringDevice device = plugged(cable);
    DeviceState state;
    (void)tick(device, state, false);
    cable.out = true;
    for (int k = 0; k < ticks; ++k) {
      if (k == 300) cable.out = false;
      (void)tick(device, state, false);
    }
    device.close();
    EXPECT_EQ(cable.open, 0) << ticks;
    EXPECT_EQ(tick(device, state, false), Device::Status::lost);
    EXPECT_THAT(device.lost_reason(), HasSubstr("closed"));
    device.close();
  }
}

TEST(RecoveringDevice, ExchangesAtOnceWhileAnOpeningLastsAndClosesWhenItIsOver) {
  Cable cable;
  std::promise<void> began, may_end;
  bool first = true;
  RecoveringDevice device([&]() -> std::unique_ptr<Device> {
    if (!std::exchange(first, false)) {
      began.set_value();
      may_end.get_future().wait();
    }
    return std::make_unique<Plugged>(cable);
  });
  DeviceState state;
  cable.out = true;
  EXPECT_EQ(tick(device, state, false), Device::Status::away);
  began.get_future().wait();
  cable.out = false;
  for (int k = 0; k < 10000; ++k) ASSERT_EQ(tick(device, state, false), Device::Status::away);
  EXPECT_FALSE(device.lost_reason().empty());
  std::thread closing([&] { device.close(); });
  may_end.set_value();
  closing.join();
  EXPECT_EQ(cable.openings, 2);
  EXPECT_EQ(cable.open, 0) << "what was opened meanwhile is closed too";
}

TEST(RecoveringDevice, ComesBackByItselfOnTheRealClock) {
  Cable cable;
  RecoveringDevice device = plugged(cable);
  DeviceState state;
  for (int loss = 0; loss < 3; ++loss) {
    cable.out = true;
    EXPECT_EQ(tick(device, state, false), Device::Status::away);
    cable.out = false;
    while (tick(device, state, false) == Device::Status::away) std::this_thread::yield();
    EXPECT_GE(state.position.x(), loss + 2);
  }
}

TEST(RecoveringDevice, PassesOnTheErrorOfTheFirstOpening) {
  Cable cable;
  cable.out = true;
  EXPECT_THAT(error_of([&] { (void)plugged(cable); }, Error::Kind::device), HasSubstr("nothing is plugged in"));
}

TEST(RecoveringDevice, OpensAPlugInAgainByItsOwnOpen) {
  RecoveringDevice device(
      [] { return open_device("plugin:path=" FAULTY_PLUGIN R"(,options={"fault":"lost","tick":100})"); });
  DeviceState state;
  int away = 0;
  for (int k = 0; k < 1000; ++k)
    if (tick(device, state) == Device::Status::away) ++away;
  EXPECT_GE(away, 9);
  EXPECT_LE(away, 40);
}

TEST(RecoveringDevice, CarriesASessionOverLossesOnTheRealClock) {
  RecoveringDevice device(
      [] { return open_device("plugin:path=" FAULTY_PLUGIN R"(,options={"fault":"lost","tick":100})"); });
  struct Pushing final : Controller {
    [[nodiscard]] Command update(const State& state) noexcept override {
      Command command;  // no force, so that the session ends without a fade
      if (state.time_ns > 600'000'000) command.status = Command::Status::finished;
      return command;
    }
  } controller;
  const auto estimator = make_velocity_estimator("difference", 1000, 0);
  const ServoReport report =
      ServoLoop(device, controller, *estimator, {}, {.realtime = false, .away_timeout = 60}).run(StopRequest{});
  EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
  EXPECT_GE(report.returns, 1U);
}

}  // namespace
}  // namespace haptrace::test
