#include "devices/loop/threaded_device.h"

#include "base/error.h"
#include "tests/devices/support.h"
#include "tests/support/allocations.h"
#include "tests/support/real_time.h"

#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {
namespace {

using testing::HasSubstr;
using namespace std::chrono_literals;

/// The hardware behind a driver: records the commands and sets the answers. Outlives the driver.
struct Hardware {
  std::atomic<double> force{kNaN};  ///< force of the last round along x [N]
  std::atomic<int> rounds{0}, releases{0};
  std::atomic<bool> answers{true}, breaks{false}, stands_still{false}, answers_then{false};
  std::atomic<int> stood_still{0};                              ///< round in which it stood still
  std::atomic<bool> hangs{false}, hung{false}, stopped{false};  ///< rounds hang; a round hung; emergency stop called
  std::atomic<ZeroForce> farewell{ZeroForce::confirmed};
};

class FakeDriver final : public DeviceDriver {
 public:
  explicit FakeDriver(std::shared_ptr<Hardware> hardware) : kept_(std::move(hardware)), hardware_(*kept_) {
    info_.name = "fake";
  }
  ~FakeDriver() override { (void)release(); }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }

  bool round(const Wrench& wrench, DeviceState& state) override {
    while (hardware_.hangs) {
      hardware_.hung = true;
      std::this_thread::sleep_for(1ms);
    }
    hardware_.force = wrench.force.x();
    ++hardware_.rounds;
    if (hardware_.breaks) throw device_error("its magic smoke escaped");
    if (hardware_.stands_still) {
      std::this_thread::sleep_for(200ms);
      hardware_.stands_still = false;
      hardware_.stood_still = hardware_.rounds.load();
      return hardware_.answers_then;
    }
    std::this_thread::sleep_for(200us);
    state.position = Vec3(hardware_.rounds, 0, 0);
    return hardware_.answers;
  }

  ZeroForce release() noexcept override {
    if (released_) return hardware_.farewell;
    released_ = true;
    ++hardware_.releases;
    hardware_.force = 0;
    return hardware_.farewell;
  }

  ZeroForce emergency_stop() noexcept override {
    hardware_.stopped = true;
    return ZeroForce::confirmed;
  }

 private:
  std::shared_ptr<Hardware> kept_;  ///< keeps the hardware alive for an abandoned thread
  Hardware& hardware_;
  DeviceInfo info_;
  bool released_ = false;
};

class ThreadedDeviceTest : public testing::Test {
 protected:
  ThreadedDeviceTest() { in_real_time(); }

  const std::shared_ptr<Hardware> kept_ = std::make_shared<Hardware>();
  Hardware& hardware_ = *kept_;

  std::unique_ptr<ThreadedDevice> open() {
    return std::make_unique<ThreadedDevice>(std::make_unique<FakeDriver>(kept_));
  }

  /// Waits about 5 s at most until `condition` holds; if it does not, the test's next expectation fails.
  template <class Condition>
  static void wait_until(Condition condition) {
    for (int k = 0; k < 5000 && !condition(); ++k) std::this_thread::sleep_for(1ms);
  }

  /// Exchanges until the hardware has this force. One exchange is not enough: the device withdraws a force that waits
  /// too long for its driver.
  void push(Device& device, double force) {
    bool pushed = false;
    wait_until([&] {
      exchange(device, Vec3(force, 0, 0), 1e-3);
      return pushed = hardware_.force == force;
    });
    EXPECT_TRUE(pushed) << force << " N";
  }
};

TEST_F(ThreadedDeviceTest, SendsTheNewestWrenchAndAnswersWithTheNewestState) {
  const auto device = open();
  double before = 0;
  for (int k = 1; k <= 20; ++k) {
    push(*device, k);
    wait_until([&] { return exchange(*device, Vec3(k, 0, 0), 1e-3).position.x() > before; });
    const double newest = exchange(*device, Vec3(k, 0, 0), 1e-3).position.x();
    EXPECT_GT(newest, before);
    before = newest;
  }
}

