#include "control/design/tracking_design.h"

#include "base/error.h"
#include "control/design/axis_model.h"
#include "control/design/loop_analysis.h"
#include "control/filters.h"
#include "control/ripple.h"
#include "control/state_observer.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

namespace haptrace {
namespace {

constexpr double kMassFactor = 1.1;  // mass of the observer over the identified mass
constexpr double kFrequency = 0.4;   // bandwidth w times (delay + period)
constexpr double kDampingRatio = 0.75;
constexpr double kObserverFactor = 1.5;  // observer poles over w
// Bandwidth of the load compensation [Hz]. A heavy hand on a stiff grip makes a light device two and a half times as
// heavy below its resonance near 10 Hz. A compensation as fast as that leaves almost no damping there.
constexpr double kLoad = 5;
constexpr double kAuthority = 0.7;   // fraction of the device's maximum force
constexpr double kLargestRaise = 3;  // higher gains only cause vibration
constexpr double kMargin = 2;        // stable gains over design gains
// Ripple of a closed loop over that of the open loop, measured on simulated devices.
constexpr double kRippleRise = 1.11, kPlainRippleRise = 1.29;
// Assumed difference between a real device and the identified model: it is lighter and responds later.
constexpr double kLighter = 0.8;
constexpr double kLater = 0.5;  // [ticks]

constexpr double kPlainVelocityCutoff = 100;  // [Hz]

std::string plain_velocity() {
  return fmt::format("lowpass:{:g}", kPlainVelocityCutoff);
}

/// Returns the rms of the high-passed output of a linear law for white noise of unit variance, computed from its
/// impulse response.
double noise_gain(double rate_hz, const std::function<double(double)>& law) {
  Ripple ripple(kRippleCutoff, rate_hz);
  double energy = 0;
  const int ticks = static_cast<int>(0.3 * rate_hz);
  for (int tick = 0; tick < ticks; ++tick) energy += ripple.update(Vec3(law(tick == 0 ? 1 : 0), 0, 0));
  return std::sqrt(energy);
}

/// Returns the ripple of the plain law with an open loop, like noise_gain().
double open_plain_ripple(double rate_hz) {
  Butterworth2 low_pass(Butterworth2::Kind::low_pass, kPlainVelocityCutoff, rate_hz);
  const PdGains stiff = stiff_gains();
  double before = 0;
  return noise_gain(rate_hz, [&](double x) {
    const double velocity = low_pass.update((x - before) * rate_hz);
    before = x;
    return stiff.kp.x() * x + stiff.kd.x() * velocity;
  });
}

/// One axis of the law for unit mass. The gains scale with the mass.
struct UnitLaw {
  double w;  ///< [rad/s]
  double delay, rate_hz;

  [[nodiscard]] double kp() const { return w * w; }
  [[nodiscard]] double kd() const { return 2 * kDampingRatio * w; }
  [[nodiscard]] StateObserver observer() const {
    return StateObserver({.mass = Vec3(kMassFactor, 0, 0),
                          .delay = delay,
                          .bandwidth_hz = kObserverFactor * w / (2 * std::numbers::pi),
                          .rate_hz = rate_hz});
  }
};

/// Returns the ripple of the command above 25 Hz for white noise of unit variance in the position [N/m per kg].
double ripple(const UnitLaw& law) {
  StateObserver observer = law.observer();
  return noise_gain(law.rate_hz, [&](double x) {
    observer.update(Vec3(x, 0, 0), 1 / law.rate_hz, Vec3::Zero(), Vec3::Zero());
    const StateObserver::Estimate estimate = observer.now();
    return law.kp() * estimate.position.x() + law.kd() * estimate.velocity.x() - estimate.load.x();
  });
}

/// Returns whether the loop of a free mass settles after a push when its PD gains are `factor` times those of the law.
/// The mass is lighter and responds later than the unit mass in the law.
bool calms_down(const UnitLaw& law, double factor) {
  StateObserver observer = law.observer();
  const double period = 1 / law.rate_hz;
  const double delay = law.delay * law.rate_hz + kLater;  // full delay, even if the observer models less
  const auto whole = static_cast<std::size_t>(delay);
  const double part = delay - static_cast<double>(whole);
  std::vector<double> sent(whole + 2, 0.0);  // newest first
  double x = 0, v = 1, load = 0, sum = 0, late = 0;
  const double blend = low_pass_share_at(kLoad, period);
  observer.start(Vec3::Zero());
  const int ticks = static_cast<int>(60 / (law.w * period)) + 40 * static_cast<int>(whole + 1);
  for (int tick = 0; tick < ticks; ++tick) {
    observer.update(Vec3(x, 0, 0), tick == 0 ? 0 : period, Vec3(sent[0], 0, 0), Vec3::Zero());
    const StateObserver::Estimate estimate = observer.ahead();
    load += blend * (estimate.load.x() - load);
    const double force = -factor * (law.kp() * estimate.position.x() + law.kd() * estimate.velocity.x()) + load;
    std::rotate(sent.rbegin(), sent.rbegin() + 1, sent.rend());
    sent[0] = force;
    // The force is held from this tick on and arrives `part` of a period after a tick.
    for (const auto& [u, h] : {std::pair{sent[whole + 1], part * period}, {sent[whole], (1 - part) * period}}) {
      x += h * v + 0.5 * h * h * u / kLighter;
      v += h * u / kLighter;
    }
    if (!(std::abs(x) < 1e6)) return false;
    (4 * tick < 3 * ticks ? sum : late) += v * v;
  }
  return late < 0.02 * sum;
}

/// Returns the factor by which the PD gains can grow before the free device becomes unstable.
double gain_margin(const UnitLaw& law) {
  double stable = 1, unstable = 16;
  if (!calms_down(law, stable)) return 0;
  if (calms_down(law, unstable)) return unstable;
  for (int i = 0; i < 12; ++i) {
    const double middle = std::sqrt(stable * unstable);
    (calms_down(law, middle) ? stable : unstable) = middle;
  }
  return stable;
}

/// Returns gains for a plain PD law: at most half of those with which the free device is still stable.
PdGains plain_gains(const PlantModel& plant, const PdGains& designed, double rate_hz) {
  PdGains plain = designed;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(plant.mass[axis] > 0)) continue;
    const LoopAnalysis loop(loop_of(plant, axis, rate_hz, plain_velocity()));
    plain.kd[axis] = std::min(plain.kd[axis], 0.5 * loop.most_damped(0.1 * designed.kp[axis]));
    plain.kp[axis] = std::min(plain.kp[axis], 0.5 * loop.stiffest(plain.kd[axis]));
    if (const double bears = loop.margins(plain.kp[axis], plain.kd[axis]).gain_up; bears < kMargin) {
      plain.kp[axis] *= bears / kMargin;
      plain.kd[axis] *= bears / kMargin;
    }
  }
  return plain;
}

}  // namespace

