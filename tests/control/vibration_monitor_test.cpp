#include "control/vibration_monitor.h"

#include "tests/support/allocations.h"
#include "tests/support/errors.h"

#include <cmath>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <numbers>
#include <random>

namespace haptrace {
namespace {

constexpr double kForce = 8;  // largest force of the device [N]

double sine(double hz, double t) {
  return std::sin(2 * std::numbers::pi * hz * t);
}

/// A monitor with a clock of its own.
class Watched {
 public:
  explicit Watched(double rate_hz = 1000, double resolution = 0)
      : rate_(rate_hz), monitor_({.rate_hz = rate_hz, .max_force = kForce, .position_resolution = resolution}) {}

  std::optional<VibrationAlarm> tick(const Vec3& force, const Vec3& position = Vec3::Zero(), double declared = 0,
                                     int ticks = 1) {
    time_ += ticks / rate_;
    return monitor_.update(force, position, declared, ticks / rate_);
  }

  /// Runs for up to `seconds` [s] and returns the first alarm that `counts` accepts.
  template <typename Force, typename Counts>
  std::optional<VibrationAlarm> first(double seconds, const Force& force, const Counts& counts) {
    for (const double end = time_ + seconds; time_ < end;) {
      const auto alarm = tick(force(time_));
      if (alarm && counts(*alarm)) return alarm;
    }
    return std::nullopt;
  }

  [[nodiscard]] double time() const { return time_; }
  [[nodiscard]] double rate() const { return rate_; }

 private:
  double rate_, time_ = 0;
  VibrationMonitor monitor_;
};

bool fast(const VibrationAlarm& alarm) {
  return alarm.rule != VibrationRule::slow;
}
bool any(const VibrationAlarm&) {
  return true;
}

TEST(VibrationMonitor, FindsARippleOfAQuarterOfTheForceWithinHalfASecondAtEveryRate) {
  for (const double rate : {250.0, 500.0, 1000.0, 4000.0, 10000.0}) {
    for (double hz = 16; hz < std::min(0.45 * rate, 1500.0); hz *= 1.13) {
      SCOPED_TRACE(testing::Message() << hz << " Hz at " << rate << " Hz");
      Watched watched(rate);
      const double amplitude = 0.26 * kForce * std::numbers::sqrt2;
      const auto alarm = watched.first(
          1, [&](double t) { return Vec3(1 + amplitude * sine(hz, t), 0, 0.5); }, fast);
      ASSERT_TRUE(alarm);
      EXPECT_LE(watched.time(), hz < 20 ? 0.65 : 0.5) << "eight half cycles of 16 Hz, and the filters' start";
      EXPECT_NEAR(alarm->frequency_hz, hz, 0.1 * hz);
      EXPECT_NEAR(alarm->ripple, amplitude / std::numbers::sqrt2, 0.4 * amplitude);
    }
  }
}

TEST(VibrationMonitor, FindsAVibrationAlongEveryDirectionAndOnTopOfALoad) {
  const Vec3 direction = Vec3(1, -1, 1).normalized();
  Watched watched;
  const auto alarm = watched.first(
      0.5, [&](double t) { return Vec3(Vec3(0, 4, -3) + 3 * sine(261, t) * direction); }, any);
  ASSERT_TRUE(alarm);
  EXPECT_EQ(alarm->rule, VibrationRule::energy);
  EXPECT_NEAR(alarm->frequency_hz, 261, 5);
}

TEST(VibrationMonitor, FindsAFrequencyCloseToHalfTheRate) {
  Watched watched;
  const auto alarm = watched.first(
      0.5, [](double t) { return Vec3(0, 3 * sine(493, t), 0); }, fast);
  ASSERT_TRUE(alarm);
  EXPECT_NEAR(alarm->frequency_hz, 493, 10);
}

TEST(VibrationMonitor, LeavesTremorStepsAndNoiseAlone) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.1 * kForce / std::sqrt(3.0));
  const auto silent = [](const char* what, const auto& force) {
    Watched watched;
    EXPECT_FALSE(watched.first(60, force, any)) << what << " at " << watched.time() << " s";
  };
  for (const double hz : {4.0, 6.0, 8.0, 10.0, 12.0})
    silent("tremor", [hz](double t) { return Vec3(2 + 0.3 * sine(hz, t), 0.3 * sine(hz, t + 0.1), -4); });
  silent("a tap every 150 ms", [](double t) { return Vec3(std::fmod(t, 0.15) < 0.02 ? 0.6 * kForce : 1e-9, 0, 0); });
  silent("a step every second", [](double t) { return Vec3(std::fmod(t, 2) < 1 ? kForce : -kForce, 0, 0); });
  silent("noise", [&](double) { return Vec3(noise(random), noise(random), noise(random)); });
  silent("a full swing at 2 Hz", [](double t) { return Vec3(kForce * sine(2, t), 0, 0); });
}

