#include "devices/haply/two_diy.h"

#include "tests/devices/serial/support.h"
#include "tests/support/real_time.h"

#include <fmt/format.h>
#include <random>

namespace haptrace::test {
namespace {

using testing::HasSubstr;
using Fault = EmulatedLine::Fault;
using Way = EmulatedLine::Way;

// ---- bytes ----

TEST(TwoDiyProtocol, EncodesMessagesAsTheFirmwareReadsThem) {
  const TwoDiyCalibration gen3 = two_diy_calibration("gen3", "test");
  // Motors and encoders on ports 1 and 2, all counter-clockwise; 12 and 168 degrees, 4880 counts.
  const std::vector<std::uint8_t> setup{1,    5, 3,    1,    1,    3, 1, 1,    0,    0, 0,    0,    0x40,
                                        0x41, 0, 0x80, 0x98, 0x45, 0, 0, 0x28, 0x43, 0, 0x80, 0x98, 0x45};
  EXPECT_EQ(two_diy_setup(gen3), setup);
  // The first arm is on port 2; the torques are 0.5 and -0.25 N m.
  const TwoDiyTorques torques{2, 5, 0, 0, 0x80, 0xbe, 0, 0, 0, 0x3f};
  EXPECT_EQ(two_diy_exchange(gen3, Vec2(0.5, -0.25)), torques);
  EXPECT_EQ(two_diy_exchange(gen3, Vec2(kNaN, 1e99)), (TwoDiyTorques{2, 5, 0, 0, 0x80, 0x7f, 0, 0, 0, 0}));
  const TwoDiyCalibration gen2 = two_diy_calibration("gen2", "test");
  EXPECT_EQ(two_diy_setup(gen2)[3], 0) << "its port 1 turns clockwise";
  EXPECT_EQ(two_diy_setup(gen2)[4], 1);
}

TEST(TwoDiyProtocol, AcceptsOnlyValidAnswers) {
  const TwoDiyCalibration gen3 = two_diy_calibration("gen3", "test");
  std::vector<std::uint8_t> answer{5, 0, 0, 0x40, 0x41, 0, 0, 0x28, 0x43};
  const auto angles = two_diy_angles(gen3, answer);
  ASSERT_TRUE(angles);
  EXPECT_NEAR((*angles)[0], 168 * std::numbers::pi / 180, 1e-6);
  EXPECT_NEAR((*angles)[1], 12 * std::numbers::pi / 180, 1e-6);
  EXPECT_FALSE(two_diy_angles(gen3, std::span(answer).first(8)));
  answer[0] = 4;
  EXPECT_FALSE(two_diy_angles(gen3, answer)) << "another id";
  answer = {5, 0, 0, 0xc0, 0x7f, 0, 0, 0, 0};
  EXPECT_FALSE(two_diy_angles(gen3, answer)) << "not a number";
  answer = {5, 0, 0, 0, 0x60, 0, 0, 0, 0};
  EXPECT_FALSE(two_diy_angles(gen3, answer)) << "no angle";
}

TEST(TwoDiyProtocol, ReadsAnglesFromAnAnswerThatHasVelocitiesToo) {
  const TwoDiyCalibration gen3 = two_diy_calibration("gen3", "test");
  std::vector<std::uint8_t> answer{5, 0, 0, 0x40, 0x41, 0, 0, 0x80, 0x3f, 0, 0, 0x28, 0x43, 0, 0, 0, 0xc0};
  const auto angles = two_diy_angles(gen3, answer);
  ASSERT_TRUE(angles);
  EXPECT_NEAR((*angles)[0], 168 * std::numbers::pi / 180, 1e-6);
  EXPECT_NEAR((*angles)[1], 12 * std::numbers::pi / 180, 1e-6);
  answer[7] = 0xc0, answer[8] = 0x7f;
  EXPECT_FALSE(two_diy_angles(gen3, answer)) << "a velocity that is not finite";
  EXPECT_FALSE(two_diy_angles(gen3, std::span(answer).first(13))) << "neither form";
}

/// Sends bytes directly to the emulated firmware.
class TwoDiyBoard : public testing::Test {
 protected:
  std::vector<std::uint8_t> say(const std::vector<std::uint8_t>& bytes) {
    std::vector<std::uint8_t> answer;
    for (const std::uint8_t byte : bytes) board_.receive(byte, answer);
    return answer;
  }
  std::vector<std::uint8_t> exchange(const Vec2& torques) {
    const auto bytes = two_diy_exchange(truth_, torques);
    return say({bytes.begin(), bytes.end()});
  }

