#include "devices/falcon/driver.h"

#include "devices/loop/clock.h"
#include "tests/devices/falcon/scripted_link.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <thread>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using Counts = std::array<std::int16_t, 3>;
using Belief = FalconTracker::Verdict;

constexpr std::uint8_t kAllHomed = 0x70;
constexpr Counts kNoForce{};

FalconPacket packet_of(const Bytes& bytes) {
  FalconDecoder decoder;
  std::optional<FalconPacket> packet;
  for (const std::uint8_t byte : bytes)
    if (auto found = decoder.push(byte)) packet = found;
  return packet.value_or(FalconPacket{{-1, -1, -1}, 0});
}

/// Provides running firmware, and a driver for it.
class FalconDriverTest : public testing::Test {
 protected:
  FalconScript script_;
  FalconCalibration calibration_;
  FalconPacket says_{{0, 0, 0}, kAllHomed};  ///< content of every answer

  FalconDriverTest() {
    in_real_time();  // the driver distrusts answers after its process stood still
    script_.on_write = [this](const Bytes&) { script_.say(encode(says_)); };
  }

  std::unique_ptr<FalconDriver> open() {
    return std::make_unique<FalconDriver>(script_.open(), calibration_, falcon_info(calibration_));
  }
  [[nodiscard]] FalconPacket last_sent() const { return packet_of(script_.written.back()); }
  [[nodiscard]] Vec3 place(const Counts& encoders) const {
    return FalconKinematics().at_angles(calibration_.angles(encoders))->position - calibration_.origin;
  }
  /// Returns the force on the hand from the motors of the last packet [N].
  [[nodiscard]] Vec3 force_sent() const {
    const FalconPose pose = *FalconKinematics().at_angles(calibration_.angles(says_.words));
    const Counts sent = last_sent().words;
    const Vec3 torques = Vec3(sent[0], sent[1], sent[2]).cwiseQuotient(calibration_.motor_sign * 10'000);
    return pose.jacobian.transpose().inverse() * torques;
  }
  DeviceState round(FalconDriver& driver, const Vec3& force = Vec3::Zero()) {
    DeviceState state;
    EXPECT_TRUE(driver.round({force, Vec3::Zero()}, state));
    return state;
  }
};

// ---- homing ----

TEST_F(FalconDriverTest, SendsNoForceAndHasNoPositionBeforeAllThreeLegsAreHomed) {
  for (unsigned homed = 0; homed < 7; ++homed) {
    says_ = {{300, -200, 100}, static_cast<std::uint8_t>(homed << 4)};
    const auto driver = open();
    EXPECT_THAT(driver->info().notes, ElementsAre(HasSubstr("pull its grip all the way out")));
    for (std::int16_t k = 0; k < 50; ++k) {
      says_.words = {static_cast<std::int16_t>(20 * k), 7, k};
      says_.flags = static_cast<std::uint8_t>(homed << 4 | 0x5);
      const DeviceState state = round(*driver, Vec3(5, 5, 5));
      ASSERT_FALSE(state.ready);
      ASSERT_EQ(state.position, Vec3::Zero());
      ASSERT_EQ(state.buttons, FalconReport::kPlus | FalconReport::kCentre);
      ASSERT_EQ(last_sent(), (FalconPacket{kNoForce, calibration_.flags({.red = true}, true)}));
    }
  }
}

TEST_F(FalconDriverTest, IsReadyAtOnceWhenItWasHomedBefore) {
  says_.words = {100, 120, 140};
  const auto driver = open();
  const DeviceState state = round(*driver);
  EXPECT_TRUE(state.ready);
  EXPECT_LT((state.position - place(says_.words)).norm(), 1e-9);
  EXPECT_THAT(driver->info().notes, IsEmpty());
}

TEST_F(FalconDriverTest, ShowsNothingOfTheJumpAtHoming) {
  says_ = {{1234, -3000, 9}, 0x30};
  const auto driver = open();
  // It is not known whether the bit or the count changes first.
  for (const bool bit_first : {true, false}) {
    says_ = {{1234, -3000, 9}, 0x30};
    const DeviceState before = round(*driver);
    EXPECT_FALSE(before.ready);
    for (int k = 0; k < 40; ++k) {
      says_.flags = bit_first || k > 3 ? kAllHomed : 0x30;
      if (!bit_first || k > 3) says_.words = {50, 60, 70};
      const DeviceState state = round(*driver, Vec3(3, 0, 0));
      ASSERT_LT((state.position - (state.ready ? place({50, 60, 70}) : before.position)).norm(), 1e-9) << k;
      if (k < FalconTracker::kSettled) {
        ASSERT_FALSE(state.ready) << k;
        ASSERT_EQ(last_sent().words, kNoForce);
      }
    }
    EXPECT_TRUE(round(*driver).ready);
    // Lose the homing again, for the second pass.
    says_.flags = 0x30;
    DeviceState state;
    const std::int64_t end = monotonic_ns() + 100'000'000;
    while (monotonic_ns() < end) {
      (void)driver->round({Vec3(3, 0, 0), Vec3::Zero()}, state);
    }
    EXPECT_FALSE(state.ready);
    EXPECT_LT((state.position - place({50, 60, 70})).norm(), 1e-9);
    EXPECT_EQ(last_sent(), (FalconPacket{kNoForce, calibration_.flags({.red = true}, true)}));
  }
}

// ---- force ----

TEST_F(FalconDriverTest, SendsTheCommandedForceAtEveryPosition) {
  Gaussian random(3, 1);
  for (int k = 0; k < 50; ++k) {
    const Vec3 angles = FalconKinematics().at_position(Vec3(0, 0, 0.12) + 0.01 * random.vector())->angles;
    const Vec3 counts = (angles - calibration_.home_angle).cwiseProduct(calibration_.counts_per_rad);
    says_.words = {falcon_word(counts[0]), falcon_word(counts[1]), falcon_word(counts[2])};
    const auto driver = open();
    const Vec3 force = random.vector();
    (void)round(*driver, force);
    EXPECT_LT((force_sent() - force).norm(), 0.01);  // half a count per motor
  }
}

TEST_F(FalconDriverTest, NeverSendsMoreThanItIsAllowedTo) {
  const auto driver = open();
  for (const double magnitude : {9.0, 100.0, 1e6, 1e300}) {
    for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1), Vec3(0, 0, -1)}) {
      (void)round(*driver, magnitude * way);
      EXPECT_LT(force_sent().norm(), 8.01);
      EXPECT_GT(force_sent().normalized().dot(way), 0.999) << "never reversed";
      for (const std::int16_t word : last_sent().words) EXPECT_LE(std::abs(word), 4095);
    }
  }
  (void)round(*driver, Vec3(kNaN, 1, 1));
  EXPECT_EQ(last_sent().words, kNoForce);
}

