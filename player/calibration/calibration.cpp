#include "player/calibration/calibration.h"

#include "base/error.h"
#include "control/design/cogging_fit.h"
#include "control/design/identification.h"
#include "control/design/inertia_identification.h"
#include "control/design/multisine.h"
#include "control/path/min_jerk.h"
#include "control/pd.h"
#include "player/calibration/calibration_plan.h"
#include "player/calibration/law_trial.h"
#include "player/calibration/workspace_trial.h"
#include "player/playback/approach.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <optional>
#include <span>
#include <utility>

namespace haptrace {
namespace {

constexpr double kPeriod = 1.5;    // period of the excitation signal [s]
constexpr double kLongPeriod = 2;  // period at low loop rates, which leave fewer lines per period [s]
// Swing size as a share of the reach. A hand that is dragged along the whole reach leaves hardly any force for friction
// and the excitation signal if it holds firmly: the device sticks, and its mass seems two or three times its true
// value.
constexpr double kSwingSize = 0.5;
constexpr double kSweepHz = 2.5;
constexpr double kLowestLine = 15;        // above what a hand does of its own accord, and most grips [Hz]
constexpr double kHighestLine = 120;      // [Hz]
constexpr double kLargestReach = 0.02;    // [m]
constexpr double kSmallestReach = 0.003;  // [m]
constexpr double kPlaceShare = 0.6;       // distance of a place from the centre, as a share of the room
constexpr double kFarthestPlace = 0.06;   // [m]
constexpr int kMostLeftOut = 2;           // number of places from which a hand may keep the device
constexpr double kLetGo = 0.5;       // share of the largest deviation at which a hand keeps the device from a place
constexpr double kPlaceGains = 0.7;  // of the gains for the mass at a place, which is known only roughly
constexpr double kLightest = 0.2;    // share of the mass at the centre down to which the gains follow it
// Share of the excitation at the centre that is left for a light device. Its friction is not smaller.
constexpr double kLeastDither = 0.4;
constexpr double kBlend = 0.3;             // in which a movement grows from nothing, or shrinks to it [s]
constexpr double kShortestApproach = 0.5;  // [s]
constexpr double kLook = 0.75;             // of the first look [s]
constexpr double kSettle = 0.4;            // from a change of the dither to the first window [s]
constexpr double kLookDither = 0.08;       // share of the largest force, rms per axis
constexpr double kMostDither = 0.12;
constexpr double kDitherOfForce = kMostDither / 0.7;  // share of the permitted force; peaks of three axes: 6 rms
constexpr double kLargestDither = 2;                  // rms per axis [N]
constexpr double kLargestForce = 15;                  // bound for strong devices [N]
constexpr double kDitherSpeed = 0.25;  // rms velocity from the excitation, as a share of the sweeps' peak speed
constexpr double kLeastMotion = 0.25;  // share of the requested speed below which a device counts as blocked

// Constants of a second, gentler session. It runs when the excitation of the first one did not move the device enough
// although the device moves in the direction of the force.
constexpr double kMostUnseen = 0.4;      // largest share of the force that the movement so far may leave unexplained
constexpr double kHeavy = 1;             // mass from which the velocity is low-passed further [kg]
constexpr double kGentleBandwidth = 25;  // bandwidth of the gains, low enough for any delay of a few samples [rad/s]
constexpr const char* kGentleVelocity = "lowpass:30";
constexpr double kInertiaShare = 0.4;  // share of the force that is available for acceleration

constexpr std::array<double, 3> kQuickSizes{1, 0.5, 1};
constexpr std::array<double, 16> kFullSizes{1, 0.5, 0.75, 0.35, 1, 0.5, 0.75, 0.35,
                                            1, 0.5, 0.75, 0.35, 1, 0.5, 0.75, 0.35};

// Pulses: strokes along an axis under an alternating force of rising size. The pulses change the speed by as much as
// the stroke has, so that the movement, and with it the friction, hardly ever reverses during a stroke.
constexpr double kPulsedHz = 2.5;                          // of the strokes
constexpr std::array<double, 3> kPulseSizes{0.4, 0.7, 1};  // of the largest pulse, one cycle of strokes each
constexpr double kPulseForce = 0.7;                        // share of the permitted force
constexpr double kPulseSpeed = 0.5;                        // share of the sweeps' peak speed
constexpr double kPulseGains = 0.35;  // of the gains at the centre: the feedback hardly answers the pulses
constexpr double kShortestPulse = 8e-3, kLongestPulse = 20e-3;  // [s]

std::span<const double> sweep_sizes(bool full) {
  return full ? std::span<const double>(kFullSizes) : std::span<const double>(kQuickSizes);
}

double dither_windows(bool full) {
  return full ? 8 : 2;
}

/// Returns the frequency of the swing [Hz]. Multisine has no lines at its harmonics.
double swing_hz(const CalibrationPlan& plan) {
  return 2 / plan.dither.period();
}

/// A triangle of period 1 and height 1 with rounded corners, and its slope.
struct RoundedTriangle {
  double value, slope;

  static RoundedTriangle at(double turns) noexcept {
    constexpr double kSharpness = 0.97;
    const double height = std::asin(kSharpness), s = kSharpness * std::sin(kTwoPi * turns);
    return {std::asin(s) / height, kTwoPi * kSharpness * std::cos(kTwoPi * turns) / (std::sqrt(1 - s * s) * height)};
  }
};

/// Response of the device at a few lines of the excitation signal, computed during the session with a Hann window.
class FirstLook {
 public:
  explicit FirstLook(const CalibrationPlan& plan) : axes_(plan.axes) {
    for (int axis = 0; axis < 3; ++axis) {
      if (!axes_[static_cast<std::size_t>(axis)]) continue;
      const std::vector<SpectralLine>& lines = plan.dither.lines(axis);
      for (std::size_t i = 0; i < kLines; ++i) {
        const auto nearest = std::min_element(lines.begin(), lines.end(), [&](const auto& a, const auto& b) {
          return std::abs(a.frequency_hz - kWanted[i]) < std::abs(b.frequency_hz - kWanted[i]);
        });
        sums_[static_cast<std::size_t>(axis)][i].w = kTwoPi * nearest->frequency_hz;
      }
    }
  }

  void reset() noexcept {
    for (auto& axis : sums_)
      for (Sum& sum : axis) sum = Sum{.w = sum.w};
    speed_ = asked_ = along_ = squares_ = Vec3::Zero();
    windows_ = 0;
  }

  /// Adds one sample. `share`: part of the window that has passed at `time`, 0 to 1. `hum`: excitation signal at `time`
  /// for 1 N rms per axis.
  void add(const State& state, double time, double share, const Vec3& speed_asked, const Vec3& hum) noexcept {
    const double window = 0.5 * (1 - std::cos(kTwoPi * share));
    windows_ += window;
    for (int axis = 0; axis < 3; ++axis) {
      if (!axes_[static_cast<std::size_t>(axis)]) continue;
      for (Sum& sum : sums_[static_cast<std::size_t>(axis)]) {
        const std::complex<double> turn = std::polar(window, -sum.w * time);
        sum.force += turn * std::polar(1.0, sum.w * state.dt) * state.force_applied[axis];
        sum.hum += turn * hum[axis];
        for (int i = 0; i < 3; ++i) sum.position[static_cast<std::size_t>(i)] += turn * state.position[i];
      }
      speed_[axis] += std::abs(state.velocity[axis]);
      asked_[axis] += std::abs(speed_asked[axis]);
      along_[axis] += window * state.velocity[axis] * speed_asked[axis];
      squares_[axis] += window * speed_asked[axis] * speed_asked[axis];
    }
  }

