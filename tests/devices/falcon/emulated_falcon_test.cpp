#include "devices/falcon/emulated_falcon.h"

#include "devices/falcon/kinematics.h"
#include "devices/loop/clock.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <gmock/gmock.h>
#include <numeric>
#include <thread>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Bytes = std::vector<std::uint8_t>;
using Handshake = EmulatedFalcon::Handshake;
using Request = FalconLink::Request;
using Start = EmulatedFalcon::Start;

LivePlant falcon_plant(const std::string& options = "hand=relaxed,seed=3") {
  return open_live_plant(DeviceSpec::parse("falcon:" + options), "falcon");
}

/// Host of an emulated Falcon, with its own clock.
struct Bench {
  explicit Bench(Start start, const FalconFaults& faults = {}, LivePlant plant = falcon_plant())
      : falcon(calibration, std::move(plant), start, faults) {
    falcon.advance_to(now_ns);
  }

  void control(Request request, std::uint16_t value) {
    EXPECT_EQ(falcon.control(static_cast<std::uint8_t>(request), value, now_ns), Handshake::ok);
  }

  void begin_running() {
    control(Request::latency_timer, 1);
    control(Request::baud, 0x0002);
    control(Request::purge, 1);
    control(Request::purge, 2);
  }

  /// Returns the bytes that arrive within `wait` [s]; stops early at `enough` bytes.
  Bytes read(double wait, std::size_t enough) {
    const std::int64_t end = now_ns + std::llround(1e9 * wait);
    Bytes bytes;
    std::array<std::uint8_t, EmulatedFalcon::kPacket> packet{};
    while (bytes.size() < enough) {
      std::size_t size = 0;
      const Handshake handshake = falcon.in(packet, size, now_ns);
      if (handshake == Handshake::ok) {
        packet_sizes.push_back(size);
        bytes.insert(bytes.end(), packet.begin() + EmulatedFalcon::kStatus,
                     packet.begin() + static_cast<std::ptrdiff_t>(size));
        continue;
      }
      last = handshake;
      if (handshake != Handshake::later || falcon.next_in() > end) break;
      now_ns = std::max(falcon.next_in(), now_ns + 1);
    }
    if (bytes.size() < enough) now_ns = end;
    return bytes;
  }

  Bytes ask(const Bytes& bytes, std::size_t enough, double wait = 0.05) {
    last = falcon.out(bytes, now_ns);
    return read(wait, enough);
  }

  std::optional<FalconReport> exchange(const FalconPacket& packet, double wait = 0.02) {
    const FalconBytes bytes = encode(packet);
    FalconDecoder decoder;
    std::optional<FalconReport> report;
    for (const std::uint8_t byte : ask({bytes.begin(), bytes.end()}, 16, wait))
      if (const auto answer = decoder.push(byte)) report = falcon_report(*answer);
    return report;
  }

  /// Wakes the boot loader; returns whether it answered.
  bool greet(bool with_dtr = true) {
    control(Request::latency_timer, 16);
    control(Request::baud, 0x4138);
    control(Request::line, 8);
    control(Request::modem, 0x0100);
    if (with_dtr) control(Request::modem, 0x0101);
    const Bytes answer = ask({0x0a, 0x43, 0x0d}, 4);
    control(Request::modem, 0x0100);
    control(Request::baud, 0x0015);
    return answer == Bytes{0x0a, 0x44, 0x2c, 0x0d};
  }

  /// Loads firmware; returns whether all echoes were correct.
  bool load(const Bytes& firmware) {
    if (ask({0x41}, 1) != Bytes{0x41}) return false;
    for (std::size_t first = 0; first < firmware.size(); first += 62) {
      const std::size_t count = std::min<std::size_t>(62, firmware.size() - first);
      const Bytes chunk(firmware.begin() + static_cast<std::ptrdiff_t>(first),
                        firmware.begin() + static_cast<std::ptrdiff_t>(first + count));
      if (ask(chunk, count) != chunk) return false;
    }
    return true;
  }

  FalconCalibration calibration;
  FalconKinematics kinematics;
  std::int64_t now_ns = 5'000'000'000;
  EmulatedFalcon falcon;
  Handshake last = Handshake::ok;
  std::vector<std::size_t> packet_sizes;
};

Bytes some_firmware(std::size_t size = 500) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{7});
  return bytes;
}

FalconFaults fault(const char* text) {
  return FalconFaults::parse(text, "test");
}

