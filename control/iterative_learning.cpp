#include "control/iterative_learning.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "control/zero_phase.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kFade = 0.05;          // time constant with which a step in the learned force fades [s]
constexpr double kFirst = 0.25;         // weight of the first repetition in the mean: it follows another path
constexpr int kFewest = 3;              // repetitions before learning may stop: their mean is less noisy than one
constexpr double kUnsteady = 0.05;      // share of ticks at which the time along the path may stand still or creep
constexpr double kMostSoftened = 0.02;  // share of ticks with softened feedback
constexpr double kSteadyStep = 0.5;     // share of the usual step of that time per tick, below which it creeps

Vec3 interpolated(const std::vector<Vec3>& rows, double index) {
  const double last = static_cast<double>(rows.size() - 1), i = std::clamp(index, 0.0, last);
  const auto before = static_cast<std::size_t>(i);
  const std::size_t after = std::min(before + 1, rows.size() - 1);
  const double part = i - static_cast<double>(before);
  return (1 - part) * rows[before] + part * rows[after];
}

/// Resamples values at increasing times to `count` equal steps from 0.
std::vector<Vec3> resampled(const std::vector<double>& time, const std::vector<Vec3>& rows, double step,
                            std::size_t count) {
  std::vector<Vec3> result(count);
  std::size_t i = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const double t = step * static_cast<double>(k);
    while (i + 2 < time.size() && time[i + 1] <= t) ++i;
    const double span = time[i + 1] - time[i];
    const double part = span > 0 ? std::clamp((t - time[i]) / span, 0.0, 1.0) : 1.0;
    result[k] = (1 - part) * rows[i] + part * rows[i + 1];
  }
  return result;
}

}  // namespace

const char* to_string(LearningOutcome outcome) noexcept {
  static constexpr EnumNames<LearningOutcome, 5> kOutcomes{"outcome of learning",
                                                           {"learned", "converged", "undone", "softened", "skipped"}};
  return kOutcomes.name(outcome);
}

Vec3 ForceTable::at(double time) const noexcept {
  if (force.empty()) return Vec3::Zero();
  return interpolated(force, time / step);
}

void RepetitionLog::reserve(std::size_t rows) {
  time.reserve(rows);
  for (auto* column : {&position, &reference, &acceleration, &known, &sent}) column->reserve(rows);
}

void RepetitionLog::clear() noexcept {
  time.clear();
  for (auto* column : {&position, &reference, &acceleration, &known, &sent}) column->clear();
  softened = 0;
  vibrated = false;
}

IterativeLearning::IterativeLearning(const Options& options, ForceTable known, int repetitions)
    : options_(options), table_(std::move(known)), repetitions_(repetitions), trusted_(repetitions == 0) {
  check_range("learning: the rate", options_.rate_hz, 1, 1e6, "Hz");
  check_range("learning: the speed factor", options_.speed, 1e-3, 1e3);
  check_range("learning: the cut-off", options_.cutoff_hz, 1e-3, 1e6, "Hz");
  check_range("learning: the delay", options_.delay, 0, 1, "s");
  for (const double mass : options_.mass) check_range("learning: the mass", mass, 0, 1e4, "kg");
  const double session = options_.duration / options_.speed;
  if (!(session > 0 && session <= kLongest))
    throw input_error(
        fmt::format("a repetition lasts {:.1f} s; learning needs repetitions longer than 0 s and of at most {} s",
                    session, kLongest));
  if (!table_.force.empty() && !(table_.step > 0 && std::isfinite(table_.step)))
    throw input_error(fmt::format("the step of a learned force is {} s; it must be above 0", table_.step));
  if (table_.force.empty()) {
    table_.step = 0.004 * options_.speed;
    table_.force.assign(static_cast<std::size_t>(std::ceil(options_.duration / table_.step)) + 1, Vec3::Zero());
  }
  best_ = table_;
}

std::vector<Vec3> IterativeLearning::met_load(const RepetitionLog& log) const {
  const double tick = options_.speed / options_.rate_hz;  // [s] along the path
  const auto rows = static_cast<std::size_t>(std::floor(options_.duration / tick)) + 1;
  std::vector<Vec3> error = resampled(log.time, log.position, tick, rows);
  const std::vector<Vec3> reference = resampled(log.time, log.reference, tick, rows);
  for (std::size_t k = 0; k < rows; ++k) error[k] -= reference[k];
  zero_phase_low_pass(error, kTwoPasses * options_.cutoff_hz, options_.rate_hz);
  const double rate2 = options_.rate_hz * options_.rate_hz;
  std::vector<Vec3> lacking(rows, Vec3::Zero());  // second derivative of the error
  for (std::size_t k = 1; k + 1 < rows; ++k) lacking[k] = rate2 * (error[k + 1] - 2 * error[k] + error[k - 1]);

  // A force that is sent at a tick acts from `delay` later on, for a period; the middle of this period is half a period
  // later still. Forces sent at the very end act beyond it, and are not learned from.
  const double lag = options_.delay * options_.rate_hz + 0.5;
  const std::vector<Vec3> sent = resampled(log.time, log.sent, tick, rows);
  const std::vector<Vec3> known = resampled(log.time, log.known, tick, rows);
  const std::vector<Vec3> acceleration = resampled(log.time, log.acceleration, tick, rows);
  const auto mass_at = [&](double row) -> Vec3 {
    return options_.inertia ? options_.inertia->at(interpolated(reference, row)).cwiseProduct(options_.mass)
                            : options_.mass;
  };
  std::vector<Vec3> met(static_cast<std::size_t>(std::max(std::floor(static_cast<double>(rows) - 1 - lag), 2.0)));
  for (std::size_t k = 0; k < met.size(); ++k) {
    const double acts = static_cast<double>(k) + lag;
    met[k] = sent[k] - known[k] - mass_at(acts).cwiseProduct(interpolated(acceleration, acts));
  }
  zero_phase_low_pass(met, kTwoPasses * options_.cutoff_hz, options_.rate_hz);
  for (std::size_t k = 0; k < met.size(); ++k) {
    const double acts = static_cast<double>(k) + lag;
    met[k] -= mass_at(acts).cwiseProduct(interpolated(lacking, acts));
  }

  std::vector<Vec3> load(table_.force.size());
  for (std::size_t i = 0; i < load.size(); ++i)
    load[i] = interpolated(met, static_cast<double>(i) * table_.step / tick);
  return load;
}

