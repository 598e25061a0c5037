// Tests of the oscillation monitor with loops that oscillate and loops that do not: playbacks on simulated devices in
// virtual time.
#include "control/oscillation_monitor.h"

#include "control/filters.h"
#include "control/path/shapes.h"
#include "control/pd.h"
#include "control/velocity_estimator.h"
#include "devices/loop/servo_loop.h"
#include "devices/sim/sim_device.h"
#include "player/playback/playback_controller.h"

#include <algorithm>
#include <functional>
#include <gtest/gtest.h>
#include <numbers>
#include <random>
#include <vector>

namespace haptrace {
namespace {

using nlohmann::json;
using std::numbers::pi;

constexpr double kMaxForce = 8.9;  // [N]

/// A simulated device with an additional push, besides the hand that holds it.
class Pushed final : public Device {
 public:
  using Push = std::function<Vec3(double)>;

  Pushed(SimDevice& device, Push push) : device_(device), info_(device.info()), push_(std::move(push)) {
    info_.max_force = kMaxForce;
  }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    time_ += dt;
    return device_.exchange({push_ ? wrench.force + push_(time_) : wrench.force, wrench.torque}, dt, state);
  }
  void close() noexcept override {}

 private:
  SimDevice& device_;
  DeviceInfo info_;
  Push push_;
  double time_ = 0;
};

/// The rms of a signal between 8 and 120 Hz, over 50 ms and three axes.
class VibrationSize {
 public:
  explicit VibrationSize(double rate_hz) : ticks_(std::max<std::size_t>(1, static_cast<std::size_t>(0.05 * rate_hz))) {
    squares_.reserve(1 << 18);  // a tick allocates nothing
    rms.reserve(1 << 18);
    for (int axis = 0; axis < 3; ++axis) {
      high_.emplace_back(Butterworth2::Kind::high_pass, 8, rate_hz);
      low_.emplace_back(Butterworth2::Kind::low_pass, std::min(120.0, 0.4 * rate_hz), rate_hz);
    }
  }

  void add(const Vec3& x) {
    double square = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double value = x[static_cast<Eigen::Index>(axis)];
      if (squares_.empty()) high_[axis].reset(value);
      square += std::pow(low_[axis].update(high_[axis].update(value)), 2);
    }
    squares_.push_back(square);
    sum_ += square;
    if (squares_.size() > ticks_) sum_ -= squares_[squares_.size() - 1 - ticks_];
    rms.push_back(std::sqrt(std::max(0.0, sum_) / static_cast<double>(ticks_)));
  }

  std::vector<double> rms;

 private:
  std::size_t ticks_;
  std::vector<Butterworth2> high_, low_;
  std::vector<double> squares_;
  double sum_ = 0;
};

/// Parameters of a session: a device with its hand, a law and disturbances.
struct Session {
  json device;
  double kp = 3000, kd = 25;
  double rate_hz = 1000;
  std::string shape = "circle";
  double corner = 0.005;  ///< corner blend of the path [m]
  Pushed::Push push;
  bool softens = false;  ///< the servo loop softens a force that vibrates
  std::uint64_t seed = 1;
};

struct Watching {
  double found = kNaN;  ///< time of the first verdict [s]
  OscillationVerdict verdict;
  double onset = kNaN;   ///< onset of a real oscillation [s]
  double last_rms = 0;   ///< ripple of the true position in the final hold, rms [m]
  double share = 1;      ///< remaining share of the feedback
  int alarms = 0;        ///< alarms of ForceGuard without hints
  double worst_rms = 0;  ///< largest ripple of the true position, rms [m]
};

/// A playback with the monitor running in parallel.
class Watched final : public Controller {
 public:
  Watched(PlaybackController& playback, const OscillationMonitorOptions& options, const SimDevice& device)
      : position(options.rate_hz), force(options.rate_hz), playback_(playback), monitor_(options), device_(device) {}