  /// Returns the apparent mass, the median over the lines [kg].
  [[nodiscard]] double mass(int axis) const noexcept {
    std::array<double, kLines> masses{};
    for (std::size_t i = 0; i < kLines; ++i) {
      const Sum& sum = sums_[static_cast<std::size_t>(axis)][i];
      masses[i] = std::abs(sum.force) /
                  (sum.w * sum.w * std::max(std::abs(sum.position[static_cast<std::size_t>(axis)]), 1e-9));
    }
    std::sort(masses.begin(), masses.end());
    return masses[kLines / 2];
  }

  /// Returns the lag of the response behind that of a mass, the median over the lines [s]. The damping of a hand makes
  /// it appear slightly larger.
  [[nodiscard]] double lag(int axis) const noexcept {
    std::array<double, kLines> lags{};
    for (std::size_t i = 0; i < kLines; ++i) {
      const Sum& sum = sums_[static_cast<std::size_t>(axis)][i];
      lags[i] = -std::arg(-sum.position[static_cast<std::size_t>(axis)] / sum.force) / sum.w;
    }
    std::sort(lags.begin(), lags.end());
    return std::max(lags[kLines / 2], 0.0);
  }

  /// Returns true when a force along `axis` moves the device in that direction. At these frequencies a mass moves
  /// against the force, late by a delay that is not known yet; the response is therefore compared with that of a mass
  /// of either sign at every delay. A hand that is stiff for the device's mass, or a link that swings, also responds
  /// like a mass of the wrong sign.
  [[nodiscard]] bool follows(int axis) const noexcept {
    constexpr double kLongest = 10e-3, kStep = 0.5e-3;  // [s]
    constexpr double kClearly = 1;                      // out of kLines
    const auto& sums = sums_[static_cast<std::size_t>(axis)];
    double with = -kLines, against = -kLines;
    for (double delay = 0; delay <= kLongest; delay += kStep) {
      double along = 0;
      for (const Sum& sum : sums)
        along += std::cos(std::arg(-sum.position[static_cast<std::size_t>(axis)] / sum.force) + sum.w * delay);
      with = std::max(with, along);
      against = std::max(against, -along);
    }
    double straight = 0, across = 0;
    for (const Sum& sum : sums)
      for (int i = 0; i < 3; ++i) {
        const double gain = std::abs(sum.position[static_cast<std::size_t>(i)]) * sum.w * sum.w / std::abs(sum.force);
        if (i == axis)
          straight += gain;
        else
          across = std::max(across, gain);
      }
    return against < with + kClearly && across < straight;
  }

  /// Returns true when the device goes with its reference under feedback. That shows the direction of the force where
  /// the excitation does not: a link that swings, or a hand that is stiff for the device's mass, turns the response at
  /// the lines, but not that to the slow movement. Feedback of the wrong sign drives the device the other way.
  [[nodiscard]] bool obeys(int axis) const noexcept {
    constexpr double kLeast = 0.6, kMost = 1.4;
    const double share = squares_[axis] > 0 ? along_[axis] / squares_[axis] : 0;
    return share > kLeast && share < kMost;
  }

  /// Returns true when the responses to the excitation along `axis` match those in `other`, an earlier look. The
  /// response of a device repeats, whatever its axes; movement from a hand's tremor or from encoder steps does not. The
  /// responses are compared with the excitation and not with the force: feedback turns part of every movement into
  /// force.
  [[nodiscard]] bool repeats(const FirstLook& other, int axis) const noexcept {
    constexpr double kAlike = 0.25;  // bound on |a - b| / (|a| + |b|); between independent responses its median is 0.7
    std::array<double, kLines> differences{};
    for (std::size_t line = 0; line < kLines; ++line) {
      const Sum &a = sums_[static_cast<std::size_t>(axis)][line],
                &b = other.sums_[static_cast<std::size_t>(axis)][line];
      double largest = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const std::complex<double> in_a = a.position[i] / a.hum, in_b = b.position[i] / b.hum;
        const double both = std::abs(in_a) + std::abs(in_b);
        if (!(both > largest)) continue;
        largest = both;
        differences[line] = std::abs(in_a - in_b) / both;
      }
    }
    std::sort(differences.begin(), differences.end());
    return differences[kLines / 2] < kAlike;
  }

  /// Returns the amplitude of the movement along `axis`, the median over the lines [m].
  [[nodiscard]] double amplitude(int axis) const noexcept {
    std::array<double, kLines> all{};
    for (std::size_t line = 0; line < kLines; ++line)
      all[line] = 2 * std::abs(sums_[static_cast<std::size_t>(axis)][line].position[static_cast<std::size_t>(axis)]) /
                  std::max(windows_, 1.0);
    std::sort(all.begin(), all.end());
    return all[kLines / 2];
  }

  /// Returns the mean speed divided by the mean requested speed.
  [[nodiscard]] double motion(int axis) const noexcept { return asked_[axis] > 0 ? speed_[axis] / asked_[axis] : 1; }

 private:
  static constexpr int kLines = 3;
  static constexpr std::array<double, kLines> kWanted{19, 29, 43};  // [Hz]

  struct Sum {
    double w = 0;
    std::complex<double> force{}, hum{};
    std::array<std::complex<double>, 3> position{};
  };

  std::array<bool, 3> axes_;
  std::array<std::array<Sum, kLines>, 3> sums_;
  Vec3 speed_ = Vec3::Zero(), asked_ = Vec3::Zero();
  Vec3 along_ = Vec3::Zero(), squares_ = Vec3::Zero();  ///< products of speed and requested speed
  double windows_ = 0;
};

/// Drives the device along the plan.
class CalibrationController final : public Controller {
 public:
  enum class Verdict { none, blocked, wrong_way, unclear, deviation };
  enum class Stage { approach, look, swing, sweep, pulse, travel, place, done };

  explicit CalibrationController(const CalibrationPlan& plan)
      : plan_(plan),
        look_(plan),
        before_(plan),
        there_(plan),
        sizes_(sweep_sizes(plan.full)),
        gains_(cautious_gains(std::min(plan.device_force, kLargestForce), plan.rate_hz)),
        swing_size_(swing_size(plan)),
        sweep_size_(plan.reach.cwiseMin(plan.max_speed / (4 * kSweepHz))) {}

  /// For a device of about `mass` [kg], which sets the damping and bounds the movement to the acceleration that the
  /// force allows. The response of the first look is not judged again: its excitation hardly moves a heavy device.
  CalibrationController(const CalibrationPlan& plan, const Vec3& mass) : CalibrationController(plan) {
    gentle_ = true;
    gains_ = {gains_.kp.cwiseMax(kGentleBandwidth * kGentleBandwidth * mass),
              (2 * gains_.kd).cwiseMax(1.4 * kGentleBandwidth * mass)};
    const double acceleration = kInertiaShare * plan.max_force / mass.maxCoeff();  // [m/s^2]
    // Peak acceleration of the swing, including its vertical movement at twice the frequency, and of a triangle's first
    // harmonic.
    swing_size_ = std::min(swing_size_, acceleration / (std::sqrt(5.0) * std::pow(kTwoPi * swing_hz(plan), 2)));
    sweep_size_ = sweep_size_.cwiseMin(acceleration / (0.81 * std::pow(kTwoPi * kSweepHz, 2)));
  }