TEST(EmulatedFalcon, LoadsFirmwareAndRunsItAsLongAsItHasPower) {
  Bench bench(Start::switched_on, fault("power:5:1"));
  EXPECT_FALSE(bench.exchange({})) << "nothing runs yet";
  EXPECT_TRUE(bench.greet());
  EXPECT_TRUE(bench.load(some_firmware()));
  EXPECT_FALSE(bench.falcon.runs());
  bench.begin_running();
  EXPECT_TRUE(bench.falcon.runs());
  EXPECT_TRUE(bench.exchange({{100, 0, 0}, 0}));

  bench.falcon.unplug(bench.now_ns);
  EXPECT_THAT(bench.falcon.motors(), ElementsAre(0, 0, 0));
  EXPECT_EQ(bench.falcon.control(0, 1, bench.now_ns), Handshake::gone);
  bench.falcon.plug_in(bench.now_ns += 500'000'000);
  bench.begin_running();
  EXPECT_TRUE(bench.exchange({}));

  bench.now_ns += 5'000'000'000;
  EXPECT_FALSE(bench.exchange({}));
  bench.now_ns += 1'000'000'000;
  EXPECT_FALSE(bench.exchange({}));
  EXPECT_TRUE(bench.greet() && bench.load(some_firmware()));
  bench.begin_running();
  EXPECT_TRUE(bench.exchange({}));
  EXPECT_EQ(bench.falcon.loadings(), 2);
}

TEST(EmulatedFalcon, IsNotLoadedInAnyOtherWay) {
  Bench asleep(Start::switched_on);
  EXPECT_FALSE(asleep.greet(false)) << "without the modem line";

  Bench too_fast(Start::switched_on);
  EXPECT_TRUE(too_fast.greet());
  too_fast.control(Request::baud, 0x0002);
  EXPECT_FALSE(too_fast.load(some_firmware()));
  EXPECT_FALSE(too_fast.falcon.runs());

  Bench line_high(Start::switched_on);
  EXPECT_TRUE(line_high.greet());
  line_high.control(Request::modem, 0x0101);
  EXPECT_FALSE(line_high.load(some_firmware()));

  Bench nothing(Start::switched_on);
  EXPECT_TRUE(nothing.greet() && nothing.load({}));
  nothing.begin_running();
  EXPECT_FALSE(nothing.falcon.runs());

  EXPECT_EQ(nothing.falcon.control(77, 0, nothing.now_ns), Handshake::stalled);
}

TEST(EmulatedFalcon, SendsFullPacketsAtOnceAndShortOnesWithTheLatencyTimer) {
  Bench bench(Start::switched_on);
  EXPECT_TRUE(bench.greet());
  EXPECT_EQ(bench.ask({0x41}, 1), Bytes{0x41});
  const Bytes chunk = some_firmware(62);
  std::int64_t before = bench.now_ns;
  EXPECT_EQ(bench.ask(chunk, 62), chunk);
  EXPECT_NEAR(1e-9 * static_cast<double>(bench.now_ns - before), 63 * 10 / (3e6 / 21), 1e-5);
  EXPECT_EQ(bench.packet_sizes.back(), 64);
  before = bench.now_ns;
  EXPECT_EQ(bench.ask({1, 2}, 2), (Bytes{1, 2}));
  EXPECT_EQ(bench.now_ns - before, 16'000'000);
  EXPECT_EQ(bench.packet_sizes.back(), 4);
}

TEST(EmulatedFalcon, AnswersWithinAMillisecondAndTheTimeOfTheWire) {
  Bench bench(Start::homed);
  bench.begin_running();
  for (int k = 0; k < 100; ++k) {
    const std::int64_t before = bench.now_ns;
    ASSERT_TRUE(bench.exchange({}));
    const double round = 1e-9 * static_cast<double>(bench.now_ns - before);
    EXPECT_GE(round, 2 * 16 * 10 / 1.5e6 - 1e-6);
    EXPECT_LE(round, 1e-3 + 2 * 16 * 10 / 1.5e6);
    bench.now_ns += 137'000;
  }
  EXPECT_EQ(bench.falcon.packets(), 100);
}

TEST(EmulatedFalcon, ForgetsPurgedBytes) {
  Bench bench(Start::homed);
  bench.begin_running();
  const FalconBytes bytes = encode({});
  EXPECT_EQ(bench.falcon.out(bytes, bench.now_ns), Handshake::ok);
  bench.now_ns += 500'000;
  bench.control(Request::purge, 1);
  EXPECT_THAT(bench.read(0.01, 16), IsEmpty());
  EXPECT_EQ(bench.falcon.out(bytes, bench.now_ns), Handshake::ok);
  bench.control(Request::purge, 2);
  EXPECT_THAT(bench.read(0.01, 16), IsEmpty());
  EXPECT_EQ(bench.falcon.packets(), 1);
}