  void start(const State& first) noexcept override { playback_.start(first); }
  [[nodiscard]] Command update(const State& state) noexcept override {
    Command command = playback_.update(state);
    const auto verdict = monitor_.update(state, command.reference);
    if (verdict && std::isnan(outcome.found)) {
      outcome.found = 1e-9 * static_cast<double>(state.time_ns);
      outcome.verdict = *verdict;
    }
    position.add(command.reference.position - device_.true_position());
    force.add(state.force_applied);
    if (command.phase == Phase::hold) outcome.last_rms = position.rms.back();
    return command;
  }

  Watching outcome;
  VibrationSize position, force;

 private:
  PlaybackController& playback_;
  OscillationMonitor monitor_;
  const SimDevice& device_;
};

/// Returns the onset of a real oscillation [s]. Either the ripple of the true position exceeds 0.08 mm (and 1.6 encoder
/// counts) rms with a force ripple above 8 % of the largest force, or the force ripple alone exceeds 40 %. For 0.3 s it
/// must not fall below 0.7 of these levels, nor below half of its own maximum.
double onset(const VibrationSize& position, const VibrationSize& force, double quantum, double rate_hz) {
  const double least = std::max(8e-5, 1.6 * quantum);
  const auto lasts = [&](std::size_t from, const std::vector<double>& rms, double level, double force_level) {
    double most = 0;
    for (std::size_t i = from; i < from + static_cast<std::size_t>(0.3 * rate_hz); ++i) {
      most = std::max(most, rms[i]);
      const double part = i == from ? 1 : 0.7;
      if (rms[i] < part * level || rms[i] < 0.5 * most || force.rms[i] < part * force_level) return false;
    }
    return true;
  };
  for (std::size_t i = 0; i + static_cast<std::size_t>(0.3 * rate_hz) < position.rms.size(); ++i)
    if (lasts(i, position.rms, least, 0.08 * kMaxForce) || lasts(i, force.rms, 0.4 * kMaxForce, 0))
      return static_cast<double>(i) / rate_hz;
  return kNaN;
}

Watching play(const Session& session) {
  json spec_json = session.device;
  spec_json["max_force"] = 200;  // the session's limit is kMaxForce, but a push may exceed it
  const SimSpec spec = read_sim_spec(spec_json, "test");
  SimDevice device(spec, {.seed = session.seed});
  Pushed pushed(device, session.push);

  ForceTerms terms;
  terms.push_back(std::make_unique<PdLaw>());
  const Path path = make_shape(session.shape, {.size = 0.08, .duration = 4, .blend = session.corner});
  PlaybackController playback(
      Trajectory(path, Interpolation::cubic), std::move(terms),
      {.gains = {Vec3::Constant(session.kp), Vec3::Constant(session.kd)}},
      {.max_deviation = 5, .on_deviation = DeviationPolicy::soften, .rate_hz = session.rate_hz});
  const OscillationMonitorOptions options{.rate_hz = session.rate_hz,
                                          .max_force = kMaxForce,
                                          .delay = spec.delay + 1 / (2 * pi * spec.actuator_bandwidth_hz),
                                          .position_resolution = spec.position_resolution,
                                          .mass = spec.mass.minCoeff()};
  Watched watched(playback, options, device);
  const auto estimator = make_velocity_estimator("lowpass:100", session.rate_hz, spec.position_resolution);
  const ServoReport report =
      ServoLoop(pushed, watched, *estimator, {},
                {.rate_hz = session.rate_hz, .virtual_time = true, .watch_vibration = session.softens})
          .run(StopRequest{});
  EXPECT_EQ(report.cause, StopCause::finished) << report.detail;
  watched.outcome.share = report.vibration.share;
  for (int rule = 0; rule < kVibrationRules; ++rule)
    if (rule != static_cast<int>(VibrationRule::slow))
      watched.outcome.alarms += report.vibration.steps[static_cast<std::size_t>(rule)];
  watched.outcome.onset = onset(watched.position, watched.force, spec.position_resolution, session.rate_hz);
  watched.outcome.worst_rms = *std::max_element(watched.position.rms.begin(), watched.position.rms.end());
  return watched.outcome;
}