  void start(const State& first) noexcept override {
    home_ = plan_.centre;
    for (int axis = 0; axis < 3; ++axis)
      if (!driven(axis)) home_[axis] = first.position[axis];
    around_ = home_;
    approach_ = Approach(first.position, home_, plan_.approach_speed, kShortestApproach);
  }

  [[nodiscard]] Command update(const State& state) noexcept override {
    const double now = 1e-9 * static_cast<double>(state.time_ns);
    advance(state, now);
    if ((stage_ == Stage::travel || stage_ == Stage::place) && place_ < plan_.places.size() &&
        driven_part(this->reference(now - began_).position - state.position).norm() > kLetGo * plan_.max_deviation)
      travel_on(state.position, now);
    if (stage_ == Stage::pulse &&
        driven_part(this->reference(now - began_).position - state.position).norm() > kLetGo * plan_.max_deviation)
      travel_to(plan_.places.size(), home_ + driven_part(state.position - home_), now);
    const Reference reference = this->reference(now - began_);
    dither_ += std::clamp(state.dt / kBlend, 0.0, 1.0) * (dither_wanted_ - dither_);

    Command command;
    command.reference = reference;
    command.phase = stage_ == Stage::approach ? Phase::approach : stage_ == Stage::done ? Phase::hold : Phase::run;
    Vec3 hum = Vec3::Zero();
    if (stage_ == Stage::look || stage_ == Stage::swing || stage_ == Stage::place)
      hum = dither_.cwiseProduct(plan_.dither.value(now));
    if (stage_ == Stage::pulse) hum[axis_] = pulse(now - began_);
    if (const double size = hum.norm(); size > plan_.max_force) hum *= plan_.max_force / size;
    Vec3 pull = driven_part(pd_force(gains_, state, reference));
    if (stage_ == Stage::pulse) {
      // Both pulses of a pair together leave the feedback its force, which the weight of the device needs.
      pull = within(pull + hum, plan_.max_force) - hum;
    } else {
      pull = within(pull, std::max(plan_.max_force - hum.norm(), 0.0));
    }
    command.wrench.force = pull + hum;
    command.feedforward = hum;

    const double deviation = driven_part(reference.position - state.position).norm();
    if (deviation > plan_.max_deviation && verdict_ == Verdict::none) {
      verdict_ = Verdict::deviation;
      command.event = Event{.code = EventCode::deviation_limit, .values = {deviation, plan_.max_deviation, kNaN}};
    }
    if (verdict_ != Verdict::none)
      command.status = Command::Status::deviation;
    else if (stage_ == Stage::done && now - began_ > kBlend)
      command.status = Command::Status::finished;
    return command;
  }

  [[nodiscard]] Verdict verdict() const noexcept { return verdict_; }
  [[nodiscard]] Stage stage() const noexcept { return stage_; }
  [[nodiscard]] int axis() const noexcept { return axis_; }  ///< axis of the verdict or of the sweep

  /// Returns the amplitude that the look measured along the axis of the verdict [m].
  [[nodiscard]] double amplitude() const noexcept { return look_.amplitude(axis_); }

  /// Returns the index of the place that is visited; of its measurement during Stage::place.
  [[nodiscard]] std::size_t place() const noexcept { return place_; }

  /// Returns true while the samples belong to a measurement.
  [[nodiscard]] bool measures() const noexcept { return measures_; }

 private:
  [[nodiscard]] bool driven(int axis) const noexcept { return plan_.axes[static_cast<std::size_t>(axis)]; }

  /// Returns `v`, shortened to `most` if it is longer.
  [[nodiscard]] static Vec3 within(const Vec3& v, double most) noexcept {
    const double size = v.norm();
    return size > most ? Vec3(most / size * v) : v;
  }

  [[nodiscard]] Vec3 driven_part(Vec3 v) const noexcept {
    for (int axis = 0; axis < 3; ++axis)
      if (!driven(axis)) v[axis] = 0;
    return v;
  }

  /// Returns the radius of the swing [m].
  static double swing_size(const CalibrationPlan& plan) {
    double size = kLargestReach;
    for (int axis = 0; axis < 3; ++axis)
      if (plan.axes[static_cast<std::size_t>(axis)]) size = std::min(size, plan.reach[axis]);
    return kSwingSize * size;
  }

  void enter(Stage stage, double now) noexcept {
    stage_ = stage;
    began_ = now;
    measures_ = false;
  }

  void next_sweep(double now) noexcept {
    const int axis = next_driven(stage_ == Stage::sweep ? axis_ + 1 : 0);
    if (axis < 3) {
      enter(Stage::sweep, now);
      axis_ = axis;
    } else {
      centre_gains_ = gains_;
      travel_to(0, now);
    }
  }

  void next_pulses(double now) noexcept {
    const int axis = next_driven(stage_ == Stage::pulse ? axis_ + 1 : 0);
    if (axis >= 3) return enter(Stage::done, now);
    gains_ = {kPulseGains * centre_gains_.kp, kPulseGains * centre_gains_.kd};
    enter(Stage::pulse, now);
    axis_ = axis;
    pulsed_ = true;
    // A pulse turns the speed of the movement by twice the share that the pulses have.
    const double turn = 2 * kPulseSpeed * plan_.max_speed * std::max(look_.mass(axis), 1e-3);  // [N s]
    const double force = kPulseForce * plan_.max_force;
    pulse_time_ = std::clamp(turn / force, kShortestPulse, kLongestPulse);
    pulse_force_ = std::min(force, turn / pulse_time_);
  }

  [[nodiscard]] int next_driven(int axis) const noexcept {
    while (axis < 3 && !driven(axis)) ++axis;
    return axis;
  }

  /// Ends the session with the pulses, unless they were tried. They come last: the monitor of vibrations may take the
  /// answer of the feedback to them for one, and soften it.
  void finish(double now) noexcept {
    if (plan_.pulses && !pulsed_)
      next_pulses(now);
    else
      enter(Stage::done, now);
  }

  /// Returns the force of the pulses `since` [s] after the strokes began [N].
  [[nodiscard]] double pulse(double since) const noexcept {
    const double turns = since * kPulsedHz - kSweepLead;
    if (turns < 0) return 0;
    const auto cycle = std::min(static_cast<std::size_t>(turns), kPulseSizes.size() - 1);
    const double phase = std::fmod(turns / kPulsedHz / pulse_time_ + 0.5, 2.0);  // the first pulse is half a one
    return (phase < 1 ? pulse_force_ : -pulse_force_) * kPulseSizes[cycle];
  }

  [[nodiscard]] static double pulsed_time() noexcept {
    return (kSweepLead + static_cast<double>(kPulseSizes.size())) / kPulsedHz;
  }