TEST_F(ThreadedDeviceTest, SendsZeroForceWhenExchangesStop) {
  const auto device = open();
  push(*device, 3);
  wait_until([&] { return hardware_.force == 0; });
  EXPECT_EQ(hardware_.force, 0);
  const int rounds = hardware_.rounds;
  wait_until([&] { return hardware_.rounds > rounds; });
  EXPECT_GT(hardware_.rounds, rounds) << "the connection is kept alive";
}

TEST_F(ThreadedDeviceTest, SendsNoForceThatIsNotFinite) {
  const auto device = open();
  exchange(*device, Vec3(kNaN, 1, 1), std::numeric_limits<double>::quiet_NaN());
  const int rounds = hardware_.rounds;
  wait_until([&] { return hardware_.rounds > rounds + 1; });
  EXPECT_EQ(hardware_.force, 0);
}

TEST_F(ThreadedDeviceTest, ReportsTheAgeOfAState) {
  const auto device = open();
  hardware_.answers = false;
  double age = 0;
  wait_until([&] { return (age = exchange(*device, Vec3::Zero(), 1e-3).age) >= 0.02; });
  EXPECT_GE(age, 0.02);
}

TEST_F(ThreadedDeviceTest, NumbersItsAnswersSoThatARepeatedStateDoesNotLookNew) {
  const auto device = open();
  DeviceState state = exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_GT(state.sequence, 0U);
  for (double position = state.position.x(); position < 20; position = state.position.x()) {
    const DeviceState before = state;
    state = exchange(*device, Vec3::Zero(), 1e-3);
    EXPECT_EQ(state.sequence != before.sequence, state.position != before.position);
  }
  hardware_.answers = false;
  const int rounds = hardware_.rounds;
  wait_until([&] { return hardware_.rounds > rounds + 1; });
  const std::uint64_t last = exchange(*device, Vec3::Zero(), 1e-3).sequence;
  const int later = hardware_.rounds;
  wait_until([&] { return hardware_.rounds > later + 1; });
  DeviceState silent;
  if (device->exchange({}, 1e-3, silent) == Device::Status::ok) {
    EXPECT_EQ(silent.sequence, last) << "rounds without an answer make no sample";
  }
}

TEST_F(ThreadedDeviceTest, IsNotLostForAProcessThatStoodStill) {
  const auto device = open();
  hardware_.stands_still = true;  // longer than the time-out, and the round fails
  wait_until([&] { return !hardware_.stands_still; });
  const int rounds = hardware_.rounds;
  wait_until([&] { return hardware_.rounds > rounds + 1; });
  exchange(*device, Vec3::Zero(), 1e-3);
}

TEST_F(ThreadedDeviceTest, TakesNoAnswerThatMayBeFromBeforeItStoodStill) {
  const auto device = open();
  hardware_.answers_then = true;
  hardware_.stands_still = true;
  double first = 0;
  wait_until([&] {
    first = exchange(*device, Vec3::Zero(), 1e-3).position.x();
    return hardware_.stood_still > 0 && first >= hardware_.stood_still;
  });
  EXPECT_GE(first, hardware_.stood_still + 2);
}

TEST_F(ThreadedDeviceTest, IsLostWithTheDriversReasonAndReleasedOnce) {
  const auto device = open();
  hardware_.breaks = true;
  DeviceState state;
  wait_until([&] { return device->exchange({}, 1e-3, state) == Device::Status::lost; });
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("magic smoke"));
  device->close();
  EXPECT_EQ(hardware_.releases, 1);
}

TEST_F(ThreadedDeviceTest, IsLostWhenItDoesNotAnswerForLong) {
  const auto device = open();
  hardware_.answers = false;
  DeviceState state;
  wait_until([&] { return device->exchange({}, 1e-3, state) == Device::Status::lost; });
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("did not answer"));
  wait_until([&] { return hardware_.releases == 1; });
  EXPECT_EQ(hardware_.releases, 1);
}