  TwoDiyCalibration truth_ = two_diy_calibration("gen3", "test");
  EmulatedTwoDiy board_{plant_of("haply2diy"), truth_};
};

TEST_F(TwoDiyBoard, StopsWhereverAMessageBrokeOff) {
  say(two_diy_setup(truth_));
  for (std::size_t cut = 0; cut <= 10; ++cut) {
    const auto before = two_diy_angles(truth_, exchange(Vec2(0.1, -0.1)));
    EXPECT_GT(board_.torque(), 0.09);
    const auto torn = two_diy_exchange(truth_, Vec2(0.12, 0.12));
    say({torn.begin(), torn.begin() + static_cast<std::ptrdiff_t>(cut)});
    const auto answers = say(two_diy_calm(truth_));
    EXPECT_EQ(board_.torque(), 0) << cut;
    EXPECT_EQ(answers.size() % kTwoDiyAngles, 0U) << cut;
    EXPECT_EQ(two_diy_angles(truth_, std::span(answers).last(kTwoDiyAngles)), before) << "encoders kept, " << cut;
  }
}

TEST_F(TwoDiyBoard, IsSetUpAgainInAnyState) {
  const auto setup = two_diy_setup(truth_);
  std::mt19937 random(3);
  for (int k = 0; k < 2000; ++k) {
    say(setup);
    exchange(Vec2(0.1, 0.1));
    if (k % 3 == 0) board_.power_cycle();
    // Send messages that are cut off, or have one byte lost or changed.
    auto bytes = k % 2 == 0 ? setup : std::vector<std::uint8_t>();
    const auto torques = two_diy_exchange(truth_, Vec2(0.01, 0.02));
    bytes.insert(bytes.end(), torques.begin(), torques.end());
    const std::size_t place = random() % bytes.size();
    if (k % 5 == 0) bytes.resize(place);
    if (k % 5 == 1) bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(place));
    if (k % 5 == 2 && place > 8) bytes[place] ^= 4;  // with a wrong count the board waits for hundreds of bytes
    say(bytes);
    say(two_diy_restart(truth_));
    ASSERT_EQ(board_.torque(), 0) << k;
    ASSERT_TRUE(two_diy_angles(truth_, exchange(Vec2::Zero()))) << k;
  }
}

// ---- homing ----

/// Moves the arms by hand; the encoders start from an arbitrary count.
class Homing : public testing::Test {
 protected:
  void lead(const Vec2& to, double seconds) {
    const Vec2 from = arms_;
    const int steps = static_cast<int>(seconds * 1000);
    for (int k = 1; k <= steps; ++k) {
      arms_ = from + (to - from) * k / steps;
      now_ns_ += 1'000'000;
      homing_.update(arms_ - lost_, now_ns_);
    }
  }

  const Vec2 stops_{2.9, 0.2}, middle_{2.3, 0.9};
  StopHoming homing_{stops_};
  Vec2 arms_ = middle_, lost_{0.4, -0.3};
  std::int64_t now_ns_ = 0;
};

TEST_F(Homing, FindsTheStopsWhereverCountingBegan) {
  lead(stops_, 0.3);
  lead(stops_, 2);
  EXPECT_FALSE(homing_.is_homed()) << "it may be resting anywhere";
  lead(middle_, 0.3);
  lead(middle_, 1);
  EXPECT_FALSE(homing_.is_homed());
  lead(stops_, 0.3);
  lead(stops_, 0.3);
  EXPECT_FALSE(homing_.is_homed());
  lead(stops_, 0.3);
  ASSERT_TRUE(homing_.is_homed());
  EXPECT_LT((homing_.angles(middle_ - lost_) - middle_).norm(), 0.01);
  EXPECT_EQ(homing_.beyond(stops_ - lost_), 0);
}

TEST_F(Homing, NeedsBothArms) {
  for (const Vec2& one : {Vec2(middle_[0], stops_[1]), Vec2(stops_[0], middle_[1])}) {
    arms_ = stops_;
    homing_.restart();
    lead(one, 0.3);
    lead(stops_, 0.3);
    lead(stops_, 1);
    EXPECT_FALSE(homing_.is_homed());
  }
}

TEST_F(Homing, DetectsArmsThatWereNotInTheirStops) {
  const Vec2 short_of(2.6, 0.5);
  lead(short_of, 0.3);
  lead(middle_ - Vec2(0.2, -0.2), 0.3);
  lead(short_of, 0.3);
  lead(short_of, 1);
  ASSERT_TRUE(homing_.is_homed());
  EXPECT_EQ(homing_.beyond(short_of - lost_), 0);
  EXPECT_NEAR(homing_.beyond(stops_ - lost_), 0.3, 0.01);
}

// ---- the driver on an emulated board ----

class TwoDiy : public testing::Test {
 protected:
  TwoDiy() { in_real_time(); }

