#include "devices/check/conformance.h"

#include "devices/loop/clock.h"
#include "devices/loop/threaded_device.h"
#include "devices/sim/live_plant.h"
#include "tests/devices/conformance.h"
#include "tests/devices/support.h"
#include "tests/support/real_time.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <set>
#include <thread>

namespace haptrace::test {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::IsSupersetOf;
using testing::Not;
using Verdict = LawFinding::Verdict;

/// A device's faults, and the forces sent to it.
struct Wrong {
  std::function<void(DeviceInfo&)> info = [](DeviceInfo&) {};
  std::function<Vec3(const Vec3& force)> force = [](const Vec3& f) { return f; };
  std::function<Device::Status(int exchange, DeviceState& state)> answer = [](int, DeviceState&) {
    return Device::Status::ok;
  };
  bool stays_open = false;

  Vec3 last = nan3();            ///< last force sent [N]
  bool ended_with_none = false;  ///< an exchange with dt = 0 carried a force that is not finite
  double largest = 0;            ///< largest force sent [N]
};

/// Wraps a device and adds the faults.
class WrongDevice final : public Device {
 public:
  WrongDevice(std::unique_ptr<Device> device, Wrong& wrong)
      : device_(std::move(device)), wrong_(wrong), info_(device_->info()) {
    wrong_.info(info_);
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    wrong_.last = wrench.force;
    wrong_.largest = std::max(wrong_.largest, sendable(wrench).force.norm());
    wrong_.ended_with_none = wrong_.ended_with_none || (dt == 0 && !is_finite(wrench.force));
    const Status status = device_->exchange({wrong_.force(wrench.force), Vec3::Zero()}, dt, state);
    return status == Status::ok ? wrong_.answer(count_++, state) : status;
  }
  void close() noexcept override {
    if (!wrong_.stays_open) device_->close();
  }
  [[nodiscard]] std::string lost_reason() const override { return "it broke"; }

 private:
  std::unique_ptr<Device> device_;
  Wrong& wrong_;
  DeviceInfo info_;
  int count_ = 0;
};

class Conformance : public testing::Test {
 protected:
  ConformanceOptions options_ = hasty_options();
  ConsentingUser user_;
  StopRequest stop_;
  Wrong wrong_;
  ConformanceReport report_;

  const ConformanceReport& test(const std::string& device) {
    report_ = test_conformance([&] { return std::make_unique<WrongDevice>(open_device(device), wrong_); }, options_,
                               user_, stop_);
    EXPECT_EQ(wrong_.last, Vec3(0, 0, 0)) << "zero force is what is sent last";
    EXPECT_LE(wrong_.largest, options_.max_force);
    return report_;
  }
  const ConformanceReport& test_mass() { return test("plugin:path=" MASS_PLUGIN); }

  [[nodiscard]] std::vector<std::string> laws(Verdict verdict) const {
    std::vector<std::string> ids;
    for (const LawFinding& finding : report_.findings)
      if (finding.verdict == verdict) ids.push_back(finding.id);
    return ids;
  }
  [[nodiscard]] std::vector<std::string> broken() const { return laws(Verdict::failed); }