/// Draws devices and hands of the project's ensemble.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}

  double operator()(double from, double to) { return std::uniform_real_distribution<double>(from, to)(random_); }
  double logarithmic(double from, double to) { return from * std::pow(to / from, (*this)(0, 1)); }

  json device() {
    Draw& draw = *this;
    json device{{"mass", draw(0.2, 0.6)},
                {"viscous", draw(1, 3)},
                {"coulomb", draw(0.3, 1.1)},
                {"stribeck", {{"static_ratio", 1.25}, {"velocity", 0.01}}},
                {"presliding", {{"distance", 8e-5}}},
                {"actuator_rotation", {0.3, -0.5, 0.4}},
                {"delay_s", draw(0, 2e-3)},
                {"actuator_bandwidth_hz", 1 / (2 * pi * draw(0.2e-3, 1e-3))},
                {"position_resolution", 5e-5},
                {"force_resolution", 0.005},
                {"workspace", {{"min", -0.1}, {"max", 0.1}}}};
    if (draw(0, 1) > 0.1) device["hand"] = hand();
    return device;
  }

  json hand() {
    Draw& draw = *this;
    return {{"mass", draw(0.05, 0.3)},
            {"grip_stiffness", logarithmic(200, 2000)},
            {"grip_damping", draw(2, 10)},
            {"arm_stiffness", logarithmic(5, 200)},
            {"arm_relaxation_s", draw(0.3, 2)},
            {"arm_damping", draw(1, 5)},
            {"tremor", 0.04},
            {"drift", 0.15}};
  }

 private:
  std::mt19937_64 random_;
};

/// Plays sessions with gains that devices do not withstand, and expects every real oscillation to be found in time.
template <class Gains>
void expect_found(std::uint64_t seed, int sessions, const Gains& choose, int at_least) {
  Draw draw(seed);
  int real = 0;
  for (int i = 0; i < sessions; ++i) {
    Session session{.device = draw.device(), .seed = static_cast<std::uint64_t>(i) + 1};
    choose(session, draw);
    const Watching outcome = play(session);
    if (std::isnan(outcome.onset)) continue;
    ++real;
    EXPECT_LE(outcome.found - outcome.onset, 0.3)
        << "session " << i << ": onset " << outcome.onset << " s, kp " << session.kp << ", kd " << session.kd;
  }
  EXPECT_GE(real, at_least) << "too few of these loops oscillate to say anything";
}

TEST(OscillationMonitorInTheLoop, FindsEveryOscillationOfTooStiffALawWithin300Milliseconds) {
  expect_found(
      1, 40, [](Session& session, Draw& draw) { session.kp = draw.logarithmic(12e3, 30e3); }, 30);
}

TEST(OscillationMonitorInTheLoop, FindsEveryOscillationOfTooMuchDampingWithin300Milliseconds) {
  expect_found(
      2, 20, [](Session& session, Draw& draw) { session.kd = draw.logarithmic(80, 300); }, 8);
}

TEST(OscillationMonitorInTheLoop, FindsEveryOscillationAtOtherRatesWithin300Milliseconds) {
  expect_found(
      3, 12,
      [](Session& session, Draw& draw) {
        session.rate_hz = 250;
        session.kp = draw.logarithmic(6e3, 12e3);
      },
      6);
  expect_found(
      4, 4,
      [](Session& session, Draw& draw) {
        session.rate_hz = 4000;
        session.kp = draw.logarithmic(25e3, 50e3);
      },
      2);
}

/// A disturbance of a stable loop that must not raise an alarm.
struct Calm {
  const char* name;
  void (*happens)(Session&, Draw&);
};

void tremble(Session& session, Draw& draw, double force) {
  if (!session.device.contains("hand")) session.device["hand"] = draw.hand();
  session.device["hand"]["tremor"] = force;
  session.device["hand"]["drift"] = 0.3;
}

