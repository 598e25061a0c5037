#include "devices/hapkit/hapkit.h"

#include "base/json_reader.h"
#include "devices/hapkit/hapkit_board.h"
#include "tests/devices/serial/support.h"
#include "tests/support/real_time.h"

#include <random>

extern "C" unsigned hapkit_c_round_trip(unsigned char kind, unsigned sequence, long position, int duty,
                                        unsigned char* bytes);

namespace haptrace::test {
namespace {

using testing::HasSubstr;
using Fault = EmulatedLine::Fault;
using Way = EmulatedLine::Way;
using Packet = std::array<std::uint8_t, HAPKIT_PACKET_SIZE>;

Packet packet_of(hapkit_kind kind, std::uint16_t sequence, std::int16_t duty = 0, std::int32_t position = 0) {
  hapkit_packet packet{};
  packet.kind = static_cast<std::uint8_t>(kind);
  packet.version = HAPKIT_VERSION;
  packet.sequence = sequence;
  packet.duty = duty;
  packet.position = position;
  Packet bytes{};
  hapkit_encode(&packet, bytes.data());
  return bytes;
}

TEST(HapkitPacket, HasTheStandardChecksum) {
  const char* const text = "123456789";
  EXPECT_EQ(hapkit_crc(reinterpret_cast<const std::uint8_t*>(text), 9), 0x29b1);
}

TEST(HapkitPacket, IsTheSameInCAndInCpp) {
  Packet c{};
  EXPECT_EQ(hapkit_c_round_trip(HAPKIT_COMMAND, 0xfedc, -123456789, -32767, c.data()), unsigned{HAPKIT_PACKET_SIZE});
  EXPECT_EQ(c, packet_of(HAPKIT_COMMAND, 0xfedc, -32767, -123456789));
  // The packet in the manual.
  EXPECT_EQ(packet_of(HAPKIT_COMMAND, 7, HapkitCalibration{}.duty(0.5)),
            (Packet{0xa5, 3, 7, 0, 0, 0, 0, 0, 0xc0, 0x28, 0, 1, 0xbb, 0xa6}));
  const Packet spelled{0xa5, 3, 0xdc, 0xfe, 0xeb, 0x32, 0xa4, 0xf8, 0x01, 0x80, 0, 1, c[12], c[13]};
  EXPECT_EQ(c, spelled);
}

TEST(HapkitPacket, IsFoundAfterAnyBytesAndRejectedIfABitIsWrong) {
  std::mt19937 random(5);
  hapkit_decoder decoder{};
  hapkit_packet found{};
  for (int k = 0; k < 2000; ++k) {
    for (std::size_t garbage = random() % 20; garbage > 0; --garbage) {
      const bool sync = random() % 4 == 0;
      (void)hapkit_decode(&decoder, sync ? HAPKIT_SYNC : static_cast<std::uint8_t>(random()), &found);
    }
    const auto duty = static_cast<std::int16_t>(random());
    const auto position = static_cast<std::int32_t>(random());
    Packet bytes = packet_of(HAPKIT_STATE, static_cast<std::uint16_t>(k), duty, position);
    if (k % 2 == 0) {  // a burst of up to 16 bits never passes
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
      for (const std::uint8_t byte : bytes) ASSERT_EQ(hapkit_decode(&decoder, byte, &found), 0) << k;
      continue;
    }
    int packets = 0;
    for (const std::uint8_t byte : bytes) packets += hapkit_decode(&decoder, byte, &found);
    ASSERT_EQ(packets, 1) << k;
    ASSERT_EQ(found.position, position);
    ASSERT_EQ(found.duty, duty);
    ASSERT_EQ(found.sequence, static_cast<std::uint16_t>(k));
  }
}

/// Runs the board's own logic on the test's clock.
class HapkitBoard : public testing::Test {
 protected:
  hapkit_packet say(hapkit_kind kind, std::int16_t duty = 0) {
    Packet answer{};
    int answers = 0;
    for (const std::uint8_t byte : packet_of(kind, ++sequence_, duty))
      answers += hapkit_receive(&board_, byte, now_ms_, 77, answer.data());
    EXPECT_EQ(answers, 1);
    hapkit_decoder decoder{};
    hapkit_packet packet{};
    int found = 0;
    for (const std::uint8_t byte : answer) found += hapkit_decode(&decoder, byte, &packet);
    EXPECT_EQ(found, 1);
    EXPECT_EQ(packet.sequence, sequence_);
    EXPECT_EQ(packet.position, 77);
    return packet;
  }