PdGains stiff_gains() {
  return {Vec3::Constant(3000), Vec3::Constant(25)};
}

bool is_stable(const PlantModel& plant, const PdGains& gains, double margin, double rate_hz) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!(plant.mass[axis] > 0)) continue;
    const LoopAnalysis loop(loop_of(plant, axis, rate_hz, plain_velocity()));
    if (!(loop.margins(gains.kp[axis], gains.kd[axis]).gain_up >= margin)) return false;
  }
  return true;
}

double plain_ripple(double rate_hz) {
  return kPlainRippleRise * open_plain_ripple(rate_hz);
}

TrackingDesign design_tracking(const PlantModel& plant, const DesignOptions& options) {
  for (const double mass : plant.mass) check_range("tracking design: the mass", mass, 0, 1e6, "kg");
  check_range("tracking design: the delay", plant.delay, 0, 1e6, "s");
  check_range("tracking design: the position resolution", plant.position_resolution, 0, 1, "m");
  check_range("tracking design: the position noise", plant.position_noise, 0, 1, "m");
  check_range("tracking design: the rate", options.rate_hz, 1, 1e6, "Hz");
  check_range("tracking design: the largest force", options.max_force, 0, 1e9, "N");
  if (!(plant.mass.maxCoeff() > 0)) throw input_error("a tracking law cannot be designed: the plant has no mass");
  const double rate_hz = options.rate_hz;
  if (const double ticks = plant.delay * rate_hz; !(ticks <= LoopAnalysis::kLongestDelay))
    throw input_error(fmt::format(
        "a tracking law cannot be designed: the plant's delay of {:.4g} ms is {:.0f} ticks at {} Hz, but the design "
        "compensates for at most {}; choose a rate of at most {:.0f} Hz",
        1e3 * plant.delay, ticks, rate_hz, LoopAnalysis::kLongestDelay, LoopAnalysis::kLongestDelay / plant.delay));
  const double noise = measured_noise(plant);
  const double allowed = options.max_ripple > 0 ? options.max_ripple / noise : std::sqrt(3.0) * plain_ripple(rate_hz);

  UnitLaw law{.w = kFrequency / (plant.delay + 1 / rate_hz), .delay = plant.delay, .rate_hz = rate_hz};
  double margin = gain_margin(law);
  for (int i = 0; i < 200 && margin < kMargin; ++i) {
    law.w *= 0.97;
    margin = gain_margin(law);
  }
  const auto expected = [&] { return kRippleRise * plant.mass.norm() * ripple(law); };
  if (noise > 0)
    for (int i = 0; i < 200 && expected() > allowed; ++i) law.w *= 0.98;
  law.w *= options.bandwidth;

  TrackingDesign design;
  design.gains = {(law.kp() * plant.mass).cwiseMin(kLargestKp), (law.kd() * plant.mass).cwiseMin(kLargestKd)};
  const double more = std::clamp(gain_margin(law) / kMargin, 1.0, kLargestRaise);
  design.largest = {(more * design.gains.kp).cwiseMin(kLargestKp), (more * design.gains.kd).cwiseMin(kLargestKd)};
  design.plain = plain_gains(plant, design.gains, rate_hz);
  design.mass = kMassFactor * plant.mass;
  design.delay = plant.delay;
  design.observer_hz = kObserverFactor * law.w / (2 * std::numbers::pi);
  design.load_hz = kLoad;
  design.authority = kAuthority * options.max_force;
  design.ripple = noise * expected();
  return design;
}

}  // namespace haptrace