/// Returns a push for 1.5 s that ends abruptly.
Pushed::Push push(double force) {
  return [force](double t) { return t > 1.5 && t < 3 ? Vec3(force, 0.3 * force, 0) : Vec3(0, 0, 0); };
}

void cautious(Session& session) {
  const PdGains gains = cautious_gains(kMaxForce, session.rate_hz);
  session.kp = gains.kp.x();
  session.kd = gains.kd.x();
}

class CalmLoops : public testing::TestWithParam<Calm> {};

TEST_P(CalmLoops, AreNeverSuspected) {
  Draw draw(7);
  for (int i = 0; i < 8; ++i) {
    Session session{.device = draw.device(), .seed = static_cast<std::uint64_t>(i) + 1};
    // The device falls with its weight while the force fades in.
    session.device["gravity_bias"] = {draw(-1, 1), draw(-1, 1), draw(-1, 1)};
    GetParam().happens(session, draw);
    session.softens = true;
    const Watching outcome = play(session);
    EXPECT_EQ(outcome.alarms, 0) << "session " << i << ": the guard softened it to " << outcome.share;
    EXPECT_TRUE(std::isnan(outcome.found))
        << "session " << i << " at " << outcome.found << " s: " << outcome.verdict.frequency_hz << " Hz, "
        << 1e3 * outcome.verdict.amplitude << " mm, " << 1e3 * outcome.verdict.energy << " mJ, by detector "
        << static_cast<int>(outcome.verdict.detector);
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, CalmLoops,
    testing::Values(Calm{"Stiff", [](Session&, Draw&) {}}, Calm{"Cautious", [](Session& s, Draw&) { cautious(s); }},
                    Calm{"SharpCorners",
                         [](Session& s, Draw&) {
                           s.shape = "square";
                           s.corner = 0;
                         }},
                    Calm{"Tremor", [](Session& s, Draw& d) { tremble(s, d, 0.3); }},
                    Calm{"PathologicalTremor", [](Session& s, Draw& d) { tremble(s, d, 1); }},
                    Calm{"PathologicalTremorAndCautious",
                         [](Session& s, Draw& d) {
                           tremble(s, d, 2);
                           cautious(s);
                         }},
                    Calm{"PushedIntoSaturation", [](Session& s, Draw&) { s.push = push(12); }},
                    Calm{"Pushed", [](Session& s, Draw&) { s.push = push(5); }},
                    Calm{"PushedAndCautious",
                         [](Session& s, Draw&) {
                           s.push = push(12);
                           cautious(s);
                         }},
                    Calm{"CoarseQuantum", [](Session& s, Draw&) { s.device["position_resolution"] = 2e-4; }},
                    Calm{"At100Hz",
                         [](Session& s, Draw& d) {
                           s.rate_hz = 100;
                           cautious(s);
                           tremble(s, d, 0.3);
                           s.push = push(12);
                         }},
                    Calm{"At250Hz",
                         [](Session& s, Draw& d) {
                           s.rate_hz = 250;
                           cautious(s);
                           tremble(s, d, 1);
                         }},
                    Calm{"At4kHz", [](Session& s, Draw&) { s.rate_hz = 4000; }}),
    [](const auto& calm) { return std::string(calm.param.name); });

TEST(ForceGuardInTheLoop, CalmsLoopsThatOscillate) {
  Draw draw(9);
  int softened = 0;
  for (int i = 0; i < 12; ++i) {
    Session session{.device = draw.device(),
                    .kp = draw.logarithmic(15e3, 30e3),
                    .softens = true,
                    .seed = static_cast<std::uint64_t>(i) + 1};
    const Watching outcome = play(session);
    EXPECT_LT(outcome.last_rms, 8e-5) << "session " << i << " with " << outcome.share << " of its feedback";
    if (outcome.share < 1) ++softened;
  }
  EXPECT_GE(softened, 8);
}

}  // namespace
}  // namespace haptrace
