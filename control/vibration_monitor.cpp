#include "control/vibration_monitor.h"

#include "base/error.h"
#include "control/filters.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace haptrace {
namespace {

using Array = Eigen::Array4f;

constexpr double kEnergyCutoff = 20, kCycleCutoff = 5;  // [Hz]
constexpr double kEnergyTime = 0.05;                    // [s]
constexpr double kLargestForceThatCounts = 12;          // largest F: 0.2 of it is felt on any device [N]
constexpr float kLargest = 1e12F;                       // largest value that single precision can square [N, m]
constexpr float kLongestHalfCycle = 0.15F;              // [s]
constexpr float kLongestGapTicks = 5;                   // longest time that a gap counts for [ticks]
constexpr float kIdle = 1;                              // time without force after which the filters are empty [s]
constexpr float kDeclaredMargin = std::numbers::sqrt2_v<float>;  // factor on a declared amplitude

[[gnu::always_inline]] inline Array single(const Vec3& v) noexcept {
  const Array x(static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()), 0.0F);
  return x.max(-kLargest).min(kLargest);
}

double cutoff(double hz, double rate_hz) noexcept {
  return std::min(hz, 0.4 * rate_hz);
}

}  // namespace

void validate(const VibrationMonitorOptions& options) {
  check_range("vibration monitor: the rate [Hz]", options.rate_hz, 10, 20000);
  check_range("vibration monitor: the largest force [N]", options.max_force, 1e-300, 1e300);
  check_range("vibration monitor: the position resolution [m]", options.position_resolution, 0, 1);
  check_range("vibration monitor: the answer to a tremor [N]", options.tremor, 0, 1e300);
}

RippleEnergy::HighPass::HighPass(double cutoff_hz, double rate_hz) noexcept {
  const double g = std::tan(std::numbers::pi * cutoff_hz / rate_hz);
  const double a1 = 1 / (1 + g * (g + std::numbers::sqrt2));
  a1_.setConstant(static_cast<float>(a1));
  a2_.setConstant(static_cast<float>(g * a1));
  a3_.setConstant(static_cast<float>(g * g * a1));
}

RippleEnergy::RippleEnergy(double cutoff_hz, double rate_hz) noexcept
    : first_(cutoff(cutoff_hz, rate_hz), rate_hz),
      second_(cutoff(cutoff_hz, rate_hz), rate_hz),
      rate_hz_(rate_hz),
      smoothing_(static_cast<float>(low_pass_share(1, kEnergyTime * rate_hz))) {}

double RippleEnergy::frequency() const noexcept {
  if (!(energy_ > 0)) return 0;
  return rate_hz_ / std::numbers::pi * std::asin(std::min(1.0, 0.5 * std::sqrt(double{step_energy_} / energy_)));
}

VibrationMonitor::VibrationMonitor(const VibrationMonitorOptions& options)
    : energy_(kEnergyCutoff, options.rate_hz),
      first_(cutoff(kCycleCutoff, options.rate_hz), options.rate_hz),
      second_(cutoff(kCycleCutoff, options.rate_hz), options.rate_hz) {
  validate(options);
  const auto force = static_cast<float>(std::min(options.max_force, kLargestForceThatCounts));
  period_ = static_cast<float>(1 / options.rate_hz);
  energy_limit_ = 0.2F * force;
  peak_limit_ = 0.3F * force;
  slow_limit_ = std::max(0.25F * force, static_cast<float>(std::min(options.tremor, 0.6 * force)));
  contact_limit_ = 0.15F * force;
  speed_ticks_ = static_cast<unsigned>(std::max(1L, std::lround(4e-3 * options.rate_hz)));
  leave_ticks_ = static_cast<int>(std::max(1L, std::lround(6e-3 * options.rate_hz)));
  const double counts = 1.5 * options.position_resolution * options.rate_hz / speed_ticks_;
  least_speed_ = static_cast<float>(std::max(0.01, counts));
  positions_.fill(Array::Zero());
}