TEST(VibrationMonitor, TreatsASwayThatAHandCanMakeAsAHintOnly) {
  for (const double hz : {5.0, 8.0, 12.0}) {
    Watched watched;
    const auto alarm = watched.first(
        3, [hz](double t) { return Vec3(0.6 * kForce * sine(hz, t), 0, 0); }, any);
    ASSERT_TRUE(alarm) << hz;
    EXPECT_EQ(alarm->rule, VibrationRule::slow) << hz;
    EXPECT_NEAR(alarm->frequency_hz, hz, 0.1 * hz);
    EXPECT_GT(watched.time() * hz, 2.5) << "periods";
  }
}

TEST(VibrationMonitor, TakesTheAnswerToAKnownTremorForNoSwayUpToABound) {
  const auto sways = [](double tremor, double peak, double hz) {
    VibrationMonitor monitor({.rate_hz = 1000, .max_force = kForce, .tremor = tremor});
    for (int k = 0; k < 3000; ++k)
      if (const auto alarm = monitor.update(Vec3(peak * sine(hz, 1e-3 * k), 0, 0), Vec3::Zero(), 0, 1e-3)) return alarm;
    return std::optional<VibrationAlarm>();
  };
  EXPECT_TRUE(sways(0, 0.4 * kForce, 9)) << "unknown";
  EXPECT_TRUE(sways(0.3 * kForce, 0.4 * kForce, 9)) << "more than the tremor makes";
  EXPECT_FALSE(sways(0.5 * kForce, 0.4 * kForce, 9));
  EXPECT_TRUE(sways(10 * kForce, 0.7 * kForce, 9)) << "almost all force of the device";
  EXPECT_TRUE(sways(0, 0.3 * kForce, 9) && sways(0.1 * kForce, 0.3 * kForce, 9)) << "a weak tremor changes nothing";
  const auto vibrates = sways(10 * kForce, 0.5 * kForce, 30);
  ASSERT_TRUE(vibrates) << "faster than any hand";
  EXPECT_NE(vibrates->rule, VibrationRule::slow);
  EXPECT_NE(test::error_of([] { VibrationMonitor({.max_force = 1, .tremor = -1}); }), "");
  EXPECT_NE(test::error_of([] { VibrationMonitor({.max_force = 1, .tremor = kNaN}); }), "");
}

TEST(VibrationMonitor, IgnoresADeclaredTextureAndFindsStrongerVibrations) {
  const double texture = 0.5 * kForce;
  for (const double size : {0.5, 1.0, 2.0}) {
    Watched watched;
    bool found = false;
    while (watched.time() < 10 && !found) {
      const Vec3 force(size * texture * sine(80, watched.time()), 0, 0);
      found = watched.tick(force, Vec3::Zero(), texture).has_value();
    }
    EXPECT_EQ(found, size > 1) << size;
  }
}

TEST(VibrationMonitor, LeavesADeclaredTextureTheSameMarginInEveryRule) {
  for (const double hz : {12.0, 30.0, 80.0, 240.0}) {
    for (const double size : {1.35, 1.6}) {
      Watched watched;
      bool found = false;
      while (watched.time() < 10 && !found) {
        const Vec3 force(size * 0.5 * kForce * sine(hz, watched.time()), 0, 0);
        found = watched.tick(force, Vec3::Zero(), 0.5 * kForce).has_value();
      }
      EXPECT_EQ(found, size > 1.5) << size << " times at " << hz << " Hz";
    }
  }
}