TEST(EmulatedFalcon, IsHomedByItsUserAndThenReportsItsPositionToACount) {
  Bench bench(Start::loaded);
  bench.begin_running();
  const auto wrong = bench.exchange({});
  ASSERT_TRUE(wrong);
  EXPECT_FALSE(wrong->homed[0] || wrong->homed[1] || wrong->homed[2]);
  for (int k = 0; k < 1000; ++k) ASSERT_TRUE(bench.exchange({}));
  EXPECT_FALSE(bench.exchange({})->is_homed()) << "nobody asked for it";

  int rounds = 0;
  while (!bench.exchange({{}, bench.calibration.homing_flag})->is_homed()) ASSERT_LT(++rounds, 1000);
  for (int k = 0; k < 1000; ++k) {
    const FalconReport report = *bench.exchange({{static_cast<std::int16_t>(k % 100 * 10), 0, 0}, 0});
    const auto truth = bench.kinematics.at_position(bench.calibration.origin + bench.falcon.position());
    ASSERT_TRUE(truth && report.is_homed());
    // The answer is up to 1 ms old, and the handle moves meanwhile.
    if (k > 0 && k % 100 == 0) {
      EXPECT_LT((bench.calibration.angles(report.encoders) - truth->angles).norm(), 0.02);
    }
  }
  for (int k = 0; k < 2000; ++k) (void)bench.exchange({});
  const FalconReport report = *bench.exchange({});
  const auto truth = bench.kinematics.at_position(bench.calibration.origin + bench.falcon.position());
  const Vec3 counts =
      (bench.calibration.angles(report.encoders) - truth->angles).cwiseProduct(bench.calibration.counts_per_rad);
  EXPECT_LE(counts.cwiseAbs().maxCoeff(), 3) << "the hand trembles";
}

TEST(EmulatedFalcon, LetsItsMotorsMoveTheHandleWhileItIsHomed) {
  const TempFolder folder;
  const std::string bare =
      folder.write("bare.json", R"({"mass": 0.5, "max_force": 10, "workspace": {"min": -0.04, "max": 0.04}})");
  const auto place = [&](std::int16_t counts) {
    Bench bench(Start::loaded, fault("unhomed:2"), falcon_plant("spec=" + bare));
    bench.begin_running();
    for (int k = 0; k < 100; ++k) (void)bench.exchange({{counts, counts, counts}, bench.calibration.homing_flag});
    return bench.falcon.position();
  };
  EXPECT_GT((place(500) - place(0)).norm(), 1e-3);
}

TEST(EmulatedFalcon, PushesInTheDirectionOfItsMotorCommands) {
  const TempFolder folder;
  const std::string slow = folder.write(
      "slow.json", R"({"mass": 5, "viscous": 50, "max_force": 10, "workspace": {"min": -0.04, "max": 0.04}})");
  Bench bench(Start::homed, {}, falcon_plant("spec=" + slow));
  bench.begin_running();
  SplitMix64 random(1, 1);
  const auto push = [&](const Vec3& force) {
    const auto pose = bench.kinematics.at_position(bench.calibration.origin + bench.falcon.position());
    ASSERT_TRUE(pose);
    ASSERT_TRUE(bench.exchange({bench.calibration.motors(pose->torques(force)), 0}));
  };
  const auto wait = [&](int tenths) {
    for (; tenths > 0; --tenths) bench.falcon.advance_to(bench.now_ns += 100'000'000);
  };
  double worst = 0, farthest = 0;
  for (int k = 0; k < 100; ++k) {
    const Vec3 force = 8 * Vec3(random.symmetric(), random.symmetric(), random.symmetric()).normalized();
    push(force);
    wait(3);
    push(Vec3::Zero());
    wait(5);
    push(-0.3 * force);
    EXPECT_LT(bench.falcon.force().dot(force), 0);
    worst = std::max(worst, bench.falcon.force().normalized().cross(force.normalized()).norm());
    farthest = std::max(farthest, bench.falcon.position().norm());
  }
  EXPECT_LT(worst, 0.1 * std::numbers::pi / 180);
  EXPECT_GT(farthest, 0.04);
}

TEST(EmulatedFalcon, SaturatesItsMotors) {
  Bench bench(Start::homed);
  bench.begin_running();
  ASSERT_TRUE(bench.exchange({{0, 0, -32767}, 0}));
  const Vec3 force = bench.falcon.force();
  Bench other(Start::homed);
  other.begin_running();
  ASSERT_TRUE(other.exchange({{0, 0, static_cast<std::int16_t>(-other.calibration.max_motor_counts)}, 0}));
  EXPECT_EQ(force, other.falcon.force());
  EXPECT_GT(force.norm(), 3);
}

