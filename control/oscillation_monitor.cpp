#include "control/oscillation_monitor.h"

#include "base/error.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

using std::numbers::pi, std::numbers::sqrt2;

constexpr double kLowest = 8, kHighest = 120;  // edges of the band [Hz]
constexpr double kHighestOfRate = 0.4;         // largest upper edge, as a share of the rate
constexpr double kSmallestQuantum = 5e-5;      // smallest resolution that is used: no smaller ripple matters [m]
constexpr double kLongestGap = 5;              // [ticks]
constexpr double kLowestFrequency = 9;         // [Hz]
constexpr double kFewCycles = 15;              // frequency below which a window holds few cycles [Hz]
constexpr unsigned kLastThree = 0b111;         // judgements of which two make a verdict,
constexpr unsigned kLastFour = 0b1111;         // or, with few cycles, of which all do
constexpr double kFading = 0.7;                // share of the amplitude of the first half
constexpr double kPowerFactor = 0.02;          // share of the product of the rms of force and velocity
constexpr double kOfInertia = 0.5;             // share of the force that would accelerate the mass alone
constexpr double kEnergy = 2;                  // [F q]
constexpr double kRipple = 0.9;                // rms [q]
constexpr double kRippleEnergy = 0.55;         // energy times rms [F q^2]
constexpr double kForce = 0.25;                // rms [F]
constexpr double kForceFrequency = 20;         // [Hz]

}  // namespace

void validate(const OscillationMonitorOptions& options) {
  const auto check = [](const char* name, double value, bool good, const char* range) {
    if (!good) throw input_error(fmt::format("oscillation monitor: the {} is {}; it must be {}", name, value, range));
  };
  const auto within = [](double value, double least, double most) { return value >= least && value <= most; };
  check("rate [Hz]", options.rate_hz, within(options.rate_hz, 10, 20000), "from 10 to 20000");
  check("largest force [N]", options.max_force, options.max_force > 0 && std::isfinite(options.max_force), "above 0");
  check("delay [s]", options.delay, within(options.delay, 0, 0.1), "from 0 to 0.1");
  check("position resolution [m]", options.position_resolution, within(options.position_resolution, 0, 1),
        "from 0 to 1");
  check("mass [kg]", options.mass, within(options.mass, 0, 1e3), "from 0 to 1000");
}

OscillationMonitor::Sums& OscillationMonitor::Sums::operator+=(const Sums& other) noexcept {
  position += other.position;
  step += other.step;
  force += other.force;
  energy += other.energy;
  elastic += other.elastic;
  swing += other.swing;
  return *this;
}

double OscillationMonitor::Sums::given() const noexcept {
  return position > 0 ? 0.5 * elastic / position * swing - energy : 0;
}

OscillationMonitor::BandPass::BandPass(double rate_hz)
    : high_(FilterKind::high_pass, kLowest, rate_hz),
      low_(FilterKind::low_pass, std::min(kHighest, kHighestOfRate * rate_hz), rate_hz) {}

OscillationMonitor::OscillationMonitor(const OscillationMonitorOptions& options)
    : options_(options),
      quantum_(std::max(options.position_resolution, kSmallestQuantum)),
      stretch_ticks_(std::max(1, static_cast<int>(std::lround(kWindow / kStretches * options.rate_hz)))),
      longest_step_(kLongestGap / options.rate_hz),
      delay_((validate(options), options.delay * options.rate_hz)),
      sent_(delay_),
      error_band_(options.rate_hz),
      force_band_(options.rate_hz) {}

std::optional<OscillationVerdict> OscillationMonitor::update(const State& state, const Reference& reference) noexcept {
  const Vec3 error = reference.position - state.position;
  if (!is_finite(error) || !is_finite(state.force_applied)) {
    reset();
    return std::nullopt;
  }
  if (!begun_ || state.dt > longest_step_) {
    begin(state, error);
    return std::nullopt;
  }
  sent_.push(state.force_applied);
  const Vec3 force = force_band_.update(sent_.acted(delay_));
  const Vec3 previous = error_;
  error_ = error_band_.update(error);
  const Vec3 step = error_ - previous;
  const Vec3 middle = 0.5 * (error_ + previous);
  current_ += {error_.squaredNorm(), step.squaredNorm(), force.squaredNorm(),
               force.dot(step),      force.dot(middle),  2 * middle.dot(step)};
  if (++ticks_ < stretch_ticks_) return std::nullopt;

  stretches_[static_cast<std::size_t>(stretch_)] = current_;
  stretch_ = (stretch_ + 1) % kStretches;
  current_ = {};
  ticks_ = 0;
  if (complete_ < kStretches) ++complete_;
  return complete_ < kStretches ? std::nullopt : judge();
}

void OscillationMonitor::begin(const State& state, const Vec3& error) noexcept {
  begun_ = true;
  sent_.fill(state.force_applied);
  force_band_.reset(state.force_applied);
  error_band_.reset(error);
  error_.setZero();
  current_ = {};
  ticks_ = complete_ = 0;
  found_ = 0;
}

std::optional<OscillationVerdict> OscillationMonitor::judge() noexcept {
  Sums early, late;
  for (int i = 0; i < kStretches; ++i)
    (i < kStretches / 2 ? early : late) += stretches_[static_cast<std::size_t>((stretch_ + i) % kStretches)];
  Sums all = early;
  all += late;

  OscillationVerdict verdict;
  verdict.energy = all.given();
  verdict.frequency_hz = all.position > 0 ? std::sqrt(all.step / all.position) * options_.rate_hz / (2 * pi) : 0;
  verdict.amplitude = std::sqrt(2 * all.position / (kStretches * stretch_ticks_));
  const auto detector = detect(early, late, verdict.frequency_hz);
  found_ = found_ << 1 | (detector ? 1U : 0U);
  const bool lasts =
      verdict.frequency_hz < kFewCycles ? (found_ & kLastFour) == kLastFour : std::popcount(found_ & kLastThree) >= 2;
  if (!detector || !lasts) return std::nullopt;
  verdict.detector = *detector;
  return verdict;
}

std::optional<OscillationVerdict::Detector> OscillationMonitor::detect(const Sums& early, const Sums& late,
                                                                       double frequency_hz) const noexcept {
  using Detector = OscillationVerdict::Detector;
  if (frequency_hz < kLowestFrequency) return std::nullopt;

  const double ticks = 0.5 * kStretches * stretch_ticks_;
  const double f = options_.max_force, fq = f * quantum_, w = 2 * pi * frequency_hz;
  const double inertia = kOfInertia * options_.mass * w * w;  // force over position
  const auto both = [&](const auto& holds) { return holds(early) && holds(late); };

  const bool lasting = late.position > kFading * kFading * early.position;
  const bool driven = both([&](const Sums& s) {
    return s.given() > kPowerFactor * std::sqrt(s.force * s.step) && s.force > inertia * inertia * s.position;
  });
  if (lasting && driven) {
    if (both([&](const Sums& s) { return s.given() > kEnergy * fq; })) return Detector::energy;
    if (both([&](const Sums& s) {
          const double rms = std::sqrt(s.position / ticks);
          return rms > kRipple * quantum_ && s.given() * rms > kRippleEnergy * fq * quantum_;
        }))
      return Detector::ripple;
  }
  if (frequency_hz > kForceFrequency && late.force > kFading * kFading * early.force &&
      both([&](const Sums& s) { return s.force > kForce * kForce * f * f * ticks && s.given() > 0; }))
    return Detector::force;
  return std::nullopt;
}

}  // namespace haptrace