  void travel_to(std::size_t place, double now) noexcept { travel_to(place, around_, now); }

  void travel_to(std::size_t place, Vec3 from, double now) noexcept {
    place_ = place;
    const Vec3 share = kPlaceGains * expected_mass();
    gains_ = {share.cwiseProduct(centre_gains_.kp), share.cwiseProduct(centre_gains_.kd)};
    const bool another = place < plan_.places.size();
    around_ = another ? home_ + driven_part(plan_.places[place] - home_) : home_;
    travel_ = Approach(from, around_, plan_.approach_speed, kShortestApproach);
    if (another || from != around_)
      enter(Stage::travel, now);
    else
      finish(now);
  }

  /// Leaves out a place where the hand does not go, and all that are left once that has happened often.
  void travel_on(const Vec3& position, double now) noexcept {
    dither_wanted_ = Vec3::Zero();
    travel_to(++left_out_ > kMostLeftOut ? plan_.places.size() : place_ + 1, home_ + driven_part(position - home_),
              now);
  }

  [[nodiscard]] double place_time() const noexcept { return kSettle + plan_.dither.period(); }

  void advance(const State& state, double now) noexcept {
    const double since = now - began_;
    switch (stage_) {
      case Stage::approach:
        if (since < approach_.duration() + kBlend) break;
        enter(Stage::look, now);
        dither_wanted_ = driven_part(Vec3::Constant(kLookDither / kMostDither * plan_.max_dither));
        break;
      case Stage::look:
        if (since >= look_begin_ && since < look_begin_ + kLook)
          look_.add(state, now, (since - look_begin_) / kLook, reference(since).velocity, plan_.dither.value(now));
        else if (since >= look_begin_ + kLook)
          judge(now);
        break;
      case Stage::swing:
        // The reference continues where the look left it.
        measures_ = since >= swing_begin_ && since < swing_begin_ + swing_time();
        if (since >= swing_begin_ + swing_time()) dither_wanted_ = Vec3::Zero();
        if (since >= swing_begin_ + swing_time() + kBlend) next_sweep(now);
        break;
      case Stage::sweep:
        measures_ = since >= kSweepLead / kSweepHz && since < sweep_time();
        if (since >= sweep_time()) next_sweep(now);
        break;
      case Stage::pulse:
        measures_ = since >= kSweepLead / kPulsedHz && since < pulsed_time();
        if (since >= pulsed_time()) next_pulses(now);
        break;
      case Stage::travel:
        if (since < travel_.duration()) break;
        if (place_ >= plan_.places.size()) {
          finish(now);
        } else {
          enter(Stage::place, now);
          there_.reset();
          dither_wanted_ = dither_measured_.cwiseProduct(expected_mass().cwiseMax(kLeastDither));
        }
        break;
      case Stage::place:
        measures_ = since >= kSettle && since < place_time();
        if (measures_)
          there_.add(state, now, (since - kSettle) / plan_.dither.period(), reference(since).velocity,
                     plan_.dither.value(now));
        if (since >= place_time()) dither_wanted_ = Vec3::Zero();
        if (since >= place_time() + kBlend) {
          weigh();
          travel_to(place_ + 1, now);
        }
        break;
      case Stage::done:
        break;
    }
  }

  /// Returns the mass to be expected on the way to the next place and there, over that at the centre. The gains of the
  /// centre would make a much lighter device oscillate.
  [[nodiscard]] Vec3 expected_mass() const noexcept { return place_ < plan_.nearer_places ? Vec3::Ones() : lightest_; }

  /// Notes how light the device was at a place. It is taken to become lighter beyond the nearer places as it did before
  /// them.
  void weigh() noexcept {
    const bool near = place_ < plan_.nearer_places;
    for (int axis = 0; axis < 3; ++axis) {
      if (!driven(axis)) continue;
      const double share = there_.mass(axis) / look_.mass(axis), expected = near ? 2 * share - 1 : share;
      lightest_[axis] = std::clamp(expected, kLightest, lightest_[axis]);
    }
  }

  [[nodiscard]] double swing_time() const noexcept { return dither_windows(plan_.full) * plan_.dither.period(); }
  [[nodiscard]] double sweep_time() const noexcept {
    return (kSweepLead + static_cast<double>(sizes_.size())) / kSweepHz;
  }

  /// Judges the first look: checks that the device follows the force, then sets gains and excitation from its mass and
  /// lag.
  void judge(double now) noexcept {
    if (gentle_) return begin_swing(now, driven_part(Vec3::Constant(plan_.max_dither)));
    Vec3 dither = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      if (!driven(axis)) continue;
      const bool moves = look_.motion(axis) >= kLeastMotion;
      if (!moves || !(look_.follows(axis) || (stronger_ && look_.obeys(axis)))) {
        if (stronger_)
          return stop(!moves                         ? Verdict::blocked
                      : look_.repeats(before_, axis) ? Verdict::wrong_way
                                                     : Verdict::unclear,
                      axis);
        // Look once more, with twice the stiffness.
        stronger_ = true;
        gains_.kp *= 2;
        gains_.kd *= 1.5;
        before_ = look_;
        look_.reset();
        look_begin_ += kLook + kSettle;
        return;
      }
    }
    for (int axis = 0; axis < 3; ++axis) {
      if (!driven(axis)) continue;
      const double mass = look_.mass(axis);
      // The gains are stiff enough that the device follows the sweep instead of the direction of least friction.
      constexpr double kStiffest = kTwoPi * 12;  // [rad/s]
      constexpr double kFilterLag = 2.5e-3;      // delay of a usual velocity estimate [s]
      const double bandwidth = std::min(kStiffest, 0.45 / (look_.lag(axis) + kFilterLag));
      gains_.kp[axis] = std::max(gains_.kp[axis], mass * bandwidth * bandwidth);
      gains_.kd[axis] = std::max(gains_.kd[axis], 1.2 * mass * bandwidth);

      double response = 0;  // mean square speed of 1 kg under an excitation of 1 N rms
      for (const SpectralLine& line : plan_.dither.lines(axis))
        response += 0.5 * std::pow(line.amplitude / (kTwoPi * line.frequency_hz), 2);
      dither[axis] = std::clamp(kDitherSpeed * plan_.max_speed * mass / std::sqrt(response),
                                std::min(0.02 * plan_.device_force, plan_.max_dither), plan_.max_dither);
    }
    begin_swing(now, dither);
  }

  void begin_swing(double now, const Vec3& dither) noexcept {
    dither_wanted_ = dither_measured_ = dither;
    swing_begin_ = now - began_ + kSettle;
    stage_ = Stage::swing;
  }

  void stop(Verdict verdict, int axis) noexcept {
    verdict_ = verdict;
    axis_ = axis;
  }