std::optional<VibrationAlarm> VibrationMonitor::update(const Vec3& sent, const Vec3& position, double declared,
                                                       double dt) noexcept {
  std::optional<VibrationAlarm> alarm;
  if (!std::isfinite(sent.sum() + position.sum() + declared + dt)) return alarm;
  known_ = dt > 1.5F * period_ ? 0 : known_ + 1;
  dt_ = std::min(static_cast<float>(dt), kLongestGapTicks * period_);
  newest_ = (newest_ + 1) % kPositions;
  positions_[newest_] = single(position);

  const bool touches = sent.x() != 0 || sent.y() != 0 || sent.z() != 0;
  touched_ += dt_;
  idle_ = touches ? 0 : idle_ + dt_;
  if (idle_ > kIdle) return alarm;

  const Array force = single(sent);
  const auto vibration = static_cast<float>(declared);
  watch_contact(force, touches, alarm);

  const Array band = second_.update(first_.update(force));
  for (int i = 0; i < 3; ++i) {
    if ((band[i] > 0) == (band_[i] > 0)) continue;
    const float before = dt_ * band_[i] / (band_[i] - band[i]);
    complete(axes_[static_cast<std::size_t>(i)], since_[i] + before, peak_[i], vibration, alarm);
    since_[i] = -before;  // and dt_ is added below
    peak_[i] = 0;
  }
  since_ += dt_;
  peak_ = peak_.max(band.abs());
  band_ = band;

  if (energy_.update(force, std::max(energy_limit_, vibration), std::max(0.5F * energy_limit_, vibration), dt_))
    alarm = VibrationAlarm{.rule = VibrationRule::energy, .frequency_hz = frequency(), .ripple = energy_.rms()};
  return alarm;
}

std::optional<VibrationAlarm> VibrationMonitor::remaining() const noexcept {
  if (!energy_.remains()) return std::nullopt;
  return VibrationAlarm{
      .rule = VibrationRule::energy, .frequency_hz = frequency(), .ripple = energy_.rms(), .remains = true};
}

void VibrationMonitor::complete(Axis& axis, float length, float peak, float declared,
                                std::optional<VibrationAlarm>& alarm) noexcept {
  const float previous = axis.length[(axis.next + kHalfCycles - 1) % kHalfCycles];
  axis.length[axis.next] = length;
  axis.peak[axis.next] = peak;
  axis.next = (axis.next + 1) % kHalfCycles;
  const float threshold = std::max(peak_limit_, kDeclaredMargin * declared);
  axis.strong = length <= kLongestHalfCycle && peak > threshold ? std::min(axis.strong + 1, kHalfCycles) : 0;
  if (axis.strong == kHalfCycles)
    if (const auto frequency = regular(axis)) {
      float sum = 0;
      for (const float each : axis.peak) sum += each;
      alarm = VibrationAlarm{.rule = VibrationRule::half_cycles,
                             .frequency_hz = *frequency,
                             .ripple = sum / kHalfCycles / std::numbers::sqrt2};
    }

  // Update the run of the slow rule.
  const float period = length + previous;
  bool similar = axis.run > 0 && length <= kLongestHalfCycle &&
                 std::min(peak, axis.least_peak) > 0.6F * std::max(peak, axis.largest_peak);
  if (similar && axis.run > 1) {
    const float mean = axis.period_sum / static_cast<float>(axis.run - 1);
    similar = std::abs(period - mean) < 0.25F * mean;
  }
  if (!similar) {
    axis.run = 1;
    axis.period_sum = 0;
    axis.peak_sum = axis.least_peak = axis.largest_peak = peak;
    return;
  }
  ++axis.run;
  axis.period_sum += period;
  axis.peak_sum += peak;
  axis.least_peak = std::min(axis.least_peak, peak);
  axis.largest_peak = std::max(axis.largest_peak, peak);
  const auto count = static_cast<float>(axis.run);
  if (axis.run < 5 || axis.peak_sum <= count * std::max(slow_limit_, kDeclaredMargin * declared) || alarm) return;
  const float frequency = (count - 1) / axis.period_sum;
  if (frequency < 4.5F || frequency > 16 || axis.run < (frequency < 10 ? 5 : 7)) return;
  alarm = VibrationAlarm{.rule = VibrationRule::slow, .frequency_hz = frequency, .ripple = 0.5 * axis.peak_sum / count};
}

