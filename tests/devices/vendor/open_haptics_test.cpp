#include "devices/vendor/open_haptics.h"

#include "devices/loop/loose_thread.h"
#include "devices/loop/threaded_device.h"
#include "tests/devices/vendor/support.h"
#include "tests/support/real_time.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;

class OpenHaptics : public testing::Test {
 protected:
  OpenHaptics() { in_real_time(); }

  static std::unique_ptr<Device> open(const std::string& options = "") {
    return open_device("openhaptics:library=" FAKE_HD + options);
  }
  static std::string refusal(const std::string& options = "", Error::Kind kind = Error::Kind::device) {
    return open_error("openhaptics:library=" FAKE_HD + options, kind);
  }

  void push(Device& device, const Wrench& wrench = {Vec3(0.1, 0.2, 0.3), Vec3::Zero()}) {
    exchange_until(device, wrench, [&](auto, const auto&) { return fake_.pushes(); });
    ASSERT_TRUE(fake_.pushes());
  }

  FakeHd& fake_ = renew(fake_hd());
};

TEST_F(OpenHaptics, DescribesItself) {
  const auto device = open();
  const DeviceInfo& info = device->info();
  EXPECT_EQ(info.backend, "openhaptics");
  EXPECT_EQ(info.model, "Touch");
  EXPECT_EQ(info.serial, "A5");
  EXPECT_EQ(info.max_force, 3.3);
  EXPECT_EQ(info.max_continuous_force, 0.88);
  EXPECT_LT((info.workspace_min - Vec3(-0.08, -0.06, -0.035)).norm(), 1e-12);
  EXPECT_LT((info.workspace_max - Vec3(0.08, 0.06, 0.035)).norm(), 1e-12);
  EXPECT_FALSE(info.takes_torque());
  EXPECT_THAT(info.notes, Contains(AllOf(HasSubstr("beyond 1.2 m/s"), HasSubstr("4 N"))));
}

TEST_F(OpenHaptics, FindsTheDefaultDeviceByTheNameThatItsVersionKnows) {
  for (const char* name : {"Default Device", "Default PHANToM"}) {
    fake_.default_name = name;
    EXPECT_EQ(open()->info().model, "Touch") << name;
  }
  fake_.default_name = "Something else";
  EXPECT_THAT(refusal(),
              AllOf(HasSubstr("'Default Device'"), HasSubstr("'Default PHANToM'"), HasSubstr("Touch_Setup")));
  EXPECT_EQ(open(",name=Left Device")->info().model, "Touch");
}

TEST_F(OpenHaptics, ConvertsMillimetresToMetresAndKeepsTheAxes) {
  fake_.is_placed = true;
  for (std::size_t i = 0; i < 3; ++i) fake_.place[i] = 10.0 * static_cast<double>(i + 1);
  fake_.yaw = 0.3;
  fake_.buttons = 2;
  const auto device = open();
  const DeviceState state = exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_LT((state.position - Vec3(0.01, 0.02, 0.03)).norm(), 1e-12);
  EXPECT_LT(state.orientation.angularDistance(Quat(Eigen::AngleAxisd(0.3, Vec3::UnitY()))), 1e-9);
  EXPECT_EQ(state.buttons, 2U);
  push(*device);
  EXPECT_EQ(fake_.force[0], 0.1);
  EXPECT_EQ(fake_.force[1], 0.2);
  EXPECT_EQ(fake_.force[2], 0.3);
}

TEST_F(OpenHaptics, MeasuresTheVelocityOfItsPosition) {
  const auto device = open();
  const DeviceState first = exchange(*device, Vec3::Zero(), 1e-3);
  const Wrench right{Vec3(0.2, 0, 0), Vec3::Zero()};
  const DeviceState then =
      exchange_until(*device, right, [&](auto, const auto& s) { return s.position.x() > first.position.x() + 1e-3; });
  EXPECT_GT(then.velocity.x(), 0.01);
  EXPECT_LT(then.velocity.x(), 1);
}