  [[nodiscard]] LawFinding finding(const std::string& id) const {
    for (const LawFinding& finding : report_.findings)
      if (finding.id == id) return finding;
    return {};
  }
};

TEST_F(Conformance, ReportsEveryLawOnceAndImmediately) {
  test_mass();
  std::set<std::string> ids, told(user_.told.begin(), user_.told.end());
  for (const LawFinding& finding : report_.findings) {
    EXPECT_TRUE(ids.insert(finding.id).second) << finding.id;
    EXPECT_THAT(finding.law, Not(IsEmpty()));
    EXPECT_THAT(finding.detail, Not(IsEmpty())) << finding.id;
  }
  EXPECT_EQ(told, ids);
  EXPECT_EQ(user_.told.size(), report_.findings.size());
  EXPECT_EQ(ids.size(), 23U);
}

TEST_F(Conformance, PassesAMass) {
  test_mass();
  EXPECT_THAT(broken(), IsEmpty()) << describe(report_);
  EXPECT_THAT(laws(Verdict::passed), IsSupersetOf({"force_x", "force_y", "force_z", "gentle", "latency", "nan_force",
                                                   "repeats", "closes", "reopens"}))
      << describe(report_);
  EXPECT_TRUE(report_.kept());
}

TEST_F(Conformance, SendsNoForceThatIsNotAllowed) {
  user_.consents = false;
  EXPECT_TRUE(test_mass().kept()) << describe(report_);
  EXPECT_EQ(wrong_.largest, 0);
  EXPECT_THAT(laws(Verdict::not_tested), IsSupersetOf({"force_x", "gentle", "nan_force"}));
  user_.consents = true;
  options_.no_forces = "nobody is there";
  user_.asked.clear();
  test_mass();
  EXPECT_EQ(wrong_.largest, 0);
  EXPECT_THAT(user_.asked, IsEmpty());
  EXPECT_EQ(finding("force_x").detail, "nobody is there");
}

TEST_F(Conformance, AnnouncesEveryForce) {
  test_mass();
  EXPECT_THAT(user_.asked, Contains(AllOf(HasSubstr("along y"), HasSubstr("at most 0.5 N"))));
}

TEST_F(Conformance, MeasuresTheDelayOfADevice) {
  const TempFolder folder;
  for (const double delay : {0.001, 0.004, 0.012}) {
    const std::string file = folder.write(
        "delayed.json",
        fmt::format(R"({{"model": "m", "mass": 0.3, "coulomb": 0.1, "max_force": 9, "position_resolution": 2e-5,
                        "delay_s": {}}})",
                    delay));
    test("sim:spec=" + file);
    ASSERT_EQ(finding("latency").figures.size(), 1U) << describe(report_);
    EXPECT_NEAR(finding("latency").figures[0].value, delay, 0.0015) << describe(report_);
  }
}

TEST_F(Conformance, IsHonestWhenFrictionHidesTheEffectOfAForce) {
  EXPECT_TRUE(test("sim:preset=falcon").kept()) << describe(report_);
  EXPECT_THAT(laws(Verdict::not_tested), IsSupersetOf({"force_x", "force_y", "force_z", "latency"}));
  EXPECT_THAT(finding("force_x").detail, HasSubstr("--max-force"));
  options_.max_force = 2;
  test("sim:preset=falcon");
  EXPECT_THAT(broken(), IsEmpty()) << describe(report_);
  EXPECT_THAT(laws(Verdict::passed), IsSupersetOf({"force_x", "force_y", "force_z", "latency", "resolution"}))
      << describe(report_);
}

TEST_F(Conformance, DoesNotPushADeviceThatFallsByItself) {
  EXPECT_TRUE(test("sim:preset=reference,hand=none").kept()) << describe(report_);
  EXPECT_THAT(finding("force_x").detail, HasSubstr("moves by itself"));
  EXPECT_EQ(wrong_.largest, 0);
}

TEST_F(Conformance, FindsAnInvertedAxis) {
  wrong_.force = [](const Vec3& f) { return Vec3(f.x(), -f.y(), f.z()); };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("force_y")) << describe(report_);
  EXPECT_THAT(finding("force_y").detail, HasSubstr("sign"));
}

TEST_F(Conformance, FindsSwappedAxes) {
  wrong_.force = [](const Vec3& f) { return Vec3(f.y(), f.x(), f.z()); };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("force_x", "force_y")) << describe(report_);
  EXPECT_THAT(finding("force_x").detail, HasSubstr("swapped"));
}

TEST_F(Conformance, StopsAtAForceThatIgnoresItsSize) {
  wrong_.force = [](const Vec3& f) { return Vec3(20 * f.stableNormalized()); };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("gentle")) << describe(report_);
  // No force is sent after the first one that goes wrong.
  EXPECT_THAT(finding("force_x").detail, HasSubstr("m/s is over the limit"));
  EXPECT_THAT(finding("force_y").detail, HasSubstr("no force was sent after that"));
}

TEST_F(Conformance, FindsForcesThatAreLargerThanCommanded) {
  wrong_.force = [](const Vec3& f) { return Vec3(100 * f); };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("gentle")) << describe(report_);
  EXPECT_THAT(finding("gentle").detail, HasSubstr("larger than commanded"));
}

TEST_F(Conformance, FindsAWrongResolution) {
  for (const double factor : {0.1, 30.0}) {
    wrong_.info = [factor](DeviceInfo& info) { info.position_resolution *= factor; };
    test("sim:preset=premium1.5");
    EXPECT_THAT(broken(), ElementsAre("resolution")) << describe(report_);
  }
}