  TwoDiyBench bench_;
  DeviceState state_;
  const Vec3 force_{0.5, 1, 0};

  /// Returns a driver whose board pulls.
  std::unique_ptr<TwoDiyDriver> pulling() {
    auto driver = bench_.driver();
    pull(*driver);
    EXPECT_TRUE(state_.ready);
    return driver;
  }

  /// Exchanges until the board pulls: a late round sends zero torque, and so does a guardian if the test is delayed.
  void pull(TwoDiyDriver& driver) {
    for (int k = 0; k < 200 && bench_.board->torque() < 0.01; ++k) answered(driver, force_, state_);
    EXPECT_GT(bench_.board->torque(), 0.01);
  }

  /// Injects a fault, then exchanges under force while a hand holds the arms still. Expects zero torque before any
  /// force returns.
  void suffer(TwoDiyDriver& driver, const std::function<void()>& fault) {
    const PantographKinematics kinematics(bench_.truth.geometry);
    bench_.board->hold_arms(kinematics.at_position(bench_.truth.to_mechanism(state_.position))->angles);
    answered(driver, force_, state_);
    const Vec3 before = state_.position;
    fault();
    int failed = 0;
    for (int k = 0; k < 40; ++k) {
      if (!driver.round({force_, Vec3::Zero()}, state_)) {
        ++failed;
        if (!driver.round({force_, Vec3::Zero()}, state_)) continue;
        EXPECT_EQ(bench_.board->torque(), 0) << "calmed first";
      }
      EXPECT_LT((state_.position - before).norm(), 1e-3) << "the position did not jump";
    }
    EXPECT_GT(failed, 0) << "the fault was noticed";
  }
};

TEST_F(TwoDiy, PullsAlongTheCommandedForce) {
  const auto driver = pulling();
  const Vec3 before = state_.position;
  for (int k = 0; k < 30; ++k) {
    answered(*driver, Vec3(0, 1, 0), state_);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_GT(state_.position.y() - before.y(), 1e-4);
  EXPECT_EQ(state_.position.z(), 0);
}

TEST_F(TwoDiy, UnderstandsFirmwareThatAnswersWithVelocitiesToo) {
  for (const bool velocities : {false, true}) {
    TwoDiyBench bench(two_diy_calibration("gen3", "test"), velocities);
    const auto driver = bench.driver();
    for (int k = 0; k < 200 && bench.board->torque() < 0.01; ++k) answered(*driver, force_, state_);
    EXPECT_GT(bench.board->torque(), 0.01);
    EXPECT_TRUE(state_.ready);
    // A lost byte, anywhere in an answer, costs one round but not the reference.
    const int setups = bench.board->setups(), bytes = velocities ? 17 : 9;
    for (int place = 0; place < bytes; ++place) {
      bench.line->inject(Way::to_host, Fault::lose_byte, place);
      for (int k = 0; k < 5; ++k) answered(*driver, Vec3::Zero(), state_);
    }
    EXPECT_EQ(bench.board->setups(), setups);
    EXPECT_TRUE(state_.ready);
    driver->release();
    EXPECT_EQ(bench.board->torque(), 0);
  }
}

TEST_F(TwoDiy, LosesAByteOfAnAnswerAndKeepsItsReference) {
  const auto driver = pulling();
  const int setups = bench_.board->setups();
  for (int place = 0; place < 9; ++place)
    suffer(*driver, [&] { bench_.line->inject(Way::to_host, Fault::lose_byte, place); });
  EXPECT_EQ(bench_.board->setups(), setups);
  EXPECT_TRUE(state_.ready);
  pull(*driver);  // the board pulls again
}

TEST_F(TwoDiy, LosesAByteOfATorqueAndKeepsItsReference) {
  const auto driver = pulling();
  const int setups = bench_.board->setups();
  for (int place = 1; place < 10; ++place)
    suffer(*driver, [&] { bench_.line->inject(Way::to_board, Fault::lose_byte, place); });
  EXPECT_EQ(bench_.board->setups(), setups);
  EXPECT_TRUE(state_.ready);
}

TEST_F(TwoDiy, IgnoresGarbageInAnAnswer) {
  const auto driver = pulling();
  suffer(*driver, [&] { bench_.line->inject(Way::to_host, Fault::insert_garbage, 2); });
  EXPECT_TRUE(state_.ready);
}

TEST_F(TwoDiy, RejectsAnAngleThatNoArmCanHaveReached) {
  const auto driver = pulling();
  // Byte 4 is the last byte of the first angle; the flipped bit belongs to its exponent.
  suffer(*driver, [&] { bench_.line->inject(Way::to_host, Fault::flip_bit, 4); });
  EXPECT_TRUE(state_.ready);
}

TEST_F(TwoDiy, WithholdsForceFromARestartedBoardUntilItsArmsWereInTheirStops) {
  const auto driver = pulling();
  const Vec3 before = state_.position;
  bench_.line->power_cycle();
  wait_until([&] { return bench_.board->torque() == 0; });
  bool noticed = false;
  for (int k = 0; k < 100 && !noticed; ++k) noticed = driver->round({force_, Vec3::Zero()}, state_) && !state_.ready;
  ASSERT_TRUE(noticed);
  EXPECT_EQ(state_.position, before) << "it stands still";
  EXPECT_EQ(bench_.board->setups(), 2);
  for (int k = 0; k < 20; ++k) answered(*driver, force_, state_);
  EXPECT_FALSE(state_.ready);
  EXPECT_EQ(bench_.board->torque(), 0);

  const Vec2 stops = bench_.truth.stops();
  const auto lead = [&](const Vec2& arms) {
    bench_.board->hold_arms(arms);
    std::this_thread::sleep_for(2ms);
    for (int k = 0; k < 2; ++k) answered(*driver, force_, state_);
  };
  for (int k = 0; k <= 20; ++k) lead(stops + 0.03 * k * Vec2(-1, 1));
  EXPECT_FALSE(state_.ready);
  for (int k = 20; k >= 0; --k) lead(stops + 0.03 * k * Vec2(-1, 1));
  for (int k = 0; k < 2000 && !state_.ready; ++k) lead(stops);
  ASSERT_TRUE(state_.ready);
  for (int k = 0; k <= 10; ++k) lead(stops + 0.03 * k * Vec2(-1, 1));
  const Vec2 inside = stops + Vec2(-0.3, 0.3);
  const auto truth = PantographKinematics(bench_.truth.geometry).at_angles(inside);
  EXPECT_LT((state_.position - bench_.truth.to_world(truth->position)).norm(), 1e-3);
  pull(*driver);
}

TEST_F(TwoDiy, ContinuesAfterItsGuardianStoppedTheMotorsForADelayedHost) {
  const auto driver = pulling();
  const int setups = bench_.board->setups();
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
  pull(*driver);
  EXPECT_TRUE(state_.ready);
  EXPECT_EQ(bench_.board->setups(), setups) << "its encoders were kept";
}

TEST_F(TwoDiy, IsNotReadyBeforeItsArmsWereInTheirStops) {
  const auto driver = bench_.driver(false);
  EXPECT_THAT(driver->info().notes, testing::ElementsAre(HasSubstr("into their stops")));
  for (int k = 0; k < 50; ++k) answered(*driver, force_, state_);
  EXPECT_FALSE(state_.ready);
  EXPECT_EQ(bench_.board->torque(), 0);
}

TEST_F(TwoDiy, ReportsThatItsArmsWereNotInTheirStops) {
  const auto driver = pulling();
  const PantographKinematics kinematics(bench_.truth.geometry);
  const Vec2 from = kinematics.at_position(bench_.truth.to_mechanism(state_.position))->angles,
             to = bench_.truth.stops() + Vec2(0.2, 0);
  const std::string error = error_of(
      [&] {
        for (int k = 0; k < 1000; ++k) {
          bench_.board->hold_arms(from + (to - from) * std::min(k, 200) / 200);
          (void)driver->round({Vec3::Zero(), Vec3::Zero()}, state_);
          std::this_thread::sleep_for(1ms);
        }
      },
      Error::Kind::device);
  EXPECT_THAT(error, testing::AllOf(HasSubstr("beyond its stop"), HasSubstr("press them into their stops")));
}

TEST_F(TwoDiy, IsStoppedByItsGuardianWhileARoundDoesNotReturn) {
  const auto driver = pulling();
  EXPECT_EQ(driver->emergency_stop(), ZeroForce::sent);
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
}

TEST_F(TwoDiy, EndsWithZeroTorqueHoweverItIsClosed) {
  EXPECT_EQ(pulling()->release(), ZeroForce::confirmed);
  EXPECT_EQ(bench_.board->torque(), 0);
  pulling().reset();
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
  // This also holds if the host's last message is cut off or bytes of the next one are lost.
  auto driver = pulling();
  for (const int place : {0, 3, 11, 15}) {
    bench_.line->inject(Way::to_board, Fault::lose_byte, place);
    bench_.line->inject(Way::to_board, Fault::lose_byte, place);
    EXPECT_EQ(driver->release(), ZeroForce::confirmed) << place;
    EXPECT_EQ(bench_.board->torque(), 0) << place;
    driver.reset();
    driver = pulling();
  }
}

TEST_F(TwoDiy, IsLostWithCauseAndRemedyWhenItsCableIsOutOrItFallsSilent) {
  for (const bool unplugged : {false, true}) {
    TwoDiyBench bench;
    ThreadedDevice device(bench.driver());
    exchange(device, force_, 1e-3);
    wait_until([&] { return bench.board->torque() > 0.01; });
    if (unplugged)
      bench.line->unplug();
    else
      bench.line->fall_silent(true);
    wait_until([&] { return device.exchange({force_, Vec3::Zero()}, 1e-3, state_) == Device::Status::lost; });
    EXPECT_EQ(device.exchange({force_, Vec3::Zero()}, 1e-3, state_), Device::Status::lost);
    EXPECT_THAT(device.lost_reason(), HasSubstr("cable")) << unplugged;
    EXPECT_EQ(device.zero_force(), ZeroForce::failed) << "nobody heard that the torques are zero";
  }
}

TEST_F(TwoDiy, IsOpenedAgainToRemoveTheForceUnderWhichItWasLost) {
  const std::string text = fmt::format("haply2diy:port={},homed=true", bench_.line->path());
  auto device = open_device(text);
  EXPECT_TRUE(can_be_zeroed_again(device->info()));
  wait_until([&] {
    (void)device->exchange({force_, Vec3::Zero()}, 1e-3, state_);
    return bench_.board->torque() > 0.01;
  });
  bench_.line->fall_silent(true);
  wait_until([&] { return device->exchange({force_, Vec3::Zero()}, 1e-3, state_) == Device::Status::lost; });
  EXPECT_EQ(device->zero_force(), ZeroForce::failed);
  device->close();
  bench_.line->fall_silent(false);
  EXPECT_EQ(zero_when_back(device->info()), ZeroForce::confirmed);
  EXPECT_EQ(bench_.board->torque(), 0);
}

TEST_F(TwoDiy, IsReportedToHoldItsForceIfItDoesNotComeBack) {
  const auto device = open_device(fmt::format("haply2diy:port={},homed=true", bench_.line->path()));
  wait_until([&] {
    (void)device->exchange({force_, Vec3::Zero()}, 1e-3, state_);
    return bench_.board->torque() > 0.01;
  });
  bench_.line->unplug();
  wait_until([&] { return device->exchange({force_, Vec3::Zero()}, 1e-3, state_) == Device::Status::lost; });
  device->close();
  EXPECT_EQ(zero_when_back(device->info()), ZeroForce::failed);
}

TEST_F(TwoDiy, IsLeftWithoutTorqueWhenItsHostStopsExchanging) {
  ThreadedDevice device(bench_.driver());
  exchange(device, force_, 1e-3);
  wait_until([&] { return bench_.board->torque() > 0.01; });
  EXPECT_GT(bench_.board->torque(), 0.01);
  wait_until([&] { return bench_.board->torque() == 0; });
  EXPECT_EQ(bench_.board->torque(), 0);
}

TEST_F(TwoDiy, LeaksNothingWhenItIsOpenedAndClosedManyTimes) {
  bench_.driver()->release();
  const std::size_t before = open_files();
  for (int k = 0; k < 200; ++k) bench_.driver()->release();
  EXPECT_EQ(open_files(), before);
}

TEST(TwoDiyBackend, RefusesOptionsThatContradictEachOther) {
  EXPECT_THAT(open_error("haply2diy:emulated=true,port=/dev/ttyACM0"), HasSubstr("port: an emulated device"));
  EXPECT_THAT(open_error("haply2diy:hand=relaxed"), HasSubstr("hand: this option is for an emulated device"));
  EXPECT_THAT(open_error("haply2diy:homed=yes"), HasSubstr("homed: expected true or false"));
  EXPECT_THAT(open_error("haply2diy:generation=gen9"), HasSubstr("gen9"));
  EXPECT_THAT(open_error("haply2diy:emulated=true,preset=planar"), HasSubstr("which the arms of the emulated 2DIY"));
  EXPECT_THAT(open_error("haply2diy:port=/dev/ttyACM999", Error::Kind::device), HasSubstr("/dev/ttyACM999: No such"));
}

}  // namespace
}  // namespace haptrace::test