  hapkit_board board_{};
  std::uint16_t sequence_ = 0;
  std::uint32_t now_ms_ = 0xffffffff - 20;  // wraps around soon
};

TEST_F(HapkitBoard, ObeysNoHostThatDidNotGreetIt) {
  const hapkit_packet state = say(HAPKIT_COMMAND, 1000);
  EXPECT_EQ(state.duty, 0);
  EXPECT_EQ(state.flags & HAPKIT_GREETED, 0);
  EXPECT_EQ(hapkit_duty(&board_, now_ms_), 0);
  EXPECT_EQ(say(HAPKIT_HELLO).kind, HAPKIT_WELCOME);
  EXPECT_EQ(say(HAPKIT_COMMAND, 1000).duty, 1000);
  EXPECT_EQ(say(HAPKIT_HELLO).duty, 0) << "a new host begins without force";
}

TEST_F(HapkitBoard, SwitchesItsMotorOffWithoutCommands) {
  say(HAPKIT_HELLO);
  for (int k = 0; k < 100; ++k, ++now_ms_) {
    EXPECT_EQ(say(HAPKIT_COMMAND, -20000).flags, HAPKIT_GREETED);
    EXPECT_EQ(hapkit_duty(&board_, now_ms_ + HAPKIT_WATCHDOG_MS - 1), -20000);
  }
  now_ms_ += HAPKIT_WATCHDOG_MS;
  EXPECT_EQ(hapkit_duty(&board_, now_ms_), 0);
  EXPECT_EQ(say(HAPKIT_COMMAND, 5).flags, HAPKIT_GREETED | HAPKIT_TRIPPED) << "and says so once";
  EXPECT_EQ(say(HAPKIT_COMMAND, 5).flags, HAPKIT_GREETED);
}

TEST(HapkitSensor, ContinuesToCountWhereItsReadingWraps) {
  hapkit_sensor sensor{};
  const auto turn_to = [&sensor](int turned) {
    const int raw = turned + HAPKIT_SENSOR_MIDDLE;
    const int reading = (raw % HAPKIT_SENSOR_PERIOD + HAPKIT_SENSOR_PERIOD) % HAPKIT_SENSOR_PERIOD;
    return hapkit_position(&sensor, static_cast<std::int16_t>(reading));
  };
  int turned = 0;
  for (; turned < 5000; turned += 300) ASSERT_EQ(turn_to(turned), turned);
  for (; turned > -5000; turned -= 333) ASSERT_EQ(turn_to(turned), turned);
}

TEST(HapkitCalibration, TurnsForceIntoDutyAndBack) {
  HapkitCalibration kit;
  EXPECT_NEAR(kit.max_force(), 0.03 * 0.074 / (0.09 * 0.005), 1e-9);
  for (const double sign : {1.0, -1.0}) {
    kit.motor_sign = sign;
    for (const double force : {-4.0, -0.5, 0.0, 0.02, 1.0, 4.9}) {
      EXPECT_NEAR(kit.force(kit.duty(force)), force, 2e-3);
      EXPECT_GE(sign * force * kit.duty(force), 0);
    }
    EXPECT_NEAR(kit.force(kit.duty(100)), kit.max_force(), 1e-3);
  }
  EXPECT_EQ(kit.duty(kNaN), 0);
  kit.encoder_sign = -1;
  kit.angle_at_zero = 0.1;
  for (const double x : {-0.04, 0.0, 0.03}) EXPECT_NEAR(kit.position(kit.counts(x)), x, 2e-5);
}

TEST(HapkitCalibration, ReadsTheSampleAsItsDefaultsAndRejectsInvalidValues) {
  const HapkitCalibration read = read_hapkit_calibration(load_json(SAMPLE_DEVICES "/hapkit.json"), "sample"), made;
  EXPECT_EQ(read.handle_radius, made.handle_radius);
  EXPECT_EQ(read.sector_radius, made.sector_radius);
  EXPECT_NEAR(read.rad_per_count, made.rad_per_count, 1e-9);
  EXPECT_EQ(read.motor_constant, made.motor_constant);
  EXPECT_EQ(read.stop_angle, made.stop_angle);
  EXPECT_EQ(read.workspace, made.workspace);
  const auto refusal = [](const char* json) {
    return error_of([&] { read_hapkit_calibration(nlohmann::json::parse(json), "my.json"); });
  };
  EXPECT_THAT(refusal(R"({"motor_sign": 0})"), HasSubstr("my.json: motor_sign: a sign is 1 or -1"));
  EXPECT_THAT(refusal(R"({"workspace": 0.2})"), HasSubstr("workspace: 0.2 m is beyond the stops"));
  EXPECT_THAT(refusal(R"({"handle_radius": 90})"), HasSubstr("handle_radius"));
  EXPECT_THAT(refusal(R"({"pulley": 1})"), HasSubstr("pulley"));
}

// ---- the driver on an emulated board ----

class Hapkit : public testing::Test {
 protected:
  Hapkit() { in_real_time(); }

  HapkitBench bench_;
  DeviceState state_;