TEST(EmulatedFalcon, ReportsItsButtonsAndAcceptsItsLights) {
  Bench bench(Start::homed);
  bench.begin_running();
  bench.falcon.press(FalconReport::kForward | FalconReport::kMinus);
  const std::uint8_t lights = bench.calibration.flags({.red = true, .blue = true}, false);
  EXPECT_EQ(bench.exchange({{}, lights})->buttons, FalconReport::kForward | FalconReport::kMinus);
  EXPECT_EQ(bench.falcon.flags(), lights);
}

TEST(EmulatedFalcon, HasEveryRequestedFault) {
  {
    Bench bench(Start::switched_on, fault("bad_echo:2"));
    for (int k = 0; k < 3; ++k) {
      EXPECT_TRUE(bench.greet());
      EXPECT_EQ(bench.load(some_firmware()), k == 2);
    }
    bench.begin_running();
    EXPECT_TRUE(bench.falcon.runs());
  }
  {
    Bench bench(Start::switched_on, fault("bad_start"));
    for (int k = 0; k < 6; ++k) {
      EXPECT_TRUE(bench.greet() && bench.load(some_firmware()));
      bench.begin_running();
      EXPECT_EQ(bench.exchange({}).has_value(), k == 5) << k;
    }
  }
  {
    Bench bench(Start::homed, fault("slow_chip"));
    bench.begin_running();
    (void)bench.exchange({});
    const std::int64_t before = bench.now_ns;
    EXPECT_TRUE(bench.exchange({}));
    EXPECT_EQ(bench.now_ns - before, 16'000'000);
  }
  {
    Bench bench(Start::homed, fault("stall:0.1"));
    bench.begin_running();
    while (bench.exchange({})) {
    }
    EXPECT_EQ(bench.last, Handshake::stalled);
    EXPECT_FALSE(bench.exchange({}));
    bench.falcon.clear_halt(false);
    EXPECT_FALSE(bench.exchange({}));
    bench.falcon.clear_halt(true);
    EXPECT_TRUE(bench.exchange({}));
  }
  {
    Bench bench(Start::homed, fault("hang:0.1"));
    bench.begin_running();
    while (bench.exchange({})) {
    }
    EXPECT_EQ(bench.last, Handshake::later);
  }
  {
    Bench bench(Start::homed, fault("silent:0.1"));
    bench.begin_running();
    while (bench.exchange({})) {
    }
    const auto packets = bench.falcon.packets();
    EXPECT_FALSE(bench.exchange({{5, 0, 0}, 0}));
    EXPECT_EQ(bench.falcon.packets(), packets + 1) << "it hears, and obeys";
    EXPECT_EQ(bench.falcon.motors()[0], 5);
  }
  {
    Bench bench(Start::homed, fault("frozen:0.1"));
    bench.begin_running();
    for (int k = 0; k < 200; ++k) (void)bench.exchange({{-2000, -2000, -2000}, 0});
    const auto before = bench.exchange({{-2000, -2000, -2000}, 0});
    const Vec3 place = bench.falcon.position();
    for (int k = 0; k < 50; ++k) EXPECT_EQ(bench.exchange({{2000, 2000, 2000}, 0})->encoders, before->encoders);
    EXPECT_GT((bench.falcon.position() - place).norm(), 1e-3);
  }
  {
    Bench bench(Start::loaded, fault("unhomed:2"));
    bench.begin_running();
    for (int k = 0; k < 3000; ++k) (void)bench.exchange({{}, bench.calibration.homing_flag});
    EXPECT_THAT(bench.exchange({{}, bench.calibration.homing_flag})->homed, ElementsAre(true, false, true));
  }
  {
    Bench bench(Start::homed, fault("unplug:0.1:0.2"));
    bench.begin_running();
    while (bench.exchange({{9, 9, 9}, 0})) {
    }
    EXPECT_EQ(bench.last, Handshake::gone);
    EXPECT_FALSE(bench.falcon.is_there());
    EXPECT_THAT(bench.falcon.motors(), ElementsAre(0, 0, 0));
    bench.now_ns += 200'000'000;
    bench.falcon.advance_to(bench.now_ns);
    bench.begin_running();
    EXPECT_TRUE(bench.exchange({}) && bench.falcon.is_homed());
  }
}