TEST(VibrationMonitor, HoldsItsWindowsOverAGap) {
  Watched watched;
  const auto force = [](double t) { return Vec3(Vec3::Constant(0.25 * kForce * sine(60, t))); };
  EXPECT_FALSE(watched.first(0.1, force, any));
  EXPECT_FALSE(watched.tick(force(watched.time()), Vec3::Zero(), 0, 300)) << "a gap is no vibration";
  EXPECT_TRUE(watched.first(0.25, force, any)) << "the time before the gap counts";
}

/// Simulates a push against a wall every `interval` [s]. The wall returns the share `restitution` of the speed. Returns
/// the first fast alarm, else the first hint.
std::optional<VibrationAlarm> bounce(double restitution, double interval, double speed, double seconds) {
  constexpr double kContact = 0.02;  // duration of a contact [s]
  Watched watched(1000, 1e-5);
  std::optional<VibrationAlarm> hint;
  double x = 0.01;
  for (double t = 0; t < seconds; t = watched.time()) {
    const double in = std::fmod(t, interval);
    const bool touches = in < kContact;
    const double v = touches                            ? -speed * std::cos(std::numbers::pi * in / kContact)
                     : in < 0.5 * (interval + kContact) ? restitution * speed
                                                        : -speed;
    x += 1e-3 * v;
    const double force = touches ? 0.4 * kForce * std::sin(std::numbers::pi * (in + 1e-4) / kContact) : 0;
    const auto alarm = watched.tick(Vec3(force, 0, 0), Vec3(x, 0, 0));
    if (alarm && fast(*alarm)) return alarm;
    if (alarm && !hint) hint = alarm;
  }
  return hint;
}

TEST(VibrationMonitor, FindsAToolThatBouncesOffAWallByItself) {
  const auto fast_bounces = bounce(1, 0.1, 0.1, 2);
  ASSERT_TRUE(fast_bounces);
  EXPECT_EQ(fast_bounces->rule, VibrationRule::contacts);
  EXPECT_NEAR(fast_bounces->frequency_hz, 10, 0.5);
  for (const double interval : {0.125, 0.15}) {
    const auto writing = bounce(1, interval, 0.1, 3);
    ASSERT_TRUE(writing) << interval;
    EXPECT_EQ(writing->rule, VibrationRule::slow) << "a hand that writes at 8 Hz touches as often";
  }
  const auto slow_bounces = bounce(1, 0.25, 0.1, 3);
  ASSERT_TRUE(slow_bounces);
  EXPECT_EQ(slow_bounces->rule, VibrationRule::slow);
  EXPECT_FALSE(bounce(0.6, 0.25, 0.1, 20)) << "a hand that taps: the wall takes its energy";
  EXPECT_FALSE(bounce(1, 0.5, 0.1, 20)) << "slowly";
  EXPECT_FALSE(bounce(1, 0.25, 0.005, 20)) << "slower than the range of the contact rule";
}

TEST(VibrationMonitor, IgnoresWhatIsNotFinite) {
  Watched watched;
  const auto force = [](double t) { return Vec3(Vec3::Constant(0.25 * kForce * sine(60, t))); };
  EXPECT_FALSE(watched.first(0.1, force, any));
  EXPECT_FALSE(watched.tick(nan3()));
  EXPECT_FALSE(watched.tick(Vec3::Zero(), Vec3(0, HUGE_VAL, 0)));
  EXPECT_FALSE(watched.tick(Vec3::Zero(), Vec3::Zero(), kNaN));
  EXPECT_TRUE(watched.first(0.3, force, any));
}

TEST(VibrationMonitor, AllocatesNothing) {
  Watched watched;
  const std::size_t before = test::allocations();
  (void)watched.first(
      1, [](double t) { return Vec3(kForce * sine(60, t), kForce * sine(9, t), 0); }, [](auto) { return false; });
  EXPECT_EQ(test::allocations(), before);
}

TEST(VibrationMonitor, NamesTheOptionThatIsOutOfItsRange) {
  EXPECT_THAT(test::error_of([] { VibrationMonitor({.rate_hz = 1, .max_force = 1}); }), testing::HasSubstr("rate"));
  EXPECT_THAT(test::error_of([] { VibrationMonitor({.max_force = 0}); }), testing::HasSubstr("largest force"));
}

}  // namespace
}  // namespace haptrace