  /// Returns the reference `since` [s] after the stage began. Look and swing are one movement.
  [[nodiscard]] Reference reference(double since) const noexcept {
    Reference r{.position = around_, .velocity = Vec3::Zero(), .acceleration = nan3()};
    switch (stage_) {
      case Stage::approach:
        return approach_.at(since);
      case Stage::travel:
        return travel_.at(since);
      case Stage::look:
      case Stage::swing:
      case Stage::place: {
        // Circle in x and y, with two vertical cycles per turn: no direction rests for long.
        const double w = kTwoPi * swing_hz(plan_), angle = w * since;
        const Vec3 place(std::cos(angle), std::sin(angle), 0.5 * std::sin(2 * angle));
        const Vec3 slope(-std::sin(angle), std::cos(angle), std::cos(2 * angle));
        const MinJerk in = MinJerk::at(since / kBlend);
        double size = in.s, growth = in.ds / kBlend;
        if (stage_ != Stage::look) {
          const double end = stage_ == Stage::swing ? swing_begin_ + swing_time() : place_time();
          const MinJerk out = MinJerk::at((since - end) / kBlend);
          growth = growth * (1 - out.s) - size * out.ds / kBlend;
          size *= 1 - out.s;
        }
        r.position += driven_part(swing_size_ * size * place);
        r.velocity = driven_part(swing_size_ * (size * w * slope + growth * place));
        break;
      }
      case Stage::sweep: {
        const double turns = since * kSweepHz;
        const auto cycle = static_cast<std::ptrdiff_t>(std::floor(turns - kSweepLead));
        const double size =
            sizes_[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(cycle, 0, std::ssize(sizes_) - 1))];
        const RoundedTriangle triangle = RoundedTriangle::at(turns);
        r.position[axis_] += sweep_size_[axis_] * size * triangle.value;
        r.velocity[axis_] = sweep_size_[axis_] * size * kSweepHz * triangle.slope;
        break;
      }
      case Stage::pulse: {
        const RoundedTriangle triangle = RoundedTriangle::at(since * kPulsedHz);
        const double size = std::min(kPulseSpeed * plan_.max_speed / (4 * kPulsedHz), plan_.reach[axis_]);
        r.position[axis_] += size * triangle.value;
        r.velocity[axis_] = size * kPulsedHz * triangle.slope;
        break;
      }
      case Stage::done:
        break;
    }
    return r;
  }

  static constexpr double kSweepLead = 0.5;  // cycles before the measurement of a sweep starts

  const CalibrationPlan& plan_;
  FirstLook look_, before_, there_;  ///< the current look, an earlier inconclusive one, and one at a place
  std::span<const double> sizes_;
  PdGains gains_, centre_gains_;
  Vec3 lightest_ = Vec3::Ones();  ///< smallest mass to be expected at a farther place, over that at the centre
  double swing_size_;
  Vec3 sweep_size_;

  Stage stage_ = Stage::approach;
  Verdict verdict_ = Verdict::none;
  int axis_ = 0;
  bool measures_ = false, stronger_ = false, gentle_ = false;
  Vec3 home_ = Vec3::Zero();
  Vec3 around_ = Vec3::Zero();  ///< centre of the movement
  std::size_t place_ = 0;
  bool pulsed_ = false;                                  ///< the pulses began
  int left_out_ = 0;                                     ///< places
  double pulse_force_ = 0, pulse_time_ = kLongestPulse;  ///< largest pulse of an axis [N], and its duration [s]
  Approach approach_, travel_;
  double began_ = 0, look_begin_ = kSettle, swing_begin_ = 0;
  Vec3 dither_ = Vec3::Zero(), dither_wanted_ = Vec3::Zero();  ///< rms per axis [N]
  Vec3 dither_measured_ = Vec3::Zero();                        ///< of the measurements
};

/// Stores the samples of a session and the ranges that belong to each measurement.
class CalibrationLog final : public SampleSink {
 public:
  CalibrationLog(const CalibrationController& controller, std::size_t rows) : controller_(controller) {
    rows_.reserve(rows);
    dithered_.reserve(4);
    for (auto& axis : sweeps_) axis.reserve(4);
    for (auto& axis : pulsed_) axis.reserve(1);
  }

  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    const TickRow row{1e-9 * static_cast<double>(sample.time_ns), sample.position, sample.force};
    bridge(row, sample.tick - std::exchange(tick_, sample.tick));
    if (rows_.size() == rows_.capacity()) return;
    rows_.push_back(row);
    const bool measures = controller_.measures();
    const CalibrationController::Stage stage = controller_.stage();
    const bool along_axis =
        stage == CalibrationController::Stage::sweep || stage == CalibrationController::Stage::pulse;
    const int axis = along_axis ? controller_.axis() : -1;
    if (!measures) {
      open_ = nullptr;
      return;
    }
    if (stage == CalibrationController::Stage::place) {
      const std::size_t place = controller_.place();
      if (place >= kMostPlaces) return;
      if (places_end_[place] == 0) places_begin_[place] = rows_.size() - 1;
      places_end_[place] = rows_.size();
      return;
    }
    if (open_ == nullptr || axis != axis_) {
      auto& of_axes = stage == CalibrationController::Stage::pulse ? pulsed_ : sweeps_;
      std::vector<Stretch>& list = axis < 0 ? dithered_ : of_axes[static_cast<std::size_t>(axis)];
      if (list.size() == list.capacity()) return;
      list.push_back({rows_.size() - 1, rows_.size()});
      open_ = &list.back();
      axis_ = axis;
    }
    open_->end = rows_.size();
  }

  [[nodiscard]] Experiment experiment(const CalibrationPlan& plan) const {
    std::vector<ExperimentPlace> places;
    const auto whole = static_cast<std::size_t>(0.95 * plan.dither.period() * plan.rate_hz);  // of rows
    for (std::size_t i = 0; i < plan.places.size(); ++i)
      if (places_end_[i] >= places_begin_[i] + whole)
        places.push_back({plan.places[i], {places_begin_[i], places_end_[i]}});
    return {.rows = rows_,
            .rate_hz = plan.rate_hz,
            .axes = plan.axes,
            .dither = &plan.dither,
            .dithered = dithered_,
            .centre = plan.centre,
            .places = std::move(places),
            .sweeps = sweeps_,
            .pulsed = pulsed_};
  }

  /// See shorten_forces().
  void shorten(double limit) { shorten_forces(rows_, limit); }

  /// Returns an experiment of all recorded samples, for a session that ended early.
  [[nodiscard]] Experiment whole(const CalibrationPlan& plan) const {
    return {.rows = rows_,
            .rate_hz = plan.rate_hz,
            .axes = plan.axes,
            .dither = nullptr,
            .dithered = {{0, rows_.size()}},
            .centre = plan.centre,
            .places = {},
            .sweeps = {},
            .pulsed = {}};
  }

 private:
  static constexpr std::uint64_t kBridged = 4;  ///< longest distance between two samples that is filled [ticks]

  /// Fills the few ticks before `next` that had no new sample or were missed: holds the last force and interpolates the
  /// position linearly.
  void bridge(const TickRow& next, std::uint64_t ticks) {
    if (rows_.empty() || ticks > kBridged) return;
    const TickRow last = rows_.back();
    for (std::uint64_t k = 1; k < ticks && rows_.size() < rows_.capacity(); ++k) {
      const double share = static_cast<double>(k) / static_cast<double>(ticks);
      rows_.push_back({last.time + share * (next.time - last.time),
                       last.position + share * (next.position - last.position), last.force});
    }
  }

  const CalibrationController& controller_;
  std::uint64_t tick_ = 0;  ///< tick of the last sample
  std::vector<TickRow> rows_;
  std::vector<Stretch> dithered_;
  std::array<std::vector<Stretch>, 3> sweeps_, pulsed_;
  static constexpr std::size_t kMostPlaces = 9;
  std::array<std::size_t, kMostPlaces> places_begin_{}, places_end_{};  ///< rows
  Stretch* open_ = nullptr;
  int axis_ = -1;
};