bool IterativeLearning::only_noise(const std::vector<Vec3>& error) const {
  if (error_.empty()) return false;
  double differs = 0, repeats = 0;
  for (std::size_t i = 0; i < error.size(); ++i) {
    differs += 0.25 * (error[i] - error_[i]).squaredNorm();
    repeats += 0.25 * (error[i] + error_[i]).squaredNorm();
  }
  // The mean of two repetitions still contains as much of the part that differs as their half difference.
  return repeats - differs < kNoise * (repeats + differs);
}

LearningOutcome IterativeLearning::learn(const RepetitionLog& log) {
  const double tick = options_.speed / options_.rate_hz;
  const std::size_t n = log.size();
  if (n < 8 || log.time.back() < options_.duration - 2 * tick) return LearningOutcome::skipped;
  std::size_t crept = 0;
  for (std::size_t i = 1; i < n; ++i)
    if (log.time[i] - log.time[i - 1] < kSteadyStep * tick) ++crept;
  if (static_cast<double>(crept) > kUnsteady * static_cast<double>(n)) return LearningOutcome::skipped;
  if (log.vibrated || static_cast<double>(log.softened) > kMostSoftened * static_cast<double>(n)) {
    table_ = best_;
    best_rms_ = 0;
    error_.clear();
    if (!trusted_ && ++softened_ >= kDistrusted) {
      std::ranges::fill(table_.force, Vec3::Zero());
      best_ = table_;
      repetitions_ = 0;
      trusted_ = true;
    }
    return LearningOutcome::softened;
  }
  trusted_ = true;

  double sum = 0;
  std::vector<Vec3> error(n);
  for (std::size_t i = 0; i < n; ++i) {
    error[i] = log.position[i] - log.reference[i];
    sum += error[i].squaredNorm();
  }
  rms_ = std::sqrt(sum / static_cast<double>(n));
  std::vector<Vec3> along = resampled(log.time, error, table_.step, table_.force.size());

  if (repetitions_ > 0 && best_rms_ > 0 && rms_ > kWorse * best_rms_) {
    table_ = best_;
    caution_ *= 0.5;
    error_.clear();
    return LearningOutcome::undone;
  }
  if (best_rms_ == 0 || rms_ < best_rms_) {
    best_ = table_;
    best_rms_ = rms_;
  }
  const bool noise = only_noise(along);
  error_ = std::move(along);
  if (noise && repetitions_ >= kFewest) return LearningOutcome::converged;

  const double lambda = caution_ * (repetitions_ == 0 ? 1.0 : 1 / (repetitions_ + kFirst));
  const std::vector<Vec3> load = met_load(log);
  for (std::size_t i = 0; i < load.size(); ++i) table_.force[i] += lambda * (load[i] - table_.force[i]);
  ++repetitions_;
  return LearningOutcome::learned;
}

void LearnedForce::start(const State&) noexcept {
  if (writing_ != Writing::writing && writing_ != Writing::last_row) return;
  writing_ = Writing::broken;
  log_.clear();
}

void LearnedForce::write_down(const TermInput& input) noexcept {
  const double time = input.reference.time;
  if (writing_ == Writing::writing || writing_ == Writing::last_row) {
    log_.sent.push_back(input.state.force_applied);
    if (writing_ == Writing::last_row) writing_ = Writing::ended;
  }
  if (!std::isfinite(time)) {
    writing_ = Writing::waiting;
    log_.clear();
    return;
  }
  // Report its end, so that it counts as one of the repetitions to learn from. Without samples, nothing is learned.
  if (writing_ == Writing::broken && time >= duration_) writing_ = Writing::ended;
  if (writing_ == Writing::waiting) writing_ = Writing::writing;
  if (writing_ != Writing::writing) return;
  if (log_.full()) {
    writing_ = Writing::taken;
    return;
  }
  log_.time.push_back(time);
  log_.position.push_back(input.state.position);
  log_.reference.push_back(input.reference.position);
  log_.acceleration.push_back(input.reference.acceleration);
  log_.known.push_back(input.before);
  log_.softened += input.state.softened ? 1 : 0;
  log_.vibrated |= input.state.vibrated;
  if (time >= duration_) writing_ = Writing::last_row;
}

bool LearnedForce::take_repetition(RepetitionLog& log) noexcept {
  if (writing_ != Writing::ended) return false;
  writing_ = Writing::taken;
  std::swap(log_, log);
  log_.clear();
  return true;
}

Vec3 LearnedForce::force(const TermInput& input) noexcept {
  write_down(input);
  const double time = input.reference.time;
  const bool on_path = std::isfinite(time);
  const Vec3 target = table_ != nullptr ? table_->at(on_path ? time : 0) : Vec3::Zero();
  if (table_ != used_ || on_path != on_path_) offset_ = value_ - target;
  used_ = table_;
  on_path_ = on_path;
  offset_ *= std::exp(-input.state.dt / kFade);
  value_ = target + offset_;
  return input.tuning.learning * value_;
}

}  // namespace haptrace