TEST_F(OpenHaptics, SendsTorquesInMillinewtonMetresToDevicesThatTakeThem) {
  fake_.output_dof = 6;
  const auto device = open();
  EXPECT_TRUE(device->info().takes_torque());
  push(*device, {Vec3(0.1, 0, 0), Vec3(0.01, -0.02, 0.03)});
  EXPECT_NEAR(fake_.torque[0], 10, 1e-9);
  EXPECT_NEAR(fake_.torque[1], -20, 1e-9);
  EXPECT_NEAR(fake_.torque[2], 30, 1e-9);
}

TEST_F(OpenHaptics, WaitsForItsStylusInTheInkwell) {
  fake_.calibration = FakeHd::kNeedsManualInput;
  const auto device = open();
  EXPECT_THAT(device->info().notes, Contains(HasSubstr("inkwell")));
  for (int k = 0; k < 50; ++k) {
    EXPECT_FALSE(exchange(*device, Vec3(0.1, 0, 0), 1e-3).ready);
    EXPECT_FALSE(fake_.pushes());
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_THAT(device->not_ready_reason(), HasSubstr("put its stylus into the inkwell"));
  fake_.calibration = FakeHd::kNeedsUpdate;  // the stylus is in the inkwell now
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
  EXPECT_EQ(fake_.updated_style, 4);
  EXPECT_EQ(fake_.misused, 0) << "the servo loop does not wait for a calibration";
  EXPECT_EQ(device->not_ready_reason(), "");
}

TEST_F(OpenHaptics, ResetsItsEncodersOnlyOnRequest) {
  fake_.styles = 1;
  fake_.calibration = FakeHd::kNeedsManualInput;
  auto device = open();
  EXPECT_THAT(device->not_ready_reason(), AllOf(HasSubstr("reset position"), HasSubstr("reset_encoders=true")));
  EXPECT_EQ(fake_.updates, 0);
  device.reset();
  device = open(",reset_encoders=true");
  EXPECT_EQ(fake_.updated_style, 1);
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
}

TEST_F(OpenHaptics, CalibratesItselfWhereItCan) {
  fake_.styles = 2;
  fake_.calibration = FakeHd::kNeedsUpdate;
  const auto device = open();
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
  EXPECT_EQ(fake_.updated_style, 2);
}

TEST_F(OpenHaptics, IsAwayWithoutForceWhileItsFramesFail) {
  const auto device = open();
  push(*device);
  fake_.fault = 99;
  DeviceState state;
  const Wrench wrench{Vec3(0.1, 0.2, 0.3), Vec3::Zero()};
  exchange_until(*device, wrench, [](auto status, const auto&) { return status == Device::Status::away; });
  EXPECT_EQ(device->exchange(wrench, 1e-3, state), Device::Status::away);
  EXPECT_THAT(device->lost_reason(),
              AllOf(HasSubstr("the fake's motors are too warm"), HasSubstr("let warm motors cool")));
  exchange_until(*device, wrench, [&](auto, const auto&) { return !fake_.pushes(); });
  EXPECT_FALSE(fake_.pushes());
  fake_.fault = 0;
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
  push(*device);
}

TEST_F(OpenHaptics, IsLostWhenItsFramesFailForLong) {
  const auto device = open();
  push(*device);
  fake_.fault = 99;
  DeviceState state;
  exchange_until(*device, {Vec3(0.1, 0, 0), Vec3::Zero()},
                 [](auto status, const auto&) { return status == Device::Status::lost; });
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("the fake's motors are too warm"));
  EXPECT_FALSE(fake_.pushes());
}

TEST_F(OpenHaptics, IsLostWhenItsServoLoopStandsStill) {
  const auto device = open();
  push(*device);
  fake_.frozen = true;
  DeviceState state;
  exchange_until(*device, {Vec3(0.1, 0, 0), Vec3::Zero()},
                 [](auto status, const auto&) { return status == Device::Status::lost; });
  EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
  EXPECT_THAT(device->lost_reason(), HasSubstr("servo loop has stopped"));
  device->close();
  EXPECT_FALSE(fake_.pushes());
  EXPECT_EQ(fake_.closed, 1);
}