/// Returns why the session yields no design. `step`: position resolution [m], see position_quantum().
std::string reason_of(const CalibrationController& controller, const SessionResult& session, double step) {
  const char axis = "xyz"[controller.axis()];
  switch (controller.verdict()) {
    case CalibrationController::Verdict::blocked:
      return fmt::format(
          "the device hardly moves in {}: something blocks it, or its friction exceeds the permitted force; hold it "
          "loosely, or allow more force",
          axis);
    case CalibrationController::Verdict::wrong_way:
      return fmt::format(
          "a force in {} does not move the device in {} like a mass: the driver's axes have the wrong order or signs, "
          "the hand holds so light a device too firmly, or the mechanism resonates below 50 Hz; check the axes, and "
          "calibrate while the device is free",
          axis, axis);
    case CalibrationController::Verdict::unclear:
      if (const double seen = controller.amplitude(); seen < step)
        return fmt::format(
            "the encoder resolution is too coarse for the excitation: in {} the device moves by {:.3f} mm, and the "
            "position resolution is {:.3f} mm; allow more force (--force-share, --max-force), or set the gains "
            "yourself (play --kp, --kd)",
            axis, 1e3 * seen, 1e3 * step);
      return fmt::format(
          "the hand moved the device in {} more than the excitation did, so the response to the excitation is hidden "
          "by a tremor or a voluntary movement; calibrate while the device is free or the hand rests, or "
          "allow more force (--force-share, --max-force)",
          axis);
    case CalibrationController::Verdict::deviation:
      return "the device did not follow the calibration movement (" + session.servo.detail +
             "): hold it loosely and let it move; if the device was free, check the signs of the driver's axes";
    case CalibrationController::Verdict::none:
      break;
  }
  return session.servo.detail;
}

/// Returns the radius of the circle on which laws are tried [m].
double trial_radius(const CalibrationPlan& plan) {
  double radius = kSwingSize * kLargestReach;
  for (int axis = 0; axis < 3; ++axis)
    if (plan.axes[static_cast<std::size_t>(axis)]) radius = std::min(radius, kSwingSize * plan.reach[axis]);
  return radius;
}

/// Finds a design for a coarse model under which the device is stable.
void try_designs(Device& device, const CalibrationPlan& plan, const SessionOptions& session, const StopRequest& stop,
                 const Progress& progress, CalibrationResult& result) {
  constexpr std::array kBandwidths{1.0, 0.7, 0.5, 0.35};
  LawTrialOptions options{.centre = plan.centre,
                          .radius = trial_radius(plan),
                          .speed = plan.max_speed,
                          .max_deviation = plan.max_deviation,
                          .session = session};
  // The speed on the circle, including its vertical movement at twice the frequency, stays within what the force
  // allows.
  const double acceleration = kInertiaShare * plan.max_force / result.identification.plant.mass.maxCoeff();
  options.speed = std::min(options.speed, std::sqrt(acceleration * options.radius / std::sqrt(5.0)));
  options.session.loop.limits.max_force = plan.max_force;
  for (const double bandwidth : kBandwidths) {
    TrackingDesign design = design_tracking(
        result.identification.plant, {.rate_hz = plan.rate_hz, .max_force = plan.device_force, .bandwidth = bandwidth});
    // A trial shows stability only up to its own gains.
    design.largest = {(kTrialRaise * design.gains.kp).cwiseMin(kLargestKp),
                      (kTrialRaise * design.gains.kd).cwiseMin(kLargestKd)};
    const LawTrial trial = try_out(device, {result.identification.plant, design}, options, stop, progress);
    ++result.trials;
    if (trial.passed()) {
      result.design = design;
      result.bandwidth = bandwidth;
      result.reason.clear();
      return;
    }
    result.reason =
        fmt::format("{}; the trial of a control law for a coarse model failed: {}", result.doubt, trial.reason);
    const StopCause cause = trial.session.servo.cause;
    if (cause == StopCause::interrupted || cause == StopCause::device_lost) {
      result.session.servo.cause = cause;
      result.session.servo.detail = trial.session.servo.detail;
      return;
    }
  }
}

/// Ends a calibration after its first session: there is no profile then.
void end_early(StopCause cause, const std::string& reason, CalibrationResult& result) {
  result.session.servo.cause = cause;
  result.session.servo.detail = result.reason = reason;
  result.design.reset();
  result.held.reset();
}

/// Tries the laws at the centre and at places that the device reached before, and notes in the result what came of it.
class LawTrials {
 public:
  /// Borrows everything but the places.
  LawTrials(Device& device, const CalibrationPlan& plan, const std::vector<ExperimentPlace>& places,
            const CalibrationOptions& options, const StopRequest& stop, const Progress& progress,
            CalibrationResult& result)
      : device_(device),
        plan_(plan),
        options_(options),
        stop_(stop),
        progress_(progress),
        result_(result),
        tour_{.places = {plan.centre},
              .radius = trial_radius(plan),
              .speed = plan.max_speed,
              .max_deviation = plan.max_deviation,
              .session = options.session},
        most_ripple_(kMostRipple * plan.device_force) {
    const auto farthest = std::span(plan.places).subspan(plan.nearer_places);
    for (const ExperimentPlace& place : places)
      if (std::ranges::find(farthest, place.position) != farthest.end()) tour_.places.push_back(place.position);
    tour_.session.loop.limits.max_force = plan.max_force;
  }

  /// A law that fails is designed again for a mass that differs more; if that fails too, the softer ones are tried.
  /// Returns early if the user or the device ends it.
  void run() {
    if (!try_plain() || !judge_firmness(Firmness::normal)) return;
    if (is_refused(Firmness::normal) && !result_.held->one_mass) {
      result_.held->one_mass = true;
      if (!design_laws(*result_.held, plan_.rate_hz, stop_, options_.searching))
        return end_early(StopCause::interrupted, "interrupted while laws were searched", result_);
      if (!judge_firmness(Firmness::normal)) return;
    }
    const bool refused = is_refused(Firmness::normal);
    if ((refused || options_.full) && !judge_firmness(Firmness::quiet)) return;
    if (options_.full && !judge_firmness(Firmness::exact)) return;
    if (!refused) return;
    refuse_unless_worthwhile(result_.held->design(Firmness::quiet).verdict);
    if (!is_refused(Firmness::quiet)) return;
    law_.law = TrackingLaw::observer;
    law_.firmness.reset();
    if (!judge(result_.design->ripple, result_.held->observer)) return;
    refuse_unless_worthwhile(result_.held->observer);
  }

 private:
  static constexpr double kMostRipple = 0.04;  ///< share of the largest force
  static constexpr double kStiffMargin = 1.2;  ///< of stiff PD control on the free device
  static constexpr double kWorthwhile = 2;     ///< least improvement of a law after another one was refused

  [[nodiscard]] TourResult tried() {
    law_.identified = result_.identified();
    return toured(device_, law_, tour_, stop_, progress_);
  }