TEST_F(Conformance, FindsAnInvalidDescription) {
  wrong_.info = [](DeviceInfo& info) { info.max_continuous_force = 1000; };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("description"));
  EXPECT_THAT(finding("description").detail, HasSubstr("max_continuous_force"));
}

TEST_F(Conformance, FindsAnAbsurdDescription) {
  const std::pair<const char*, std::function<void(DeviceInfo&)>> absurd[] = {
      {"max_force is 1e+09 N", [](DeviceInfo& info) { info.max_force = 1e9; }},
      {"max_force is not above 0", [](DeviceInfo& info) { info.max_force = -8; }},
      {"max_continuous_force", [](DeviceInfo& info) { info.max_continuous_force = kNaN; }},
      {"max_torque", [](DeviceInfo& info) { info.max_torque = 1e9; }},
      {"max_torque", [](DeviceInfo& info) { info.max_torque = kNaN; }},
      {"the workspace reaches farther than 10 m", [](DeviceInfo& info) { info.workspace_max.x() = 1e6; }},
      {"position_resolution", [](DeviceInfo& info) { info.position_resolution = 1; }},
      {"nominal_rate", [](DeviceInfo& info) { info.nominal_rate = 1e12; }},
  };
  user_.consents = false;
  for (const auto& [words, info] : absurd) {
    wrong_.info = info;
    test_mass();
    EXPECT_THAT(broken(), Contains("description")) << words;
    EXPECT_THAT(finding("description").detail, HasSubstr(words));
  }
}

/// A user of a device whose encoders are stuck; counts the requests to move the handle.
class Frozen final : public ConsentingUser {
 public:
  explicit Frozen(bool is_there) : is_there_(is_there) {}
  bool does(const std::string& request) override {
    if (request.find("move the handle by some centimetres") != std::string::npos) ++moved;
    return is_there_;
  }
  int moved = 0;

 private:
  bool is_there_;
};

TEST_F(Conformance, FindsAPositionThatStandsStillAlthoughItsHandleIsMoved) {
  Frozen user(true);
  bool frozen = true;
  wrong_.info = [](DeviceInfo& info) { info.virtual_time = false; };
  wrong_.answer = [&](int, DeviceState& state) {
    state.position = Vec3(frozen ? 0.0 : 0.03 * user.moved, 0, 0);
    return Device::Status::ok;
  };
  const auto open = [&] { return std::make_unique<WrongDevice>(open_device("plugin:path=" MASS_PLUGIN), wrong_); };
  report_ = test_conformance(open, options_, user, stop_);
  EXPECT_THAT(broken(), ElementsAre("follows")) << describe(report_);
  EXPECT_THAT(finding("follows").detail, HasSubstr("although it was moved"));
  EXPECT_EQ(user.moved, 1);
  frozen = false;
  user.moved = 0;
  report_ = test_conformance(open, options_, user, stop_);
  EXPECT_EQ(finding("follows").verdict, Verdict::passed) << "it was only held: " << describe(report_);
}

TEST_F(Conformance, DoesNotJudgeAPositionThatFrictionMayHold) {
  wrong_.answer = [](int, DeviceState& state) {
    state.position = Vec3::Zero();
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), IsEmpty());
  EXPECT_EQ(finding("follows").verdict, Verdict::not_tested);
  EXPECT_THAT(finding("follows").detail, HasSubstr("its position never changed under forces of up to 0.5 N"));
}

TEST_F(Conformance, FindsAPositionThatStandsStillUnderAForceThatNoFrictionHolds) {
  options_.max_force = 4;
  wrong_.answer = [](int, DeviceState& state) {
    state.position = Vec3::Zero();
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("follows")) << describe(report_);
}

TEST_F(Conformance, FindsQuantitiesThatAreNotMeasured) {
  wrong_.info = [](DeviceInfo& info) { info.measures_velocity = true; };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("measures"));
  EXPECT_THAT(finding("measures").detail, HasSubstr("velocity"));
}

TEST_F(Conformance, FindsADeviceThatNeverBecomesReady) {
  options_.ready_timeout = 0.5;
  wrong_.answer = [](int, DeviceState& state) {
    state.ready = false;
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("ready")) << describe(report_);
  EXPECT_EQ(wrong_.largest, 0);
}