TEST_F(FalconDriverTest, LightsItsLogoAccordingToItsState) {
  const auto driver = open();
  (void)round(*driver);
  EXPECT_EQ(last_sent().flags, calibration_.flags({.green = true}, true));
  (void)round(*driver, Vec3(0, 1, 0));
  EXPECT_EQ(last_sent().flags, calibration_.flags({.green = true, .blue = true}, true));
}

TEST_F(FalconDriverTest, LetsGoWithZeroForceAndLightsOff) {
  auto driver = open();
  (void)round(*driver, Vec3(0, 0, 5));
  const std::size_t before = script_.written.size();
  driver->release();
  EXPECT_GT(script_.written.size(), before);
  EXPECT_EQ(last_sent(), FalconPacket{});
  EXPECT_EQ(script_.closed, 1);
  driver->release();
  driver.reset();
  EXPECT_EQ(script_.closed, 1);
}

TEST_F(FalconDriverTest, ReleasesADeviceThatIsGone) {
  const auto driver = open();
  script_.gone = true;
  DeviceState state;
  EXPECT_THAT(error_of([&] { (void)driver->round({}, state); }, Error::Kind::device), HasSubstr("unplugged"));
  driver->release();
  EXPECT_EQ(script_.closed, 1);
}

TEST_F(FalconDriverTest, DescribesItself) {
  calibration_.max_force = 5;
  const DeviceInfo info = open()->info();
  EXPECT_EQ(info.backend, "falcon");
  EXPECT_EQ(info.max_force, 5);
  EXPECT_EQ(info.workspace_max, Vec3::Constant(0.04));
  EXPECT_NEAR(info.position_resolution, 0.041e-3, 0.001e-3);
}

// ---- answers ----