TEST_F(ThreadedDeviceTest, IsNotOpenedWhenItNeverAnswers) {
  hardware_.answers = false;
  EXPECT_THAT(error_of([&] { (void)open(); }, Error::Kind::device), HasSubstr("fake: it was opened, but"));
  EXPECT_EQ(hardware_.releases, 1);
}

TEST_F(ThreadedDeviceTest, LetsGoWithZeroForceWhenItIsClosed) {
  const auto device = open();
  exchange(*device, Vec3(3, 0, 0), 1e-3);
  device->close();
  EXPECT_EQ(hardware_.force, 0);
  EXPECT_EQ(hardware_.releases, 1);
  DeviceState state;
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("closed"));
}

TEST_F(ThreadedDeviceTest, ConfirmsZeroForceOnceARoundWithItWasAnswered) {
  const auto device = open();
  push(*device, 3);
  exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_EQ(device->zero_force(), ZeroForce::confirmed);
  EXPECT_EQ(hardware_.force, 0);
  device->close();
  EXPECT_EQ(device->zero_force(), ZeroForce::confirmed) << "its release says so";
}

TEST_F(ThreadedDeviceTest, ReportsTheDriversKnowledgeOfTheForceOnceItIsLostOrClosed) {
  for (const ZeroForce farewell : {ZeroForce::confirmed, ZeroForce::sent, ZeroForce::failed}) {
    hardware_.farewell = farewell;
    hardware_.breaks = false;
    const auto lost = open();
    push(*lost, 3);
    hardware_.breaks = true;
    EXPECT_EQ(lost->zero_force(), farewell) << "it broke while it was asked";
    hardware_.breaks = false;
    const auto closed = open();
    push(*closed, 3);
    closed->close();
    EXPECT_EQ(closed->zero_force(), farewell);
    const auto idle = open();
    idle->close();
    EXPECT_EQ(idle->zero_force(), ZeroForce::confirmed) << "it never had a force";
  }
}

TEST_F(ThreadedDeviceTest, DoesNotTakeSilenceForZeroForce) {
  hardware_.farewell = ZeroForce::failed;
  const auto device = open();
  push(*device, 3);
  hardware_.answers = false;
  EXPECT_EQ(device->zero_force(), ZeroForce::failed);
}

TEST_F(ThreadedDeviceTest, IsClosedEvenWhenItsDriverNeverReturns) {
  const auto device = open();
  push(*device, 3);
  hardware_.hangs = true;
  wait_until([&] { return hardware_.hung.load(); });
  EXPECT_EQ(device->emergency_stop(), ZeroForce::confirmed);
  EXPECT_TRUE(hardware_.stopped) << "from outside, since the driver is in its round";
  device->close();
  EXPECT_EQ(hardware_.releases, 0) << "still in its round";
  EXPECT_EQ(device->zero_force(), ZeroForce::failed);
  EXPECT_TRUE(LooseThread::any_given_up());
  hardware_.hangs = false;
  wait_until([&] { return hardware_.releases == 1; });
  EXPECT_EQ(hardware_.releases, 1) << "and once it returns, it lets go all the same";
}

TEST_F(ThreadedDeviceTest, StopsByItsRoundsWhileTheyContinue) {
  const auto device = open();
  push(*device, 3);
  EXPECT_EQ(device->emergency_stop(), ZeroForce::confirmed);
  EXPECT_FALSE(hardware_.stopped);
  EXPECT_EQ(hardware_.force, 0);
}

TEST_F(ThreadedDeviceTest, AllocatesNothingInExchange) {
  const auto device = open();
  DeviceState state;
  const std::size_t before = allocations();
  for (int k = 0; k < 1000; ++k) (void)device->exchange({Vec3(1, k, kNaN), Vec3::Zero()}, 1e-3, state);
  EXPECT_EQ(allocations(), before);
}

}  // namespace
}  // namespace haptrace::test