  /// Returns true if the user or the device ended the tour, and then ends the calibration.
  [[nodiscard]] bool ended(const TourResult& toured) {
    const StopCause cause = toured.session.servo.cause;
    if (cause != StopCause::interrupted && cause != StopCause::device_lost) return false;
    end_early(cause, "the trial of the laws ended early: " + toured.session.servo.detail, result_);
    return true;
  }

  /// Tries plain PD control, with which the laws are compared. No law may be worse than stiff PD control, if the device
  /// stays stable under it. Returns false if the user or the device ended it.
  [[nodiscard]] bool try_plain() {
    law_.compensations = {};
    std::optional<TourResult> plain;
    if (is_stable(result_.identification.plant, stiff_gains(), kStiffMargin, plan_.rate_hz)) {
      const PdGains designed = std::exchange(result_.design->plain, stiff_gains());
      plain = tried();
      if (ended(*plain)) return false;
      if (!plain->finished() || plain->oscillations > 0 || std::ranges::max(plain->ripple) > most_ripple_) {
        result_.design->plain = designed;
        plain.reset();
      }
    }
    if (!plain) plain = tried();
    if (ended(*plain)) return false;
    plain_ = std::move(*plain);
    law_.compensations = PlayOptions{}.compensations;
    return true;
  }

  /// Tries the law and sets its verdict. Returns false if the user or the device ended it.
  [[nodiscard]] bool judge(double predicted_ripple, LawVerdict& verdict) {
    const TourResult toured = tried();
    if (ended(toured)) return false;
    verdict = {.tried = true,
               .improvement = plain_.finished() && toured.finished() ? least_improvement(toured, plain_) : 0,
               .refused = refusal_of(toured, plain_, tour_,
                                     std::hypot(std::max(2 * predicted_ripple, most_ripple_), cogging_ripple()))};
    return true;
  }

  /// Returns the rms of the force that compensates for cogging while the device moves [N].
  [[nodiscard]] double cogging_ripple() const {
    double squares = 0;
    if (const auto& cogging = result_.identification.plant.cogging)
      for (const CoggingWave& wave : cogging->waves) squares += 0.5 * std::pow(wave.amplitude(), 2);
    return std::sqrt(squares);
  }

  /// Judges the LQG law of this firmness, as judge() does.
  [[nodiscard]] bool judge_firmness(Firmness firmness) {
    law_.law = TrackingLaw::lqg;
    law_.firmness = firmness;
    LqgDesign& design = result_.held->design(firmness);
    return judge(design.figures.ripple, design.verdict);
  }

  /// Refuses a law that would come second, but is hardly better than plain PD control at some place. The model failed
  /// on this device, and plain PD control that learns follows at least as well.
  static void refuse_unless_worthwhile(LawVerdict& verdict) {
    if (!verdict.refused.empty() || !(verdict.improvement > 0) || verdict.improvement >= kWorthwhile) return;
    verdict.refused = fmt::format(
        "another one was refused, and at one place this one is only {:.2f} times as accurate as plain PD control",
        verdict.improvement);
  }

  [[nodiscard]] bool is_refused(Firmness firmness) const {
    return !result_.held->design(firmness).verdict.refused.empty();
  }

  Device& device_;
  const CalibrationPlan& plan_;
  const CalibrationOptions& options_;
  const StopRequest& stop_;
  const Progress& progress_;
  CalibrationResult& result_;
  WorkspaceTour tour_;
  double most_ripple_;  ///< [N]
  PlayOptions law_;
  TourResult plain_;  ///< of plain PD control
};

/// Returns half of the width of the workspace along an axis [m].
double half_width(const DeviceInfo& device, int axis) {
  return 0.5 * (device.workspace_max[axis] - device.workspace_min[axis]);
}

/// Sets the centre and the reach along every axis of the plan. Throws Error(input) if the workspace is too small.
void set_reach(const DeviceInfo& device, CalibrationPlan& plan) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!plan.axes[static_cast<std::size_t>(axis)]) continue;
    const double room = half_width(device, axis);
    plan.centre[axis] = 0.5 * (device.workspace_max[axis] + device.workspace_min[axis]);
    plan.reach[axis] = std::min(kLargestReach, 0.4 * room);
    if (!(plan.reach[axis] >= kSmallestReach))
      throw input_error(fmt::format("the workspace of {} is {:.1f} mm wide in {}: calibration needs at least {:.0f} mm",
                                    device.name, 2e3 * room, "xyz"[axis], 2e3 * kSmallestReach / 0.4));
  }
}

/// Adds the places around the centre, first the nearer and then the farthest ones.
void add_places(const DeviceInfo& device, CalibrationPlan& plan) {
  // Opposite places of an axis are not visited one after the other.
  std::vector<Vec3> farthest;
  for (const double side : {1.0, -1.0})
    for (int axis = 0; axis < 3; ++axis) {
      if (!plan.axes[static_cast<std::size_t>(axis)]) continue;
      if (const double off = std::min(kPlaceShare * half_width(device, axis), kFarthestPlace); off > plan.reach[axis])
        farthest.push_back(plan.centre + side * off * Vec3::Unit(axis));
    }
  // Places half as far away show how the mass goes there, and what to expect beyond. One along each axis is enough.
  for (const Vec3& place : farthest) {
    const Vec3 half = 0.5 * (place - plan.centre);
    Eigen::Index axis = 0;
    if (const double off = half.cwiseAbs().maxCoeff(&axis); off > plan.reach[axis] && (half[axis] > 0) == (axis != 1))
      plan.places.push_back(plan.centre + half);
  }
  plan.nearer_places = plan.places.size();
  plan.places.insert(plan.places.end(), farthest.begin(), farthest.end());
}

/// Returns the duration of the planned session [s].
double planned_duration(const CalibrationPlan& plan) {
  const auto axes = static_cast<int>(std::ranges::count(plan.axes, true));
  const double sweep = 0.5 + static_cast<double>(sweep_sizes(plan.full).size());
  double duration =
      3 * kBlend + 2 * kSettle + kLook + dither_windows(plan.full) * plan.dither.period() + axes * sweep / kSweepHz;
  if (plan.pulses) duration += axes * (0.5 + static_cast<double>(kPulseSizes.size())) / kPulsedHz;
  Vec3 from = plan.centre;
  for (const Vec3& place : plan.places) {
    duration += Approach(from, place, plan.approach_speed, kShortestApproach).duration() + kSettle +
                plan.dither.period() + kBlend;
    from = place;
  }
  if (!plan.places.empty()) duration += Approach(from, plan.centre, plan.approach_speed, kShortestApproach).duration();
  return duration;
}

}  // namespace

double farthest_place(const CalibrationPlan& plan) {
  double farthest = 0;
  for (const Vec3& place : plan.places) farthest = std::max(farthest, (place - plan.centre).norm());
  return farthest;
}