TEST_F(FalconDriverTest, RejectsOneWrongCountAndSendsNoForceForIt) {
  const auto driver = open();
  const Vec3 before = round(*driver, Vec3(2, 0, 0)).position;
  says_.words[1] += 0x1000;
  DeviceState state;
  EXPECT_FALSE(driver->round({Vec3(2, 0, 0), Vec3::Zero()}, state));
  says_.words[1] -= 0x1000;
  EXPECT_EQ(round(*driver, Vec3(2, 0, 0)).position, before);
  EXPECT_EQ(last_sent().words, kNoForce) << "what was sent in doubt";
  (void)round(*driver, Vec3(2, 0, 0));
  EXPECT_NE(last_sent().words, kNoForce);
}

/// Provides firmware whose answers repeat the packet's words, so that an answer shows which packet it belongs to.
class FalconDialogueTest : public testing::Test {
 protected:
  FalconScript script_;
  std::unique_ptr<FalconLink> link_ = script_.open();
  FalconDialogue dialogue_{*link_};

  FalconDialogueTest() {
    in_real_time();
    script_.on_write = [this](const Bytes& bytes) { script_.say(answer(bytes)); };
  }
  static FalconBytes answer(const Bytes& question) { return encode({packet_of(question).words, 0}); }

  std::optional<int> ask(std::int16_t number) {
    const auto report = dialogue_.ask({{number, 0, 0}, 0});
    return report ? std::optional<int>(report->encoders[0]) : std::nullopt;
  }
  void expect_in_step(std::int16_t from) {
    for (std::int16_t k = from; k < from + 20; ++k) ASSERT_EQ(ask(k), k);
  }
};

TEST_F(FalconDialogueTest, FindsTheAnswerInPiecesAndGarbage) {
  script_.on_write = [this](const Bytes& bytes) {
    const FalconBytes whole = answer(bytes);
    script_.line.push_back({'<', 'A', '>', '<'});
    script_.line.emplace_back(whole.begin(), whole.begin() + 5);
    script_.line.emplace_back(whole.begin() + 5, whole.end());
  };
  expect_in_step(1);
}

TEST_F(FalconDialogueTest, IsInStepAgainAfterAnAnswerThatNeverCame) {
  const auto answers = script_.on_write;
  for (const int lost : {1, 2, 30}) {
    script_.on_write = [](const Bytes&) {};
    for (int k = 0; k < lost; ++k) EXPECT_EQ(ask(7), std::nullopt);
    script_.on_write = answers;
    expect_in_step(100);
  }
}

TEST_F(FalconDialogueTest, IsInStepAgainAfterAnswersThatCameLate) {
  const auto answers = script_.on_write;
  std::deque<Bytes> late;
  for (int behind = 1; behind < 4; ++behind) {
    // Hold `behind` answers back and deliver them with a later write, like a slow line.
    script_.on_write = [&](const Bytes& bytes) {
      const FalconBytes whole = answer(bytes);
      late.emplace_back(whole.begin(), whole.end());
    };
    for (std::int16_t k = 0; k < behind; ++k) EXPECT_EQ(ask(k), std::nullopt);
    script_.on_write = [&](const Bytes& bytes) {
      for (; !late.empty(); late.pop_front()) script_.line.push_back(late.front());
      script_.say(answer(bytes));
    };
    expect_in_step(200);
  }
}

TEST_F(FalconDialogueTest, IgnoresUnrequestedBytes) {
  script_.say(encode({{999, 0, 0}, 0}));
  script_.line.push_back({'<', 'A', 'A'});
  EXPECT_EQ(ask(5), 5);
  script_.say(encode({{998, 0, 0}, 0}));
  script_.say(encode({{997, 0, 0}, 0}));
  expect_in_step(10);
}

TEST_F(FalconDialogueTest, RejectsAnswersFromBeforeItsProcessStoodStill) {
  const auto answers = script_.on_write;
  script_.on_write = [&](const Bytes& bytes) {
    answers(bytes);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    for (std::int16_t late = 900; late < 909; ++late)
      script_.say(encode({{late, 0, 0}, 0}));  // answers to a guardian's packets
  };
  EXPECT_EQ(ask(1), std::nullopt);
  script_.on_write = answers;
  expect_in_step(10);
}