TEST_F(OpenHaptics, SendsNoForceWhenExchangesStop) {
  const auto device = open();
  push(*device);
  for (int k = 0; k < 3000 && fake_.pushes(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_FALSE(fake_.pushes());
  const int frames = fake_.frames;
  for (int k = 0; k < 3000 && fake_.frames == frames; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_GT(fake_.frames, frames) << "it is asked on";
}

TEST_F(OpenHaptics, SendsNoForceThatIsNotFinite) {
  const auto device = open();
  push(*device);
  exchange_until(*device, {Vec3(kNaN, 1, 1), Vec3::Zero()}, [&](auto, const auto&) { return !fake_.pushes(); });
  EXPECT_FALSE(fake_.pushes());
}

TEST_F(OpenHaptics, NotesARateThatItsLibraryRefuses) {
  fake_.takes_rate = false;
  const auto device = open(",rate=500");
  EXPECT_THAT(device->info().notes, Contains(HasSubstr("does not take this value (500 Hz was requested)")));
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
}

TEST_F(OpenHaptics, DistinguishesAMissingLibraryFromAMissingDevice) {
  EXPECT_THAT(
      open_error("openhaptics:library=/no/such.so", Error::Kind::device),
      AllOf(HasSubstr("/no/such.so (there is no such file)"), HasSubstr("OpenHaptics and the Touch Device Driver")));
  EXPECT_THAT(
      refusal(",name=Right Device"),
      AllOf(HasSubstr("its library was found, but 'Right Device' cannot be opened: the fake's device is missing"),
            HasSubstr("Touch_Setup")));
  EXPECT_EQ(open(",name=Left Device")->info().model, "Touch");
  EXPECT_THAT(refusal(",rate=fast", Error::Kind::input),
              HasSubstr("rate: expected a whole number from 100 to 10000 Hz"));
  EXPECT_THAT(refusal(",reset_encoders=1", Error::Kind::input), HasSubstr("expected true or false"));
}

TEST_F(OpenHaptics, IsOpenOnceAtATime) {
  auto device = open();
  EXPECT_THAT(refusal(), HasSubstr("another OpenHaptics device is open"));
  device.reset();
  for (int k = 0; k < 3; ++k) EXPECT_TRUE(exchange_until(*open(), {}, is_ready).ready);
  EXPECT_EQ(fake_.opened, 4);
  EXPECT_EQ(fake_.closed, 4);
}

TEST_F(OpenHaptics, EndsWithoutForceHoweverItIsClosed) {
  for (const bool closes : {true, false}) {
    renew(fake_);
    auto device = open();
    push(*device);
    if (closes)
      device->close();
    else
      device.reset();
    EXPECT_FALSE(fake_.pushes());
    EXPECT_FALSE(fake_.running || fake_.output || fake_.scheduled);
    EXPECT_EQ(fake_.closed, 1);
    EXPECT_EQ(fake_.misused, 0) << "states and forces belong into frames";
  }
}

TEST_F(OpenHaptics, ClosesInTimeThoughItsLibraryDoesNotReturn) {
  using enum FakeHd::Call;
  for (const FakeHd::Call call : {unschedule, stop_scheduler, disable_device, update_calibration}) {
    SCOPED_TRACE(static_cast<int>(call));
    renew(fake_);
    auto device = open();
    push(*device);
    fake_.hangs_in = call;
    if (call == update_calibration) {
      fake_.calibration = FakeHd::kNeedsUpdate;
      for (int k = 0; k < 3000 && fake_.hung != call; ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const auto begin = std::chrono::steady_clock::now();
    device->close();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::duration<double>(Device::kLongestClose));
    EXPECT_EQ(fake_.hung, call);
    EXPECT_FALSE(fake_.pushes());
    EXPECT_EQ(device->zero_force(), ZeroForce::confirmed);
    EXPECT_TRUE(LooseThread::any_given_up()) << "the program must not end through its destructors";
    device.reset();
    EXPECT_FALSE(fake_.pushes()) << "the library may call its frames on";

    // A calibration that hangs does not keep the library from closing the device.
    if (call != update_calibration) {
      EXPECT_THAT(refusal(), HasSubstr("its library does not return from closing it"));
    }
    fake_.hangs_in = none;
    std::unique_ptr<Device> next;
    for (int k = 0; k < 3000 && next == nullptr; ++k) {
      try {
        next = open();
      } catch (const Error&) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }
    EXPECT_NE(next, nullptr) << "the call that hung has returned";
    EXPECT_EQ(fake_.closed, 1);
  }
}

}  // namespace
}  // namespace haptrace::test