CalibrationPlan plan_calibration(const DeviceInfo& device, const CalibrationOptions& options) {
  const double rate = options.session.loop.rate_hz;
  if (!(options.force_share >= 0.1 && options.force_share <= 1))
    throw input_error(fmt::format("the share of the force is {}; it must be from 0.1 to 1", options.force_share));
  if (!device.force_axes[0] && !device.force_axes[1] && !device.force_axes[2])
    throw input_error(device.name + " takes no force: there is nothing to calibrate");
  const double asked = options.session.loop.limits.max_force;
  double force = device.max_force;
  if (asked > 0) force = force > 0 ? std::min(force, asked) : asked;
  if (!(force > 0))
    throw input_error(fmt::format("{} does not state its largest force; give it with --max-force", device.name));

  const double highest = std::min(kHighestLine, rate / 6);
  const double most = std::min(options.force_share * force, kLargestForce);
  CalibrationPlan plan{
      .full = options.full,
      .rate_hz = rate,
      .axes = device.force_axes,
      .max_force = most,
      .device_force = force,
      .max_dither = std::min({kMostDither * force, kDitherOfForce * most, kLargestDither}),
      .dither = Multisine(kLowestLine, highest, highest < kHighestLine ? kLongPeriod : kPeriod, device.force_axes)};
  set_reach(device, plan);
  plan.pulses = options.places;
  if (options.places) add_places(device, plan);
  plan.max_speed = kTwoPi * plan.reach.maxCoeff();  // one circle with the radius of the reach per second
  plan.max_deviation = std::max(2 * plan.reach.maxCoeff(), 0.02);
  plan.duration = planned_duration(plan);
  return plan;
}

namespace {

/// One calibration of a device: its sessions, and what they yield.
class CalibrationRun {
 public:
  /// Borrows everything. Throws what plan_calibration throws.
  CalibrationRun(Device& device, const CalibrationOptions& options, const StopRequest& stop, const Progress& progress)
      : device_(device),
        options_(options),
        stop_(stop),
        progress_(progress),
        plan_(plan_calibration(device.info(), options)) {}

  CalibrationResult run() {
    CalibrationController controller(plan_);
    CalibrationLog log(controller, rows());
    if (measured(controller, log, options_.session)) {
      take_model(identify(log.experiment(plan_)));
      if (result_.identification.fits) {
        design(log.experiment(plan_));
        return std::move(result_);
      }
      result_.doubt = result_.identification.reason;
      take_model(identify_coarsely(log.experiment(plan_)));
    } else if (controller.verdict() == CalibrationController::Verdict::none || !measured_again(log.whole(plan_))) {
      return std::move(result_);
    }
    if (result_.identification.fits)
      try_designs(device_, plan_, options_.session, stop_, progress_, result_);
    else
      result_.reason = result_.doubt + "; " + result_.identification.reason;
    return std::move(result_);
  }

 private:
  /// Returns the number of rows to keep of a session.
  [[nodiscard]] std::size_t rows() const {
    constexpr double kSpare = 20;  // for the approach to the centre and a second look [s]
    return static_cast<std::size_t>((plan_.duration + kSpare) * plan_.rate_hz);
  }

  /// Runs a session. Returns true if it came to its end.
  [[nodiscard]] bool measured(CalibrationController& controller, CalibrationLog& log, const SessionOptions& session) {
    SampleSink* const sinks[] = {&log};
    result_.session = run_session(device_, controller, {.reference = true}, sinks, session, stop_, progress_);
    result_.reason = result_.session.servo.cause != StopCause::finished
                         ? reason_of(controller, result_.session, position_quantum(log.whole(plan_).rows))
                         : std::string();
    if (!result_.reason.empty()) return false;
    take_motors(log);
    return true;
  }

  /// Finds the force of the motors. If it is below what was asked of them, gives the rows the force that acted, and
  /// bounds all that follows.
  void take_motors(CalibrationLog& log) {
    const MotorLimit& motors = result_.motors = identify_motor_limit(log.experiment(plan_));
    if (!(motors.force > 0)) return;
    log.shorten(motors.force);
    result_.session.warn(Severity::warning, "motor_limit",
                         fmt::format("the motors gave at most {:.2f} +- {:.2f} N of the {:.2f} N that were sent: they "
                                     "saturate below the force that the device states. Sessions with this profile "
                                     "send no more",
                                     motors.force, motors.half_width, motors.tried));
    plan_.device_force = std::min(plan_.device_force, motors.force);
    plan_.max_force = std::min(plan_.max_force, motors.force);
  }

  void take_model(Identification identified) {
    identified.plant.motor_limit = result_.motors.force;
    identified.half_width.motor_limit = result_.motors.half_width;
    result_.identification = std::move(identified);
  }

  /// Designs the laws for a full model, and tries them.
  void design(Experiment experiment) {
    std::vector<TickRow> rows;
    if (const PlantModel& plant = result_.identification.plant; plant.cogging) {
      rows = without_cogging(experiment, *plant.cogging, plant.delay);
      experiment.rows = rows;
    }
    result_.design =
        design_tracking(result_.identification.plant, {.rate_hz = plan_.rate_hz, .max_force = plan_.device_force});
    if (!options_.laws) return;
    HeldDevice held = held_device(result_.identification, identify_held(experiment, result_.identification),
                                  plan_.rate_hz, plan_.device_force);
    held.inertia = identify_inertia(experiment, result_.identification);
    held.one_mass = plan_.places.empty() || experiment.places.size() < plan_.places.size();
    if (!design_laws(held, plan_.rate_hz, stop_, options_.searching))
      return end_early(StopCause::interrupted, "interrupted while laws were searched", result_);
    result_.held.emplace(std::move(held));
    if (options_.places) LawTrials(device_, plan_, experiment.places, options_, stop_, progress_, result_).run();
  }

  /// Runs a gentler session, with the mass that the `first` one showed before it ended early, and makes a coarse model
  /// of it. Returns false if there is none.
  [[nodiscard]] bool measured_again(const Experiment& first) {
    const Identification seen = identify_coarsely(first);
    if (!seen.fits || seen.line_residual > kMostUnseen) return false;
    result_.doubt = fmt::format("the device has a mass of about {:.2f} kg and could not be excited: {}",
                                seen.plant.mass.maxCoeff(), result_.reason);
    SessionOptions gentle = options_.session;
    if (seen.plant.mass.maxCoeff() > kHeavy) gentle.velocity = kGentleVelocity;
    gentle.recording.reset();
    SessionResult before = std::move(result_.session);
    CalibrationController controller(plan_, seen.plant.mass);
    CalibrationLog log(controller, rows());
    const bool finished = measured(controller, log, gentle);
    result_.session.recording = before.recording;
    result_.session.recording_error = std::move(before.recording_error);
    std::vector<Warning>& warnings = result_.session.warnings;
    warnings.insert(warnings.begin(), before.warnings.begin(), before.warnings.end());
    if (finished) take_model(identify_coarsely(log.experiment(plan_)));
    return finished;
  }

  Device& device_;
  const CalibrationOptions& options_;
  const StopRequest& stop_;
  const Progress& progress_;
  CalibrationPlan plan_;
  CalibrationResult result_;
};

}  // namespace

CalibrationResult calibrate(Device& device, const CalibrationOptions& given, const StopRequest& stop,
                            const Progress& progress) {
  // The motors stay warm between the sessions of a calibration.
  CalibrationOptions options = given;
  MotorHeat motors;
  if (options.session.loop.motors == nullptr) options.session.loop.motors = &motors;
  return CalibrationRun(device, options, stop, progress).run();
}

}  // namespace haptrace