// Other firmware may look for packets in another way than our decoder. No variant may keep the host's force.
TEST(FalconLastWords, RemoveTheForceWhereverTheHostsLastPacketBrokeOff) {
  const FalconBytes push = encode({{4095, -4095, 1234}, 0x7f});
  const auto words = falcon_last_words({});
  for (const auto& last : {words.when_silent, words.when_dead})
    for (std::size_t sent = 0; sent <= push.size(); ++sent) {
      Bytes line(push.begin(), push.begin() + static_cast<std::ptrdiff_t>(sent));
      line.insert(line.end(), last.begin(), last.end());
      std::optional<FalconPacket> by_end, by_count;
      FalconDecoder decoder;
      for (const std::uint8_t byte : line)
        if (const auto packet = decoder.push(byte)) by_end = packet;
      for (std::size_t i = 0; i + push.size() <= line.size(); ++i) {
        if (line[i] != '<') continue;
        FalconDecoder whole;
        for (std::size_t k = 0; k < push.size(); ++k)
          if (const auto packet = whole.push(line[i + k])) by_count = packet;
        i += push.size() - 1;
      }
      ASSERT_TRUE(by_end && by_count) << sent;
      EXPECT_EQ(by_end->words, (std::array<std::int16_t, 3>{})) << sent;
      EXPECT_EQ(by_count->words, (std::array<std::int16_t, 3>{})) << sent;
    }
}

TEST_F(FalconDialogueTest, LosesOneRoundForADamagedAnswer) {
  const auto answers = script_.on_write;
  for (std::size_t place = 0; place < 16; ++place) {
    script_.on_write = [&](const Bytes& bytes) {
      const FalconBytes whole = answer(bytes);
      Bytes damaged(whole.begin(), whole.end());
      damaged.erase(damaged.begin() + static_cast<std::ptrdiff_t>(place));
      script_.line.push_back(damaged);
    };
    EXPECT_EQ(ask(3), std::nullopt);
    script_.on_write = answers;
    expect_in_step(20);
  }
}

TEST_F(FalconDialogueTest, ContinuesWhenAPacketCouldNotBeSent) {
  script_.takes = false;
  EXPECT_EQ(ask(1), std::nullopt);
  script_.takes = true;
  expect_in_step(2);
}

// ---- plausible positions ----

/// Provides reports at 1 kHz.
class FalconTrackerTest : public testing::Test {
 protected:
  FalconTracker tracker_{FalconCalibration()};
  std::int64_t now_ns_ = 5'000'000'000;