double VibrationMonitor::frequency() const noexcept {
  float largest = 0, duration = 1;
  for (const Axis& axis : axes_) {
    float peaks = 0, lengths = 0;
    for (unsigned i = 0; i < kHalfCycles; ++i) {
      peaks += axis.peak[i];
      lengths += axis.length[i];
    }
    if (peaks > largest && lengths > 0) {
      largest = peaks;
      duration = lengths;
    }
  }
  return 0.5 * kHalfCycles / duration;
}

std::optional<double> VibrationMonitor::regular(const Axis& axis) const noexcept {
  float early = 0, late = 0, sum = 0, squares = 0;
  for (unsigned i = 0; i < kHalfCycles; ++i) {
    const unsigned at = (axis.next + i) % kHalfCycles;
    (i < kHalfCycles / 2 ? early : late) += axis.peak[at];
    if (i + 1 == kHalfCycles) break;
    const float period = axis.length[at] + axis.length[(at + 1) % kHalfCycles];
    sum += period;
    squares += period * period;
  }
  constexpr float kPeriods = kHalfCycles - 1;
  const float mean = sum / kPeriods, variance = squares / kPeriods - mean * mean;
  if (late <= 0.8F * early || variance >= 0.04F * mean * mean || 15 * mean >= 1) return std::nullopt;
  return 1 / mean;
}

Array VibrationMonitor::velocity() const noexcept {
  const Array& before = positions_[(newest_ + kPositions - speed_ticks_) % kPositions];
  return (positions_[newest_] - before) / (static_cast<float>(speed_ticks_) * period_);
}

void VibrationMonitor::watch_contact(const Array& force, bool touches, std::optional<VibrationAlarm>& alarm) noexcept {
  if (!touches) {
    if (touching_) leaving_ = leave_ticks_;
    touching_ = false;
    if (leaving_ > 0 && --leaving_ == 0) judge_contact(alarm);
    return;
  }
  if (!touching_) {
    if (leaving_ > 0) judge_contact(alarm);
    leaving_ = 0;
    touching_ = true;
    interval_ = touched_;
    touched_ = duration_ = largest_ = 0;
    if (interval_ > 0.115F) bounces_ = 0;
    if (interval_ > 0.35F) slow_bounces_ = 0;
    sum_.setZero();
    entry_ = velocity();
    entry_known_ = known_ > speed_ticks_;
  }
  duration_ += dt_;
  sum_ += force;
  largest_ = std::max(largest_, force.square().sum());
}

void VibrationMonitor::judge_contact(std::optional<VibrationAlarm>& alarm) noexcept {
  if (duration_ >= 0.12F || !(largest_ > contact_limit_ * contact_limit_)) return;
  if (!entry_known_ || known_ <= speed_ticks_) return;
  const Array along = sum_ / std::max(std::sqrt(sum_.square().sum()), 1e-12F);
  const float in = -(entry_ * along).sum(), out = (velocity() * along).sum();
  if (!(in > least_speed_)) return;
  const int gain = out >= 0.85F * in ? 1 : -2;
  constexpr int kAlarm = 4;
  bounces_ = std::clamp(bounces_ + gain, 0, kAlarm);
  slow_bounces_ = std::clamp(slow_bounces_ + gain, 0, kAlarm);
  if (slow_bounces_ < kAlarm || gain < 0) return;
  alarm = VibrationAlarm{.rule = bounces_ == kAlarm ? VibrationRule::contacts : VibrationRule::slow,
                         .frequency_hz = 1 / std::max(interval_, period_),
                         .ripple = 0.5 * std::sqrt(double{largest_})};
}

}  // namespace haptrace
