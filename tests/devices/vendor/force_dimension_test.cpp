#include "devices/vendor/force_dimension.h"

#include "devices/loop/threaded_device.h"
#include "tests/devices/vendor/support.h"
#include "tests/support/real_time.h"

#include <gmock/gmock.h>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

class ForceDimension : public testing::Test {
 protected:
  ForceDimension() { in_real_time(); }

  static std::unique_ptr<Device> open(const std::string& options = "") {
    return open_device("forcedimension:library=" FAKE_DRD + options);
  }
  static std::string refusal(const std::string& options = "", Error::Kind kind = Error::Kind::device) {
    return open_error("forcedimension:library=" FAKE_DRD + options, kind);
  }

  /// Sends a wrench until the motors push.
  void push(Device& device, const Wrench& wrench = {Vec3(1, 2, 3), Vec3::Zero()}) {
    exchange_until(device, wrench, [&](auto, const auto&) { return fake_.pushes(); });
    ASSERT_TRUE(fake_.pushes());
  }

  FakeDrd& fake_ = renew(fake_drd());
};

TEST_F(ForceDimension, DescribesItself) {
  const auto device = open();
  const DeviceInfo& info = device->info();
  EXPECT_EQ(info.backend, "forcedimension");
  EXPECT_EQ(info.model, "Force Dimension omega.3");
  EXPECT_EQ(info.serial, "4711");
  EXPECT_EQ(info.max_force, 12);
  EXPECT_EQ(info.workspace_max, Vec3(0.08, 0.08, 0.055)) << "it is not as deep as it is wide";
  EXPECT_EQ(info.workspace_min, Vec3(-0.08, -0.08, -0.055));
  EXPECT_FALSE(info.takes_torque() || info.measures_orientation || info.measures_velocity);
  EXPECT_THAT(info.notes, Contains(HasSubstr("version 3.17.5")));
  EXPECT_EQ(fake_.gravity_compensation, 1);
}

TEST_F(ForceDimension, ChangesFramesByARotation) {
  Eigen::Matrix3d r;
  for (int i = 0; i < 3; ++i) r.col(i) = from_force_dimension(Vec3::Unit(i));
  EXPECT_EQ(r.determinant(), 1);
  EXPECT_EQ(r * r.transpose(), Eigen::Matrix3d::Identity());
  EXPECT_EQ(from_force_dimension(Vec3::UnitX()), Vec3::UnitZ()) << "towards the user";
  EXPECT_EQ(from_force_dimension(Vec3::UnitY()), Vec3::UnitX()) << "to the right";
  EXPECT_EQ(to_force_dimension(from_force_dimension(Vec3(1, 2, 3))), Vec3(1, 2, 3));
}

TEST_F(ForceDimension, TurnsAnOrientationAboutTheSameLineInBothFrames) {
  const Eigen::AngleAxisd turn_f(0.7, Vec3(1, -2, 3).normalized());
  double rows[3][3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) rows[i][j] = turn_f.toRotationMatrix()(i, j);
  const Quat expected(Eigen::AngleAxisd(0.7, from_force_dimension(turn_f.axis())));
  EXPECT_LT(orientation_from_force_dimension(rows).angularDistance(expected), 1e-12);
}

TEST_F(ForceDimension, ShowsPositionsAndSendsForcesInW) {
  fake_.is_placed = true;
  for (std::size_t i = 0; i < 3; ++i) fake_.place[i] = 0.01 * static_cast<double>(i + 1);
  const auto device = open();
  push(*device);
  EXPECT_EQ(exchange(*device, Vec3::Zero(), 1e-3).position, Vec3(0.02, 0.03, 0.01));
  push(*device);
  EXPECT_EQ(fake_.motor(0), 3);
  EXPECT_EQ(fake_.motor(1), 1);
  EXPECT_EQ(fake_.motor(2), 2);
}

TEST_F(ForceDimension, TurnsAWristThatItHas) {
  fake_.type = 104;
  fake_.yaw = 0.3;
  fake_.buttons = 1;
  const auto device = open();
  EXPECT_TRUE(device->info().takes_torque() && device->info().measures_orientation);
  EXPECT_EQ(fake_.emulated_button, 1) << "the gripper";
  push(*device, {Vec3(1, 0, 0), Vec3(0.01, 0.02, 0.03)});
  EXPECT_EQ(fake_.torque[0], 0.03);
  EXPECT_EQ(fake_.torque[1], 0.01);
  EXPECT_EQ(fake_.torque[2], 0.02);
  const DeviceState state = exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_EQ(state.buttons, 1U);
  EXPECT_LT(state.orientation.angularDistance(Quat(Eigen::AngleAxisd(0.3, Vec3::UnitY()))), 1e-9) << "z of F is up";
}