  Belief take(const Counts& encoders, std::uint8_t flags = kAllHomed, double later = 1e-3) {
    now_ns_ += static_cast<std::int64_t>(1e9 * later);
    return tracker_.take(falcon_report({encoders, flags}), now_ns_ - 500'000, now_ns_);
  }
  void home(const Counts& encoders = {}) {
    for (int k = 0; k < FalconTracker::kSettled; ++k) (void)take(encoders);
    ASSERT_EQ(take(encoders), Belief::believed);
  }
  std::string lost(const Counts& encoders, std::uint8_t flags = kAllHomed) {
    return error_of(
        [&] {
          for (int k = 0; k < 100; ++k) EXPECT_EQ(take(encoders, flags), Belief::doubted);
        },
        Error::Kind::device);
  }
};

TEST_F(FalconTrackerTest, FollowsAHandThatMovesAsFastAsHandsDo) {
  home();
  // 2 m/s are 50 counts per millisecond; longer rounds bring larger steps.
  for (const double step : {1e-3, 2e-3, 10e-3}) {
    for (int k = 0; k < 200; ++k) {
      const auto count = static_cast<std::int16_t>(600 * std::sin(2 * std::numbers::pi * 12 * k * step));
      ASSERT_EQ(take({count, count, count}, kAllHomed, step), Belief::believed) << count;
    }
    (void)take({}, kAllHomed, 0.1);
  }
}

TEST_F(FalconTrackerTest, DoubtsEveryFlipOfABitThatIsMoreThanAHandCanDo) {
  home();
  for (int leg = 0; leg < 3; ++leg) {
    for (unsigned bit = 9; bit < 16; ++bit) {
      Counts flipped{};
      flipped[static_cast<std::size_t>(leg)] = static_cast<std::int16_t>(1U << bit);
      ASSERT_EQ(take(flipped), Belief::doubted) << "leg " << leg << ", bit " << bit;
      ASSERT_EQ(take({}), Belief::believed);
    }
  }
  for (const unsigned flags : {0x60U, 0x50U, 0x30U, 0x0U}) {
    ASSERT_EQ(take({}, static_cast<std::uint8_t>(flags)), Belief::doubted);
    ASSERT_EQ(take({}), Belief::believed);
  }
}

TEST_F(FalconTrackerTest, IsLostWhenAJumpPersistsHoweverLongItWaits) {
  for (const int jump : {400, 1000, 3000, -20'000, 32'767}) {
    tracker_ = FalconTracker(FalconCalibration());
    home();
    EXPECT_THAT(lost({0, static_cast<std::int16_t>(jump), 0}),
                AllOf(HasSubstr(fmt::format("from 0, 0, 0 to 0, {}, 0 counts", jump)), HasSubstr("home it again")));
  }
}

TEST_F(FalconTrackerTest, IsLostAtAnglesWithoutAHandlePosition) {
  home();
  // A hand can move in such steps.
  std::string why;
  for (int step = 0; step < 80 && why.empty(); ++step) {
    const auto count = static_cast<std::int16_t>(50 * step);
    const Counts counts{count, static_cast<std::int16_t>(-count), 0};
    if (take(counts) == Belief::doubted) why = lost(counts);
  }
  EXPECT_THAT(why,
              AllOf(HasSubstr("degrees, and no position of the handle has these angles"), HasSubstr("home_angle")));
}

TEST_F(FalconTrackerTest, IsNoLongerHomedWhenTheReportsKeepStatingIt) {
  home({40, 50, 60});
  double doubted = 0;
  while (take({40, 50, 60}, 0x30) == Belief::doubted) doubted += 1e-3;
  EXPECT_NEAR(doubted, FalconTracker::kPatience, 2e-3);
  EXPECT_EQ(tracker_.pose(), nullptr);
  EXPECT_EQ(take({40, 50, 60}, 0x30), Belief::unhomed);
  home({1, 2, 3});
}

TEST_F(FalconTrackerTest, WaitsUntilTheCountsOfHomedLegsHaveSettled) {
  for (int k = 0; k < 100; ++k)
    ASSERT_EQ(take({static_cast<std::int16_t>(k % 5 == 0 ? 2000 : 0), 0, 0}), Belief::unhomed);
  EXPECT_EQ(tracker_.pose(), nullptr);
  home();
}

TEST(FalconEncoderWatchTest, NoticesAnEncoderThatStandsStillWhileItsMotorPushes) {
  const auto watch = [](const auto& encoder, const auto& motor) {
    FalconEncoderWatch watched(4000);
    return error_of(
        [&] {
          for (int k = 0; k < 5000; ++k)
            watched.take({static_cast<std::int16_t>(k % 7), encoder(k), static_cast<std::int16_t>(k % 9)},
                         {4000, motor(k), -4000}, 1'000'000 * (k + 1LL));
        },
        Error::Kind::device);
  };
  const auto still = [](int) { return std::int16_t{77}; };
  const auto swings = [](int k) { return static_cast<std::int16_t>(1200 * std::sin(0.01 * k)); };
  EXPECT_THAT(watch(still, swings), HasSubstr("encoder of leg 2 stays at 77"));
  EXPECT_EQ(watch([](int k) { return static_cast<std::int16_t>(k / 400); }, swings), "no error") << "it moves, slowly";
  EXPECT_EQ(watch(still, [](int) { return std::int16_t{0}; }), "no error") << "a hand that holds still";
  EXPECT_EQ(watch(still, [](int k) { return static_cast<std::int16_t>(500 * std::sin(0.01 * k)); }), "no error")
      << "friction holds it";
}

TEST(FalconEncoderWatchTest, DoesNotCountTheTimeForWhichItsProcessStoodStill) {
  FalconEncoderWatch watched(4000);
  std::int64_t now_ns = 0;
  EXPECT_EQ(error_of(
                [&] {
                  for (int k = 0; k < 1000; ++k) {
                    now_ns += k == 500 ? 2'000'000'000 : 1'000'000;
                    watched.take({}, {static_cast<std::int16_t>(k % 500 < 100 ? 0 : 4000), 0, 0}, now_ns);
                  }
                },
                Error::Kind::device),
            "no error");
}

}  // namespace
}  // namespace haptrace::test