TEST(EmulatedFalcon, SpoilsTheRequestedNumberOfBytes) {
  for (const char* text : {"lost:0.01", "garbage:0.01", "flipped:0.01"}) {
    Bench bench(Start::homed, fault(text));
    bench.begin_running();
    int answered = 0, right = 0;
    Bench clean(Start::homed);
    clean.begin_running();
    const FalconReport truth = *clean.exchange({});
    for (int k = 0; k < 1000; ++k) {
      const auto report = bench.exchange({}, 2e-3);
      answered += report ? 1 : 0;
      right += report && std::abs(report->encoders[0] - truth.encoders[0]) < 200 ? 1 : 0;
    }
    EXPECT_LT(right, 970) << text;
    EXPECT_GT(right, 700) << text;
  }
}

TEST(EmulatedFalcon, ReadsItsFaultsFromText) {
  const FalconFaults faults = fault("unplug:2:0.5+lost:0.25+bad_start+unhomed:3");
  EXPECT_EQ(faults.unplugged.at, 2);
  EXPECT_EQ(faults.unplugged.lasts, 0.5);
  EXPECT_EQ(faults.lost, 0.25);
  EXPECT_EQ(faults.bad_starts, 5);
  EXPECT_EQ(faults.unhomed, 3);
  EXPECT_EQ(fault("unplug:1").unplugged.lasts, FalconFaults::kNever);

  const auto refused = [](const char* text) { return error_of([&] { (void)FalconFaults::parse(text, "here"); }); };
  EXPECT_THAT(refused("unplgu:1"), AllOf(HasSubstr("here"), HasSubstr("did you mean 'unplug'")));
  EXPECT_THAT(refused("unplug"), HasSubstr("expected unplug:AT[:FOR]"));
  for (const char* wrong : {"", "+", "lost:2", "lost:x", "lost:0.1:3", "slow_chip:1", "unhomed:4", "unplug:1:2:3",
                            "unplug:", "unplug:1:", "stall:-1", "lost:nan", "stall:1++hang:1"})
    EXPECT_THAT(refused(wrong), HasSubstr("here")) << wrong;
  for (const char* name : {"unplug:AT[:FOR]", "slow_chip", "unhomed[:LEG]"})
    EXPECT_THAT(FalconFaults::help(), HasSubstr(name));
}

std::unique_ptr<FalconLink> open_link(const std::string& options) {
  return open_emulated_falcon_link(DeviceSpec::parse("falcon:emulated=true" + options), {});
}

bool answers(FalconLink& link) {
  EXPECT_TRUE(link.write(encode({}), 0.1));
  Bytes bytes(64);
  std::size_t count = 0;
  while (count < 16) {
    const std::size_t more = link.read(std::span(bytes).subspan(count), 0.1);
    if (more == 0) return false;
    count += more;
  }
  return count == 16 && bytes[0] == '<' && bytes[15] == '>';
}

TEST(EmulatedFalconLink, ExchangesPacketsInRealTime) {
  in_real_time();
  const auto link = open_link(",hand=relaxed,seed=3");
  link->control(Request::latency_timer, 1);
  link->control(Request::baud, 0x0002);
  for (int k = 0; k < 50; ++k) EXPECT_TRUE(answers(*link));
  Bytes none(16);
  const std::int64_t before = monotonic_ns();
  EXPECT_EQ(link->read(none, 0.02), 0);
  EXPECT_GE(monotonic_ns() - before, 20'000'000);
  link->close();
  EXPECT_THAT(error_of([&] { link->control(Request::purge, 1); }, Error::Kind::device), HasSubstr("closed"));
}

TEST(EmulatedFalconLink, IsTheSameDeviceAgainAfterItsCableWasUnplugged) {
  in_real_time();
  const std::string fault = ",fault=unplug:0.05:0.1";
  auto link = open_link(fault);
  EXPECT_THAT(error_of([&] { (void)open_link(fault); }, Error::Kind::device), HasSubstr("already open"));
  link->control(Request::latency_timer, 1);
  link->control(Request::baud, 0x0002);
  EXPECT_THAT(error_of(
                  [&] {
                    while (answers(*link)) {
                    }
                  },
                  Error::Kind::device),
              HasSubstr("cable is unplugged"));
  link->close();
  EXPECT_THAT(error_of([&] { (void)open_link(fault); }, Error::Kind::device), HasSubstr("cable is unplugged"));
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  link = open_link(fault);
  link->control(Request::latency_timer, 1);
  link->control(Request::baud, 0x0002);
  EXPECT_TRUE(answers(*link));
}

TEST(EmulatedFalconLink, RefusesFaultsThatItDoesNotKnow) {
  EXPECT_THAT(error_of([] { (void)open_link(",fault=rust"); }), HasSubstr("there is no fault 'rust'"));
}

}  // namespace
}  // namespace haptrace::test