TEST_F(ForceDimension, BoundsTheTorque) {
  fake_.type = 104;
  const auto device = open();
  push(*device, {Vec3(1, 0, 0), Vec3(3, 0, 4)});
  EXPECT_NEAR(fake_.torque[1], 0.24, 1e-12);
  EXPECT_NEAR(fake_.torque[0], 0.32, 1e-12);
}

TEST_F(ForceDimension, DoesNotTreatTimeGuardAndSaturationAsErrors) {
  const auto device = open();
  for (const int answer : {1, 2}) {
    fake_.answer = answer;
    for (int k = 0; k < 150; ++k) {
      exchange(*device, Vec3(1, 0, 0), 1e-3);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_TRUE(fake_.pushes());
  }
}

TEST_F(ForceDimension, IsLostWithTheLibrarysMessageWhenErrorsLast) {
  for (const bool reads_only : {true, false}) {
    renew(fake_);
    const auto device = open();
    push(*device);
    (reads_only ? fake_.position_answer : fake_.answer) = -1;
    DeviceState state;
    exchange_until(*device, {Vec3(1, 2, 3), Vec3::Zero()},
                   [](auto status, const auto&) { return status == Device::Status::lost; });
    EXPECT_EQ(device->exchange({}, 1e-3, state), Device::Status::lost);
    EXPECT_THAT(device->lost_reason(), AllOf(HasSubstr("the fake's own trouble"), HasSubstr("cable")));
    exchange_until(*device, {}, [&](auto, const auto&) { return fake_.closed == 1; });
    EXPECT_FALSE(fake_.pushes());
    EXPECT_EQ(fake_.closed, 1);
    if (reads_only) {
      EXPECT_EQ(fake_.blind_pushes, 1) << "the first error is not foreseen";
    }
  }
}

TEST_F(ForceDimension, ToleratesAShortError) {
  const auto device = open();
  push(*device);
  fake_.position_answer = -1;
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  fake_.position_answer = 0;
  push(*device);
  exchange(*device, Vec3::Zero(), 1e-3);
}

TEST_F(ForceDimension, ReportsWhyItsForcesAreOffAndSendsNone) {
  const auto device = open();
  const char* words[] = {"",          "force button", "faster than its own limit", "watchdog",
                         "a program", "USB",          "dead man's switch"};
  for (int cause = 1; cause <= 6; ++cause) {
    push(*device);
    EXPECT_EQ(device->not_ready_reason(), "");
    fake_.force_off_cause = cause;
    exchange_until(*device, {Vec3(1, 2, 3), Vec3::Zero()}, [](auto, const auto& state) { return !state.ready; });
    EXPECT_THAT(device->not_ready_reason(), HasSubstr(words[cause]));
    exchange_until(*device, {Vec3(1, 2, 3), Vec3::Zero()}, [&](auto, const auto&) { return fake_.force[0] == 0; });
    EXPECT_EQ(fake_.force[0], 0) << "it would push as soon as forces are on again";
    fake_.force_off_cause = 0;
    EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
  }
}

TEST_F(ForceDimension, KeepsItsForcesOffUntilItIsCalibrated) {
  fake_.calibrated = false;
  fake_.is_placed = true;
  fake_.place[1] = 0.05;
  const auto device = open();
  EXPECT_THAT(device->info().notes, Contains(HasSubstr("forcedimension:initialise=true")));
  EXPECT_EQ(fake_.auto_inits, 0) << "nobody asked its motors to move";
  for (int k = 0; k < 50; ++k) {
    const DeviceState state = exchange(*device, Vec3(1, 2, 3), 1e-3);
    EXPECT_FALSE(state.ready);
    EXPECT_EQ(state.position, Vec3::Zero()) << "the jump of a calibration is not for a controller to see";
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_FALSE(fake_.enabled || fake_.pushes());
  fake_.calibrated = true;
  EXPECT_EQ(exchange_until(*device, {}, is_ready).position.x(), 0.05);
  EXPECT_TRUE(fake_.enabled);
  EXPECT_EQ(device->not_ready_reason(), "");
}

TEST_F(ForceDimension, InitialisesItselfWhenItIsAskedTo) {
  fake_.calibrated = false;
  const auto device = open(",initialise=true");
  EXPECT_EQ(fake_.auto_inits, 1);
  EXPECT_EQ(fake_.robotic_stops, 1) << "its own control loop lets go";
  EXPECT_TRUE(exchange_until(*device, {}, is_ready).ready);
  device->close();
  open(",initialise=true");
  EXPECT_EQ(fake_.auto_inits, 1) << "it is calibrated";
}

TEST_F(ForceDimension, LetsGoWhenItCannotInitialiseItself) {
  fake_.calibrated = fake_.auto_init_works = false;
  EXPECT_THAT(refusal(",initialise=true"),
              AllOf(HasSubstr("could not initialise itself: the fake's own trouble"), HasSubstr("let go of it")));
  EXPECT_EQ(fake_.robotic_stops, 1);
  EXPECT_EQ(fake_.closed, 1);
  renew(fake_).opens_robotic = fake_.calibrated = false;
  EXPECT_THAT(refusal(",initialise=true"), HasSubstr("cannot initialise this device with its motors"));
}

TEST_F(ForceDimension, IsOpenedWithoutRoboticsOrBySerialNumberToo) {
  fake_.opens_robotic = false;
  EXPECT_TRUE(exchange_until(*open(), {}, is_ready).ready);
  EXPECT_EQ(fake_.opened_robotic, 0);
  fake_.calibrated = false;
  EXPECT_FALSE(exchange(*open(), Vec3::Zero(), 0).ready) << "dhdGetStatus says so";
  renew(fake_);
  EXPECT_TRUE(exchange_until(*open(",serial=4711"), {}, is_ready).ready);
  EXPECT_THAT(refusal(",serial=12"), HasSubstr("no device with serial number 12 can be opened"));
  EXPECT_EQ(fake_.closed, fake_.opened);
}

TEST_F(ForceDimension, DistinguishesAMissingLibraryFromAMissingDevice) {
  EXPECT_THAT(open_error("forcedimension:library=/no/such.so", Error::Kind::device),
              AllOf(HasSubstr("/no/such.so (there is no such file)"), HasSubstr("install the vendor's SDK")));
  EXPECT_THAT(open_error("forcedimension:library=" FAKE_HD, Error::Kind::device),
              HasSubstr("does not export 'dhdGetSDKVersion'"));
  fake_.devices = 0;
  EXPECT_THAT(refusal(), AllOf(HasSubstr("its library was found, but no device"), HasSubstr("haptrace doctor")));
  fake_.devices = 1;
  fake_.opens = false;
  EXPECT_THAT(refusal(), HasSubstr("device 0 cannot be opened: the fake's own trouble"));
}

TEST_F(ForceDimension, RejectsInvalidOptions) {
  EXPECT_THAT(refusal(",serial=x", Error::Kind::input), HasSubstr("serial: expected a whole number from 0 to 65535"));
  EXPECT_THAT(refusal(",serial=1,index=1", Error::Kind::input), HasSubstr("leave one out"));
  EXPECT_THAT(refusal(",initialise=yes", Error::Kind::input), HasSubstr("initialise: expected true or false"));
  EXPECT_THAT(refusal(",max_force=30", Error::Kind::input), HasSubstr("max_force is 30 N; it must be from 0 to 12 N"));
  EXPECT_EQ(fake_.closed, fake_.opened);
}

TEST_F(ForceDimension, UsesTheSmallestForceLimitOfModelUserAndLibrary) {
  EXPECT_EQ(open(",max_force=5")->info().max_force, 5);
  fake_.software_max_force = 3;
  EXPECT_EQ(open(",max_force=5")->info().max_force, 3);
  renew(fake_).type = 999;
  EXPECT_THAT(refusal(), AllOf(HasSubstr("devices of type 999"), HasSubstr("forcedimension:max_force=8")));
  EXPECT_EQ(open(",max_force=8")->info().max_force, 8);
}

TEST_F(ForceDimension, ArmsItsWatchdogWithTheFirstForce) {
  const auto device = open();
  exchange(*device, Vec3::Zero(), 1e-3);
  EXPECT_EQ(fake_.watchdog, 0);
  EXPECT_THAT(device->info().notes, Not(Contains(HasSubstr("watchdog"))));
  push(*device);
  EXPECT_EQ(fake_.watchdog, 255);
  device->close();
  renew(fake_).has_watchdog = false;
  EXPECT_THAT(open()->info().notes, Contains(HasSubstr("watchdog cannot be set")));
}

TEST_F(ForceDimension, LeavesGravityToTheUserWhenItIsAskedTo) {
  open(",gravity_compensation=false");
  EXPECT_EQ(fake_.gravity_compensation, 0);
}

TEST_F(ForceDimension, SendsNoForceWhenExchangesStop) {
  const auto device = open();
  push(*device);
  for (int k = 0; k < 3000 && fake_.pushes(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_FALSE(fake_.pushes());
}

TEST_F(ForceDimension, EndsWithoutForceHoweverItIsClosed) {
  for (const bool closes : {true, false}) {
    renew(fake_);
    auto device = open();
    push(*device);
    if (closes)
      device->close();
    else
      device.reset();
    EXPECT_FALSE(fake_.pushes());
    EXPECT_EQ(fake_.force[0], 0) << "none is left behind for whoever switches forces on again";
    EXPECT_TRUE(fake_.braked);
    EXPECT_FALSE(fake_.enabled);
    EXPECT_EQ(fake_.closed, 1);
  }
}

}  // namespace
}  // namespace haptrace::test