TEST_F(Conformance, FindsAnExchangeThatIsTooSlow) {
  in_real_time();
  options_.rate_hz = 2000;
  options_.busy_machine = false;
  user_.consents = false;  // makes the test faster
  wrong_.answer = [](int, DeviceState&) {
    std::this_thread::sleep_for(std::chrono::microseconds(600));
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("exchange")) << describe(report_);
}

TEST_F(Conformance, FindsStaleStates) {
  wrong_.answer = [](int, DeviceState& state) {
    state.age = 0.06;
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("fresh", "stays")) << describe(report_);
}

TEST_F(Conformance, FindsNoise) {
  Gaussian random(3, 1);
  wrong_.answer = [&random](int exchange, DeviceState& state) {
    if (exchange == 0) random = Gaussian(3, 1);
    state.position += 3e-4 * random.vector();
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("noise")) << describe(report_);
}

TEST_F(Conformance, FindsAPositionThatIsNotFinite) {
  wrong_.answer = [](int exchange, DeviceState& state) {
    if (exchange == 200) state.position.y() = kNaN;
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("finite")) << describe(report_);
}

TEST_F(Conformance, FindsADeviceThatMovesAfterAForceThatIsNotFinite) {
  wrong_.force = [](const Vec3& f) { return is_finite(f) ? f : Vec3(20, 0, 0); };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("nan_force")) << describe(report_);
}

TEST_F(Conformance, FindsADeviceThatDiesInTheMiddle) {
  wrong_.answer = [](int exchange, DeviceState&) {
    return exchange > 700 ? Device::Status::lost : Device::Status::ok;  // under force
  };
  const ConformanceReport report =
      test_conformance([&] { return std::make_unique<WrongDevice>(open_device("plugin:path=" MASS_PLUGIN), wrong_); },
                       options_, user_, stop_);
  report_ = report;
  EXPECT_THAT(broken(), ElementsAre("stays")) << describe(report_);
  EXPECT_EQ(wrong_.last, Vec3(0, 0, 0));
  EXPECT_GT(wrong_.largest, 0);
}

TEST_F(Conformance, FindsADeviceThatAnswersAfterItsClose) {
  wrong_.stays_open = true;
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("closes")) << describe(report_);
}

TEST_F(Conformance, FindsADeviceThatDoesNotOpenAgain) {
  int openings = 0;
  report_ = test_conformance(
      [&]() -> std::unique_ptr<Device> {
        if (++openings == 2) throw device_error("the port is busy");
        return open_device("plugin:path=" MASS_PLUGIN);
      },
      options_, user_, stop_);
  EXPECT_THAT(broken(), ElementsAre("reopens"));
  EXPECT_EQ(finding("reopens").detail, "the port is busy");
}

TEST_F(Conformance, FindsADeviceThatDoesNotRepeatItself) {
  int exchanges = 0;
  wrong_.answer = [&](int, DeviceState& state) {
    state.position.x() += 1e-12 * exchanges++;
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), ElementsAre("repeats")) << describe(report_);
}

TEST_F(Conformance, StopsAtOnceWhenAsked) {
  class Stopping final : public ConsentingUser {
   public:
    explicit Stopping(StopRequest& stop) : stop_(stop) {}
    bool allows(const std::string& force) override {
      if (force.find("along y") != std::string::npos) stop_.raise();
      return ConsentingUser::allows(force);
    }

   private:
    StopRequest& stop_;
  } user(stop_);
  report_ =
      test_conformance([&] { return std::make_unique<WrongDevice>(open_device("plugin:path=" MASS_PLUGIN), wrong_); },
                       options_, user, stop_);
  EXPECT_TRUE(report_.interrupted);
  EXPECT_THAT(broken(), IsEmpty()) << describe(report_);
  EXPECT_EQ(finding("force_x").verdict, Verdict::passed);
  EXPECT_EQ(finding("force_z").verdict, Verdict::not_tested);
  EXPECT_EQ(wrong_.last, Vec3(0, 0, 0));
}

TEST_F(Conformance, EndsWithZeroForceEvenWhileItSendsNone) {
  wrong_.force = [this](const Vec3& f) {
    if (!is_finite(f) && stop_.count() == 0) {
      stop_.raise();
      stop_.raise();
    }
    return f;
  };
  test_mass();
  EXPECT_TRUE(report_.interrupted);
  EXPECT_FALSE(wrong_.ended_with_none);
}