  std::unique_ptr<HapkitDriver> pulling() {
    auto driver = bench_.driver();
    // The board switches its motor off when the machine delays this thread, even between a round and the check.
    double force = 0;
    for (int k = 0; k < 200 && (force = bench_.board->force()) == 0; ++k) answered(*driver, Vec3(2, 0, 0), state_);
    EXPECT_NEAR(force, 2, 0.01);
    return driver;
  }
};

TEST_F(Hapkit, PullsAlongTheCommandedForce) {
  const auto driver = pulling();
  const double before = state_.position.x();
  for (int k = 0; k < 30; ++k) {
    answered(*driver, Vec3(2, 5, 5), state_);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_GT(state_.position.x() - before, 1e-4);
  EXPECT_EQ(state_.position.tail<2>().norm(), 0);
}

TEST_F(Hapkit, ToleratesDamageOnItsLine) {
  const auto driver = bench_.driver();
  for (const Way way : {Way::to_board, Way::to_host})
    for (const Fault fault : {Fault::lose_byte, Fault::flip_bit, Fault::insert_garbage})
      for (int place = 0; place < HAPKIT_PACKET_SIZE; place += 3) {
        bench_.line->inject(way, fault, place);
        for (int k = 0; k < 4; ++k) answered(*driver, Vec3::Zero(), state_);
        EXPECT_NEAR(state_.position.x(), 0, 1e-3);
      }
}

TEST_F(Hapkit, IsSwitchedOffByItsBoardWhenItsHostIsGone) {
  const auto driver = pulling();
  wait_until([&] { return bench_.board->force() == 0; });
  EXPECT_EQ(bench_.board->force(), 0);
}

TEST_F(Hapkit, EndsWithZeroForce) {
  const auto driver = pulling();
  driver->release();
  EXPECT_EQ(bench_.board->force(), 0);
}

TEST_F(Hapkit, IsLostWithCauseAndRemedyWhenItsBoardRestarts) {
  const auto driver = pulling();
  bench_.line->power_cycle();
  const std::string error = error_of(
      [&] {
        for (int k = 0; k < 100; ++k) (void)driver->round({Vec3(2, 0, 0), Vec3::Zero()}, state_);
      },
      Error::Kind::device);
  EXPECT_THAT(error, testing::AllOf(HasSubstr("restarted"), HasSubstr("Put the handle upright")));
  EXPECT_EQ(bench_.board->force(), 0);
}

TEST_F(Hapkit, IsLostWithCauseAndRemedyWhenItsCableIsOutOrItFallsSilent) {
  for (const bool unplugged : {false, true}) {
    HapkitBench bench;
    ThreadedDevice device(bench.driver());
    exchange(device, Vec3(2, 0, 0), 1e-3);
    if (unplugged)
      bench.line->unplug();
    else
      bench.line->fall_silent(true);
    wait_until([&] { return device.exchange({}, 1e-3, state_) == Device::Status::lost; });
    EXPECT_EQ(device.exchange({}, 1e-3, state_), Device::Status::lost);
    EXPECT_THAT(device.lost_reason(), HasSubstr("cable")) << unplugged;
    wait_until([&] { return bench.board->force() == 0; });
    EXPECT_EQ(bench.board->force(), 0);
  }
}

TEST_F(Hapkit, NamesTheSketchThatItNeeds) {
  bench_.board->speak_version(9);
  EXPECT_THAT(error_of([&] { (void)bench_.driver(); }, Error::Kind::device),
              testing::AllOf(HasSubstr("uses version 9"), HasSubstr("samples/hapkit/hapkit.ino")));
}

TEST_F(Hapkit, ReportsThatNoBoardAnswers) {
  bench_.line->fall_silent(true);
  const HapkitOptions options{.name = "bench", .port = bench_.line->path(), .serial = "", .greeting_patience = 0.2};
  EXPECT_THAT(error_of([&] { const HapkitDriver driver(bench_.truth, options); }, Error::Kind::device),
              testing::AllOf(HasSubstr("no board answers"), HasSubstr("Flash that sketch")));
}

TEST_F(Hapkit, ReportsThatItsHandleWasNotUpright) {
  HapkitCalibration wrong = bench_.truth;
  wrong.angle_at_zero = 0.9;
  HapkitDriver driver(wrong, {.name = "bench", .port = bench_.line->path(), .serial = ""});
  EXPECT_THAT(error_of([&] { answered(driver, Vec3::Zero(), state_); }, Error::Kind::device),
              testing::AllOf(HasSubstr("81 mm from the middle"), HasSubstr("upright")));
}

TEST_F(Hapkit, LeaksNothingWhenItIsOpenedAndClosedAThousandTimes) {
  bench_.driver()->release();
  const std::size_t before = open_files();
  for (int k = 0; k < 1000; ++k) bench_.driver()->release();
  EXPECT_EQ(open_files(), before);
}

}  // namespace
}  // namespace haptrace::test