TEST_F(Conformance, RefusesOptionsOutOfRange) {
  options_.max_force = kNaN;
  EXPECT_THROW(test_mass(), Error);
}

/// A mass in real time that keeps the last force, like a driver without a watchdog.
class Unwatched final : public Device {
 public:
  explicit Unwatched(LivePlant plant) : plant_(std::move(plant)), info_(plant_.info()) { info_.virtual_time = false; }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double, DeviceState& state) noexcept override {
    if (closed_) return Status::lost;
    // Advance in steps of 50 ms, since LivePlant does not move for longer than 0.1 s in one step.
    const std::int64_t now = monotonic_ns();
    for (std::int64_t t = std::exchange(last_ns_, now); t > 0 && t < now; t += 50'000'000) plant_.advance_to(t);
    plant_.advance_to(now);
    plant_.apply(sendable(wrench).force);
    state = DeviceState{};
    const double count = info_.position_resolution;
    state.position = count * (plant_.position() / count).array().round();
    return Status::ok;
  }
  void close() noexcept override { closed_ = true; }

 private:
  LivePlant plant_;
  DeviceInfo info_;
  std::int64_t last_ns_ = 0;
  bool closed_ = false;
};

/// The same device as a driver, supervised by a ThreadedDevice.
class UnwatchedDriver final : public DeviceDriver {
 public:
  explicit UnwatchedDriver(LivePlant plant) : device_(std::move(plant)) {}
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_.info(); }
  bool round(const Wrench& wrench, DeviceState& state) override {
    return device_.exchange(wrench, 0, state) == Device::Status::ok;
  }
  ZeroForce release() noexcept override {
    device_.close();
    return ZeroForce::confirmed;
  }

 private:
  Unwatched device_;
};

LivePlant live_mass() {
  return open_live_plant(DeviceSpec{.text = "mass", .name = "sim", .options = {}}, "premium1.5");
}

TEST_F(Conformance, FindsADeviceThatKeepsItsForceWhenTheHostPauses) {
  in_real_time();
  report_ = test_conformance([] { return std::make_unique<Unwatched>(live_mass()); }, options_, user_, stop_);
  EXPECT_THAT(broken(), ElementsAre("host_pause")) << describe(report_);
  EXPECT_THAT(finding("host_pause").detail, HasSubstr("watchdog"));
}

TEST_F(Conformance, PassesADeviceThatLetsGoWhenTheHostPauses) {
  in_real_time();
  report_ =
      test_conformance([] { return std::make_unique<ThreadedDevice>(std::make_unique<UnwatchedDriver>(live_mass())); },
                       options_, user_, stop_);
  EXPECT_THAT(broken(), IsEmpty()) << describe(report_);
  EXPECT_EQ(finding("host_pause").verdict, Verdict::passed) << describe(report_);
}

TEST_F(Conformance, FindsStatesThatAreSeldomNew) {
  in_real_time();
  options_.busy_machine = false;
  user_.consents = false;
  std::int64_t taken = 0;
  wrong_.info = [](DeviceInfo& info) { info.virtual_time = false; };
  wrong_.answer = [&taken](int exchange, DeviceState& state) {
    if (exchange % 5 == 0) taken = monotonic_ns();
    state.age = 1e-9 * static_cast<double>(monotonic_ns() - taken) + 1e-6;
    return Device::Status::ok;
  };
  test_mass();
  EXPECT_THAT(broken(), Contains("rate")) << describe(report_);
}

TEST_F(Conformance, AsksWhetherAForceThatOpposesIsFelt) {
  in_real_time();
  class Numb final : public ConsentingUser {
   public:
    [[nodiscard]] bool is_there() const override { return true; }
    std::optional<bool> answers(const std::string& /*question*/) override { return false; }
  } user;
  options_.feel = 0.2;
  report_ =
      test_conformance([] { return std::make_unique<ThreadedDevice>(std::make_unique<UnwatchedDriver>(live_mass())); },
                       options_, user, stop_);
  EXPECT_THAT(broken(), ElementsAre("opposes")) << describe(report_);
}

}  // namespace
}  // namespace haptrace::test
